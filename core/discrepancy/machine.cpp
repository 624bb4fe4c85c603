#include "core/discrepancy/machine.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <optional>

#include "core/discrepancy/advise.h"
#include "core/discrepancy/machine_conclusion.h"
#include "core/discrepancy/machine_feedback.h"
#include "core/discrepancy/machine_linear.h"
#include "core/discrepancy/machine_report.h"
#include "core/discrepancy/machine_second_look.h"
#include "core/discrepancy/machine_sticking_loop.h"
#include "core/discrepancy/reduction_interval.h"
#include "core/identify/order.h"
#include "core/mechanisms/mechanism.h"
#include "core/recording/same_rate.h"
#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

constexpr int kLastIterations = 12;
constexpr double kDecimationShare = 0.1;  // of the output's deviation: first guess of what a linear machine leaves
constexpr double kSearched = 0.8;         // of the time of a diagnosis

Result<void> check(std::span<const Recording> recordings) {
  if (recordings.empty()) return fail("no_recordings", "there is nothing to diagnose: no recording was given");
  for (const Recording& recording : recordings) {
    if (!have_same_rate(recording, recordings.front())) {
      return fail("sample_time_differs", "the recordings have different sample times");
    }
    const auto [low, high] = std::minmax_element(recording.output.values.begin(), recording.output.values.end());
    if (recording.samples() < 20 || *high <= *low) {
      return fail("constant_output",
                  fmt::format("{}: too few samples or an output that never changes", recording.name));
    }
  }
  return {};
}

/// A ramp up and down at one speed and nothing else: lag and memory look alike.
bool is_one_rate(std::span<const Recording> recordings) {
  double slow = INFINITY, fast = 0;
  for (const Recording& recording : recordings) {
    double ramps = 0;
    for (const Segment& segment : recording.segments) {
      if (segment.kind != SegmentKind::kRamp) continue;
      ramps += static_cast<double>(segment.end - segment.begin);
      slow = std::min(slow, std::abs(segment.rate_per_s));
      fast = std::max(fast, std::abs(segment.rate_per_s));
    }
    if (ramps < 0.8 * static_cast<double>(recording.samples()) && recording.test != TestKind::kTriangle) return false;
  }
  return fast > 0 && fast < 1.5 * slow;
}

/// The input a sample later: where a controller answers within the sample, its answer knows the noise that it follows.
Recording with_past_input(Recording recording) {
  auto& input = recording.input.values;
  input.insert(input.begin(), input.front());
  input.pop_back();
  return recording;
}

/// Rms over all recordings; `simulated` holds the linear machine's free runs, or nothing before there are any.
double pooled_noise(std::span<const Recording> recordings, const LoopSigns& loop,
                    const std::vector<std::vector<double>>& simulated = {}) {
  double squares = 0, samples = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const auto n = static_cast<double>(recordings[r].samples());
    const Recording recording = loop.integrating_controller ? with_past_input(recordings[r]) : recordings[r];
    const NoiseFloor floor =
        simulated.empty() ? noise_floor(recording) : noise_floor_of_ringing(recording, simulated[r]);
    squares += std::pow(floor.rms, 2) * n;
    samples += n;
  }
  return std::sqrt(squares / samples);
}

/// The held-out error of the best linear machine of a low order; infinite where there is none.
double linear_error(const MachineData& data) {
  constexpr int kLowOrder = 3;
  std::vector<Recording> recordings;
  std::vector<const Recording*> pointers;
  for (const MachineRecord& record : data.records) recordings.push_back(as_recording(record, data.period_s));
  for (const Recording& recording : recordings) pointers.push_back(&recording);
  OrderOptions options;
  options.offsets = OffsetSharing::kShared;
  options.largest_order = kLowOrder;
  options.max_rows = kLinearRows;
  const auto choice = choose_order(pointers, options);
  double least = std::numeric_limits<double>::infinity();
  if (!choice) return least;
  for (const TriedStructure& tried : choice->tried) least = std::min(least, tried.rmse_heldout);
  return least;
}

constexpr double kCloserBetween = 1.05;  // times less is left with the input taken the right way between samples
constexpr double kNearFloors = 1.25;     // the input is taken the right way, or it does not matter

/// What a search sees. Whether a command that moves is held between its samples, as what writes it does, or moves on,
/// as what is read does, is told by the linear machine: in half a sample a ramp goes as far as a small fault.
MachineData searched_data(std::span<const Recording> recordings, double allowed_rms, std::size_t most_samples) {
  MachineData moving = machine_data(recordings, allowed_rms, most_samples, InputBetween::kStraight);
  if (!moving.interval_means) return moving;
  MachineData held = machine_data(recordings, allowed_rms, most_samples, InputBetween::kHeld);
  return linear_error(moving) > kCloserBetween * linear_error(held) ? held : moving;
}

/// The side channels that move: one that stands still is no more than an offset.
std::vector<SideOfMachine> sides_of(const MachineData& data) {
  constexpr double kStill = 1e-9;  // of its mean: digits of a number that was written
  std::vector<SideOfMachine> sides;
  const std::vector<Channel>& channels = data.records.front().side;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    std::vector<double> values;
    for (const MachineRecord& record : data.records) {
      const auto same = std::find_if(record.side.begin(), record.side.end(),
                                     [&](const Channel& channel) { return channel.name == channels[c].name; });
      if (same == record.side.end()) continue;
      std::copy_if(same->values.begin(), same->values.end(), std::back_inserter(values),
                   [](double value) { return std::isfinite(value); });
    }
    if (values.empty()) continue;
    const Eigen::Map<const Eigen::ArrayXd> all(values.data(), static_cast<Eigen::Index>(values.size()));
    const double mean = all.mean(), spread = std::sqrt((all - mean).square().mean());
    if (spread > kStill * std::abs(mean)) sides.push_back({channels[c].name, mean, spread});
  }
  return sides;
}

MachineGround ground_of(std::span<const Recording> recordings, const MachineData& data, const LoopSigns& loop) {
  MachineGround ground;
  ground.least_delay = loop.integrating_controller ? 1 : 0;
  ground.input_low = ground.output_low = INFINITY;
  ground.input_high = ground.output_high = -INFINITY;
  for (const MachineRecord& record : data.records) {
    for (const std::size_t t : record.valid) {
      ground.input_low = std::min(ground.input_low, record.input[t]);
      ground.input_high = std::max(ground.input_high, record.input[t]);
      ground.output_low = std::min(ground.output_low, record.output[t]);
      ground.output_high = std::max(ground.output_high, record.output[t]);
      if (t == 0) continue;
      ground.steepest_input_per_s =
          std::max(ground.steepest_input_per_s, std::abs(record.input[t] - record.input[t - 1]) / data.period_s);
    }
    ground.longest_s = std::max(ground.longest_s, static_cast<double>(record.input.size()) * data.period_s);
  }
  ground.input_zero = -data.input_mean / data.input_scale;
  ground.output_zero = -data.output_mean / data.output_scale;
  ground.single_recording = recordings.size() == 1;
  ground.one_rate = is_one_rate(recordings);
  ground.sides = sides_of(data);
  return ground;
}

/// 1 − extended / baseline with its interval over the held-out groups.
void measure_reduction(const MachineScore& baseline, const MachineScore& extended, DiscrepancyGain& gain) {
  const auto squares = [](const MachineScore& score, std::size_t group) {
    return static_cast<double>(score.gaps[group].size()) * std::exp(2 * score.log_rms[group]);
  };
  std::vector<HeldOutSquares> groups;
  for (std::size_t group = 0; group < baseline.log_rms.size(); ++group) {
    groups.push_back({squares(baseline, group), squares(extended, group)});
  }
  gain.reduction = 1 - gain.rmse_extended / gain.rmse_baseline;
  gain.reduction_ci95 = reduction_interval(groups);
}

/// A fit of the search on the recordings from end to end, as far as those are longer than what was searched.
MachineFit on_whole_records(const MachineData& searched, const MachineData& whole, MachineFit fit,
                            MachineBudget& budget) {
  if (!searched.windows) return fit;
  fit.starts.clear();
  refine_starts(whole, whole.all_rows(), kLastIterations, fit, budget);
  return fit;
}

/// The same, led on over every sample. Windows tell the law; what is refitted from end to end must be closer there, or
/// the search's own fit stands.
MachineFit refined_on(const MachineData& searched, const MachineData& whole, const MachineFit& fit,
                      MachineBudget& budget) {
  MachineFit led = on_whole_records(searched, whole, fit, budget);
  if (!searched.windows) return led;
  MachineFit refined = led;
  refine_machine(whole, whole.all_rows(), kLastIterations, refined, budget);
  return !refined.failed && refined.squares < led.squares ? refined : led;
}

/// Free run of one record on its recording's grid, in its own unit.
std::vector<double> on_grid(const MachineData& data, const MachineFit& fit, std::size_t record, std::size_t samples) {
  const auto y = run_record(data, record, fit);
  std::vector<double> out(samples);
  for (std::size_t t = 0; t < samples; ++t) {
    const std::size_t left = std::min(t / data.stride, y.size() - 1);
    const std::size_t right = std::min(left + 1, y.size() - 1);
    const double share = static_cast<double>(t % data.stride) / static_cast<double>(data.stride);
    out[t] = data.output_mean + data.output_scale * (y[left] + share * (y[right] - y[left]));
  }
  return out;
}

/// Free runs of a fit on every recording, from end to end.
std::vector<std::vector<double>> runs_of(std::span<const Recording> recordings, const MachineData& whole,
                                         const MachineFit& fit) {
  std::vector<std::vector<double>> runs;
  for (std::size_t r = 0; r < recordings.size(); ++r) runs.push_back(on_grid(whole, fit, r, recordings[r].samples()));
  return runs;
}

/// One search, and what it says.
struct Look {
  MachineData data;
  MachineSearch search;
  MachineFit linear;  ///< the best linear machine on the recordings from end to end
  double noise = 0;   ///< rms, unit of the output
  MachineVerdict verdict;

  Look(std::span<const Recording> recordings, MachineData searched, const MachineData& whole, const LoopSigns& loop,
       MachineBudget& budget)
      : data(std::move(searched)), search(search_machines(data, ground_of(recordings, data, loop), budget)) {
    linear = linear_on(whole, budget);
    noise = pooled_noise(recordings, loop, runs_of(recordings, whole, linear));
    verdict = conclude(search, data, {.data = whole, .linear = linear}, noise / data.output_scale, loop.is_regulated());
  }

  /// What to search once more, where nothing was found that accounts for what the linear machine leaves, and it leaves
  /// more beside what was searched; else empty.
  std::optional<MachineData> second_data(std::span<const Recording> recordings, const MachineData& whole) const {
    if (!data.windows || verdict.conclusion != Conclusion::kUnexplained) return std::nullopt;
    return second_look(recordings, data, whole, linear, noise / data.output_scale);
  }

  /// The error of the best explanation, named or not, over the noise.
  double floors_left() const {
    const bool law = !search.scores.empty() && search.scores.front().held_out;
    const double best = law ? std::min(search.scores.front().rms(), search.linear.rms()) : search.linear.rms();
    return best * data.output_scale / noise;
  }

  /// Whether what was found is closer to the recordings from end to end, too.
  bool is_borne_out(const MachineData& whole, MachineBudget& budget) const {
    constexpr double kCloser = 1.3;
    return verdict.winner && kCloser * refined_on(data, whole, verdict.winner->fit, budget).rms() < linear.rms();
  }

 private:
  /// The best linear machine of the chosen order for all samples: led on from where the search has it, or found anew.
  MachineFit linear_on(const MachineData& whole, MachineBudget& budget) const {
    MachineFit best = refined_on(data, whole, search.linear.fit, budget);
    // What has no dynamics has nothing to be found anew.
    if (!data.windows || best.machine.blocks.empty() || best.machine.blocks.front().sections.empty()) return best;
    std::vector<LinearMachine> others{{.fit = best}};
    if (auto anew = identified_linear(whole, search.ground.chosen_order, search.ground.dead_samples)) {
      others.push_back(std::move(*anew));
    }
    for (LinearMachine& other : others) {
      if (!solve_linear(whole, other)) continue;
      refine_machine(whole, whole.all_rows(), kLastIterations, other.fit, budget);
      if (!other.fit.failed && other.fit.squares < best.squares) best = std::move(other.fit);
    }
    return best;
  }
};

/// The winner refitted on everything there is.
struct Extension {
  const MachineData& data;  ///< the recordings from end to end
  MachineFit fit;
  Eigen::MatrixXd covariance;  ///< of the fit's free parameters
};

Extension extend(const MachineData& searched, const MachineData& whole, const MachineScore& winner,
                 MachineBudget& budget) {
  Extension extension{.data = whole, .fit = refined_on(searched, whole, winner.fit, budget)};
  extension.covariance = parameter_covariance(whole, whole.all_rows(), extension.fit);
  return extension;
}

/// A winner whose law is not told by free runs: as it stands.
Extension unrefined(const MachineData& searched, const MachineData& whole, const MachineScore& winner,
                    MachineBudget& budget) {
  Extension extension{.data = whole, .fit = on_whole_records(searched, whole, winner.fit, budget)};
  extension.covariance = parameter_covariance(whole, whole.all_rows(), extension.fit);
  return extension;
}

/// The cause as the table of laws writes it; what the chain has no figure for takes the law's own default, or nothing.
MechanismUse use_of(const std::string& cause, const std::vector<std::pair<std::string, ParameterEstimate>>& estimates) {
  MechanismUse use{.cause = cause, .parameters = {}, .channel = {}};
  const Mechanism* law = find_mechanism(cause);
  if (!law) return use;
  for (const MechanismParameter& parameter : law->parameters) {
    double value = std::isnan(parameter.otherwise) ? 0 : parameter.otherwise;
    for (const auto& [name, estimate] : estimates) {
      if (name == parameter.name) value = estimate.value;
      if (!estimate.text.empty()) use.channel = estimate.text;
    }
    use.parameters.push_back(value);
  }
  return use;
}

Model model_of(std::span<const Recording> recordings, const Extension& extension, const MachineScore& winner) {
  Model model;
  model.kind = "machine";
  model.input_unit = recordings.front().input.unit;
  model.output_unit = recordings.front().output.unit;
  model.dynamics.domain = Domain::kS;  // not used: the chain has its own
  model.machine = in_own_units(extension.data, extension.fit);
  for (const std::string& cause : winner.causes) {
    const auto estimates = cause_parameters(cause, extension.data, extension.fit, extension.covariance,
                                            model.input_unit, model.output_unit);
    MechanismUse use = use_of(cause, estimates);
    model.mechanisms.push_back(std::move(use));
  }
  return model;
}

std::vector<NamedCause> causes_of(std::span<const Recording> recordings, const MachineSearch& search,
                                  const MachineVerdict& verdict, const Extension& extension) {
  const MachineScore& winner = *verdict.winner;
  const double scale = extension.data.output_scale;
  const auto probability_of = [&](const std::string& cause) {
    double sum = 0;
    for (const Candidate& candidate : verdict.candidates) {
      const std::string list = "+" + candidate.cause + "+";
      if (list.find("+" + cause + "+") != std::string::npos) sum += candidate.probability;
    }
    return std::min(sum, 1.0);
  };
  std::vector<NamedCause> causes;
  for (std::size_t i = 0; i < winner.causes.size(); ++i) {
    NamedCause cause{
        .cause = winner.causes[i], .family = family_of(winner.causes[i]), .origin = origin_of(winner.causes[i])};
    cause.probability = probability_of(cause.cause);
    cause.family_probability = cause.probability;
    cause.alternatives = verdict.alternatives[i];
    for (const Candidate& candidate : verdict.candidates) {
      const bool listed =
          std::find(cause.alternatives.begin(), cause.alternatives.end(), candidate.cause) != cause.alternatives.end();
      if (listed && family_of(candidate.cause) == cause.family)
        cause.family_probability += probability_of(candidate.cause);
    }
    cause.family_probability = std::min(1.0, cause.family_probability);
    cause.parameters = cause_parameters(cause.cause, extension.data, extension.fit, extension.covariance,
                                        recordings.front().input.unit, recordings.front().output.unit);
    cause.severity_in_population_sd = std::numeric_limits<double>::quiet_NaN();
    cause.rmse_before = held_out_rms(search.linear) * scale;
    cause.rmse_after = held_out_rms(winner) * scale;
    cause.p_value = verdict.p_value;
    std::size_t wins = 0;
    for (std::size_t g = 0; g < winner.log_rms.size(); ++g)
      wins += winner.log_rms[g] < search.linear.log_rms[g] ? 1 : 0;
    cause.evidence.push_back(
        fmt::format("{}: {:.3g} times closer than the linear machine on what was held out, better "
                    "on {} of {} blocks",
                    winner.place, std::exp(search.linear.mean - winner.mean), wins, winner.log_rms.size()));
    causes.push_back(std::move(cause));
  }
  return causes;
}

bool has_friction(const MachineVerdict& verdict) {
  if (!verdict.winner) return false;
  const auto& causes = verdict.winner->causes;
  return std::find(causes.begin(), causes.end(), "friction") != causes.end();
}

/// A sticking valve that the loop tells, with the process behind it as well as a free run can tell that.
std::optional<MachineScore> score_of(const StickingLoop& loop, const MachineData& data, const MachineGround& ground,
                                     MachineBudget& budget) {
  MachineScore score{.causes = {"friction"}, .place = "on the input"};
  score.fit = held_input_friction(data, ground, loop.breakaway / data.input_scale, loop.kinetic / data.input_scale);
  if (score.fit.failed) return std::nullopt;
  evaluate_machine(data, data.all_rows(), score.fit, budget);
  if (score.fit.failed) return std::nullopt;
  hold_out(data, score, budget);
  return score;
}

/// What the loop tells stands in place of what a free run, that does not see it, makes of it.
void tell_loop(const StickingLoop& loop, NamedCause& friction) {
  for (auto& [name, estimate] : friction.parameters) {
    if (name != "breakaway_A" && name != "kinetic_A") continue;
    estimate.ci95 = name == "breakaway_A" ? loop.breakaway_ci95 : loop.kinetic_ci95;
    estimate.std_error = (estimate.ci95[1] - estimate.ci95[0]) / (2 * kTwoSided95);
  }
  friction.evidence = {
      fmt::format("in the loop, one step ahead and under noise of any colour: the output follows what a sticking valve "
                  "passes on of the input, log likelihood {:.0f} above the input itself, better on {} of {} stretches",
                  loop.log_gain, loop.won, loop.blocks),
      fmt::format("the valve stands on {:.0f} % of the samples while the input moves; nothing else in the loop drives "
                  "such a memory as well, and the input adds nothing to it",
                  100 * loop.rest_share),
      "free runs do not show it: a linear machine foretells the output through the controller's answer"};
}

std::vector<std::string> trace_of(const MachineSearch& search, const MachineData& data) {
  std::vector<std::string> lines;
  const auto line = [&](const MachineScore& score) {
    const BlockComparison whitened = compare_whitened(score, search.linear);
    std::string text = fmt::format(
        "{:28} {:42} fit {:.5g} heldout {:.5g} gain {:.3f} p {:.3f} whitened {:.3f} p {:.3f}", score.name(),
        score.place, score.fit.rms() * data.output_scale, score.held_out ? score.rms() * data.output_scale : NAN,
        std::exp(search.linear.mean - score.mean), compare_blocks(score.log_rms, search.linear.log_rms).p_value,
        std::exp(whitened.log_gain), whitened.p_value);
    for (const MachineBlock& block : score.fit.machine.blocks) {
      text += fmt::format(" {}", name_of(block.law));
      if (!block.sections.empty()) text += fmt::format("{}", order_of(block.sections));
      if (block.delay_samples > 0) text += fmt::format(" after {}", block.delay_samples);
      for (const double p : block.parameters) text += fmt::format(",{:.4g}", p);
    }
    lines.push_back(std::move(text));
  };
  line(search.linear);
  for (const MachineScore& score : search.scores) line(score);
  lines.push_back(fmt::format("black box {:.5g}; order {} dead {} stride {} records {} samples {} one_rate {} spent {}",
                              search.black_box_rms * data.output_scale, search.ground.chosen_order,
                              search.ground.dead_samples, data.stride, data.records.size(), data.samples(),
                              search.ground.one_rate, search.budget_spent));
  return lines;
}

/// The input of a planned test, one value per sample.
std::vector<double> sampled(const MachineTest& test, double period_s) {
  const auto samples = static_cast<std::size_t>(test.time_s.back() / period_s) + 1;
  std::vector<double> input(samples);
  for (std::size_t i = 0, k = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) * period_s;
    while (k + 2 < test.time_s.size() && test.time_s[k + 1] < t) ++k;
    const double share = (t - test.time_s[k]) / (test.time_s[k + 1] - test.time_s[k]);
    input[i] = test.input[k] + share * (test.input[k + 1] - test.input[k]);
  }
  return input;
}

/// The test that would settle what is open, and the chance that it does: the rivals' own models on its input.
NextTest settling_test(std::span<const Recording> recordings, const MachineSearch& search,
                       const MachineVerdict& verdict, const Extension& extension, const DiscrepancyGain& gain) {
  const MachineScore& winner = *verdict.winner;
  std::vector<std::string> separates;
  std::vector<Alternative> alternatives;
  const auto probability_of = [&](const std::string& name) {
    for (const Candidate& candidate : verdict.candidates) {
      if (candidate.cause == name) return candidate.probability;
    }
    return 0.0;
  };
  alternatives.push_back(
      {winner.name(), std::max(probability_of(winner.name()), 0.01), model_of(recordings, extension, winner), {}});
  for (std::size_t i = 0; i < verdict.alternatives.size(); ++i) {
    if (verdict.alternatives[i].empty()) continue;
    separates.push_back(winner.causes[i]);
    for (const std::string& rival : verdict.alternatives[i]) {
      separates.push_back(rival);
      std::vector<std::string> causes = winner.causes;
      causes[i] = rival;
      for (const MachineScore& score : search.scores) {
        if (score.causes != causes || score.fit.failed) continue;
        Extension fitted{.data = extension.data, .fit = score.fit};
        const auto free = static_cast<Eigen::Index>(score.fit.free.size());
        fitted.covariance = Eigen::MatrixXd::Zero(free, free);
        alternatives.push_back(
            {score.name(), std::max(probability_of(score.name()), 0.01), model_of(recordings, fitted, score), {}});
        break;
      }
    }
  }
  MachineTest planned = next_machine_test(recordings, search.ground, separates);
  const double period_s = recordings.front().sample_period_s;
  // What the best chain leaves above the noise does not average out.
  const double bias = std::sqrt(std::max(0.0, std::pow(gain.rmse_extended, 2) - std::pow(gain.noise_floor, 2)));
  const double chance =
      chance_to_settle(alternatives, sampled(planned, period_s),
                       {.noise_rms = gain.noise_floor, .bias_rms = bias, .sample_rate_hz = 1 / period_s});
  planned.told.expected_probability = std::isfinite(chance) ? chance : 0;
  return std::move(planned.told);
}

/// What is excluded where nothing was found.
void add_excluded_sizes(const MachineSearch& search, const MachineData& data, const Recording& first,
                        std::vector<Candidate>& candidates) {
  for (Candidate& candidate : candidates) {
    if (candidate.status != CandidateStatus::kTested) continue;
    const auto score = std::find_if(search.scores.begin(), search.scores.end(),
                                    [&](const MachineScore& s) { return s.name() == candidate.cause; });
    if (score == search.scores.end()) continue;
    candidate.upper_limit95 = excluded_sizes(*score, search.linear, data, first.input.unit, first.output.unit);
  }
}

void say_feedback(Discrepancy& discrepancy) {
  for (Candidate& candidate : discrepancy.candidates) {
    if (candidate.cause == "none" || candidate.cause == "unknown") continue;
    candidate.status = CandidateStatus::kNotIdentifiable;
    candidate.reason = "the input follows the output: the recording shows a controller, not the machine alone";
  }
}

}  // namespace

Result<MachineDiagnosis> diagnose_machine(std::span<const Recording> recordings, const MachineOptions& options) {
  if (const auto checked = check(recordings); !checked) return tl::unexpected(checked.error());
  MachineBudget budget{.block_samples = options.block_samples};
  double spread = 0;
  for (const Recording& recording : recordings) {
    const auto [low, high] = std::minmax_element(recording.output.values.begin(), recording.output.values.end());
    spread = std::max(spread, *high - *low);
  }
  const LoopSigns loop = loop_signs(recordings);
  const bool feedback = loop.is_regulated();
  const double allowed = std::max(0.01 * kDecimationShare * spread, pooled_noise(recordings, loop));
  MachineData first = searched_data(recordings, allowed, options.most_samples);
  MachineData whole = first.windows ? whole_records(recordings, first) : first;
  report_stage(options.report, 0, "trying every law of a machine");
  Look look(recordings, std::move(first), whole, loop, budget);
  if (holds_and_moves(recordings) && look.floors_left() > kNearFloors) {
    report_stage(options.report, kSearched / 3, "trying every law with the input taken otherwise between samples");
    MachineData other = machine_data(recordings, allowed, options.most_samples,
                                     look.data.interval_means ? InputBetween::kHeld : InputBetween::kStraight);
    MachineData other_whole = other.windows ? whole_records(recordings, other) : other;
    budget.block_samples = options.block_samples;
    Look otherwise(recordings, std::move(other), other_whole, loop, budget);
    if (kCloserBetween * otherwise.floors_left() < look.floors_left()) {
      look = std::move(otherwise);
      whole = std::move(other_whole);
    }
  }
  if (auto second_data = look.second_data(recordings, whole)) {
    report_stage(options.report, kSearched / 2, "looking again where the recordings are not explained");
    budget.block_samples = options.block_samples;
    Look second(recordings, std::move(*second_data), whole, loop, budget);
    if (second.is_borne_out(whole, budget)) look = std::move(second);
  }
  const MachineData& data = look.data;
  const MachineSearch& search = look.search;
  const double noise = look.noise, scale = data.output_scale;
  MachineVerdict verdict = std::move(look.verdict);
  std::optional<StickingLoop> sticking;
  std::optional<MachineScore> friction;
  if (feedback && !has_friction(verdict) && recordings.size() == 1) sticking = sticking_loop(recordings.front());
  if (sticking) friction = score_of(*sticking, data, search.ground, budget);
  if (friction) verdict = conclude_sticking(std::move(verdict), *friction, *sticking);
  std::optional<Extension> extension;
  if (verdict.winner) {
    report_stage(options.report, kSearched, "fitting what won to every sample");
    extension.emplace(friction ? unrefined(data, whole, *friction, budget)
                               : extend(data, whole, *verdict.winner, budget));
  }
  if (extension && !friction) {
    MachineScore refitted = *verdict.winner;
    refitted.fit = extension->fit;
    if (!has_effect(refitted, whole, search.ground)) verdict = conclude_without_effect(verdict, search, data);
  }

  MachineDiagnosis diagnosis;
  Discrepancy& discrepancy = diagnosis.discrepancy;
  discrepancy.conclusion = verdict.conclusion;
  discrepancy.findings = residual_findings(data, search.linear);
  discrepancy.candidates = verdict.candidates;
  for (Candidate& candidate : discrepancy.candidates) candidate.rmse_heldout *= scale;
  if (verdict.conclusion == Conclusion::kNone) {
    add_excluded_sizes(search, data, recordings.front(), discrepancy.candidates);
  }
  if (feedback && verdict.conclusion != Conclusion::kAmbiguous) say_feedback(discrepancy);
  DiscrepancyGain& gain = discrepancy.gain;
  gain.heldout = data.heldout;
  gain.rmse_baseline = held_out_rms(search.linear) * scale;
  gain.rmse_extended = gain.rmse_baseline;
  gain.rmse_black_box = black_box_held_out_rms(search) * scale;
  gain.noise_floor = noise;
  if (options.trace) diagnosis.trace = trace_of(search, data);
  if (!verdict.winner) return diagnosis;

  gain.rmse_extended = held_out_rms(*verdict.winner) * scale;
  measure_reduction(search.linear, *verdict.winner, gain);
  discrepancy.causes = causes_of(recordings, search, verdict, *extension);
  if (friction) tell_loop(*sticking, discrepancy.causes.front());
  diagnosis.extended_model = model_of(recordings, *extension, *verdict.winner);
  diagnosis.extended = runs_of(recordings, whole, extension->fit);
  if (verdict.conclusion == Conclusion::kAmbiguous) {
    discrepancy.next_test = settling_test(recordings, search, verdict, *extension, gain);
  }
  return diagnosis;
}

}  // namespace valvetriage
