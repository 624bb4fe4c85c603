#include "core/analysis/analyze.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/analysis/classify_valve.h"
#include "core/analysis/folded_tones.h"
#include "core/analysis/known_tests.h"
#include "core/analysis/outside_reference.h"
#include "core/analysis/part_to_fit.h"
#include "core/discrepancy/machine.h"
#include "core/discrepancy/valve_diagnosis.h"
#include "core/identify/baseline.h"
#include "core/identify/knot_curve.h"
#include "core/identify/valve_fit.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/recording/intersample.h"
#include "core/residual/fit_figures.h"
#include "core/residual/noise_floor.h"
#include "core/residual/step_response.h"

namespace valvetriage {
namespace {

// Default window where neither a reference nor a rule base brings one.
constexpr double kSelfWindowRate_hz = 200.0;
constexpr double kSelfWindowDuration_s = 2.0;

/// Free runs that an analysis compares with: what `simulation` is about, and what Eq 20 is taken against.
struct FreeRuns {
  FreeRunsOf baseline;
  FreeRunsOf population;                  ///< of the reference's mean; else the same as the baseline
  FreeRunsOf extended;                    ///< empty where nothing was added
  std::vector<FreeRunsOf> without_cause;  ///< by cause of `extended`, the same without it
  bool unstable = false;
  std::string not_comparable;  ///< why nothing can be said against the reference; empty where something can
};

bool all_in_valve_units(std::span<const Recording> recordings) {
  return std::all_of(recordings.begin(), recordings.end(), [](const Recording& r) { return r.has_valve_units(); });
}

bool any_feedback(std::span<const Recording> recordings) {
  return std::any_of(recordings.begin(), recordings.end(), [](const Recording& r) {
    return std::any_of(r.quality.begin(), r.quality.end(), [](const QualityItem& q) { return q.code == "feedback"; });
  });
}

Result<Baseline> choose_baseline(std::span<const Recording> recordings, const AnalysisOptions& options) {
  const bool units = all_in_valve_units(recordings);
  if (options.baseline == BaselineKind::kReference || (!options.baseline && options.reference && units)) {
    if (!options.reference) return fail("no_reference", "the baseline 'reference' needs a reference");
    if (!units) {
      return fail("units", "a reference is in A and psi; these recordings are not, so the baseline can only be 'self'");
    }
    return Baseline{.kind = BaselineKind::kReference,
                    .reason = fmt::format("compared with {} good valves of type '{}'", options.reference->valves,
                                          options.reference->valve_type),
                    .reference = options.reference};
  }
  if (options.baseline == BaselineKind::kPaper) {
    return Baseline{.kind = BaselineKind::kPaper, .reason = "the linear model of the paper was asked for"};
  }
  std::string reason = "asked for";
  if (!options.baseline) {
    reason = options.reference ? "the recordings are not in A and psi, so the reference does not apply"
                               : "no reference of good valves was given, so the recording is compared with its own fit";
  }
  return Baseline{.kind = BaselineKind::kSelf, .reason = reason};
}

ValvePrior prior_of(const Reference& reference) {
  const auto parameters = static_cast<Eigen::Index>(reference.parameters.size());
  const auto& knots = reference.model.map->output;
  const auto p = parameters + static_cast<Eigen::Index>(knots.size());
  ValvePrior prior{.mean = Eigen::VectorXd(p)};
  for (Eigen::Index j = 0; j < parameters; ++j) prior.mean(j) = reference.parameters[static_cast<std::size_t>(j)].mean;
  prior.mean.tail(p - parameters) = Eigen::Map<const Eigen::VectorXd>(knots.data(), p - parameters);
  return population_prior(prior.mean, Eigen::Map<const Eigen::MatrixXd>(reference.covariance.data(), p, p),
                          reference.valves);
}

/// Samples whose input the reference never saw take no part in the fit and are reported.
Recording within_reference(const Recording& recording, const Reference& reference, std::size_t& outside) {
  Recording kept = recording;
  outside = 0;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    const double u = recording.input.values[i];
    if (!outside_reference(reference, u)) continue;
    if (kept.valid.empty()) kept.valid.assign(recording.samples(), 1);
    kept.valid[i] = 0;
    ++outside;
  }
  return kept;
}

QualityItem outside_item(const Recording& recording, const Reference& reference, std::size_t count) {
  if (count == recording.samples()) {
    return {"outside_reference", outside_throughout(std::span(&recording, 1), reference), count};
  }
  return {"outside_reference",
          fmt::format("the input leaves the reference's range of {:.3f} to {:.3f} A; those samples are left out of "
                      "verdict and naming",
                      reference.input_min, reference.input_max),
          count};
}

// Shares of the time of an analysis.
constexpr double kFitted = 0.1, kDiagnosed = 0.95;
// Time constants until what a gap hid is forgotten: e⁻⁵ of it is left, below the noise.
constexpr double kMemories = 5;
// Less than this within the reference says nothing about a valve, nor does less than the memory that the rest has left.
constexpr double kLeastCompared_s = 1;

QualityItem lost_input_item(std::size_t count) {
  return {
      "gap",
      "the input is lost in gaps where it steps or turns; the samples until the output has forgotten it are left out "
      "of the fit and of naming",
      count};
}

/// A reference carries the parameters of the model that learned it; another engine's are of no use here.
Result<void> require_current(const Reference& reference) {
  const auto parameters = reference.parameters.size();
  if (reference.model.volume && reference.model.map && parameters == kValveParameters.size()) return {};
  return fail(
      "reference_outdated",
      fmt::format("the reference of '{}' was learned by another version of the engine ({} parameters, here {}); "
                  "learn it again from its recordings",
                  reference.valve_type, parameters, kValveParameters.size()));
}

/// What the simulation gets wrong, into the analysis; the extended model's free runs into `runs` where there is one.
/// `fit` becomes the baseline that was compared in the end.
Result<void> diagnose(std::span<const Recording> recordings, const PartToFit& part, ValveFit& fit,
                      const ValveFitOptions& options, const Reference& reference, const StageReport& report,
                      Analysis& analysis, FreeRuns& runs) {
  ValveDiagnosis diagnosis = diagnose_valve(part.recordings, fit,
                                            {.fit = options,
                                             .good_valves = reference.valves,
                                             .causes = reference.causes,
                                             .leftovers = reference.leftovers,
                                             .report = report});
  analysis.discrepancy = std::move(diagnosis.discrepancy);
  // Of another test it is not known what good valves leave there: with it in the session nothing would be taken off.
  if (analysis.baseline.on_known_tests) analysis.discrepancy->next_test.reset();
  analysis.baseline.model = std::move(diagnosis.baseline_model);
  fit.simulated = std::move(diagnosis.baseline);
  analysis.extended_model = std::move(diagnosis.extended_model);
  if (analysis.discrepancy->causes.empty()) return {};
  auto extended = on_all_samples(part, std::move(diagnosis.extended), analysis.extended_model, recordings);
  if (!extended) return tl::unexpected(extended.error());
  runs.extended = std::move(*extended);
  const std::size_t causes = diagnosis.without_cause.size();
  for (std::size_t c = 0; c < causes; ++c) {
    Model model = analysis.extended_model;  // what was found comes last among its mechanisms
    model.mechanisms.erase(model.mechanisms.end() - static_cast<std::ptrdiff_t>(causes - c));
    auto without = on_all_samples(part, std::move(diagnosis.without_cause[c]), model, recordings);
    if (!without) return tl::unexpected(without.error());
    runs.without_cause.push_back(std::move(*without));
  }
  unfold_tones(recordings, part, runs.without_cause, analysis.discrepancy->causes, analysis.extended_model,
               runs.extended);
  return {};
}

std::string part_words(std::span<const Recording> given, const PartToFit& part) {
  const auto samples = [](std::span<const Recording> recordings) {
    std::size_t sum = 0;
    for (const Recording& recording : recordings) sum += recording.samples();
    return sum;
  };
  return fmt::format("; fit and search for causes took {} of the {} samples", samples(part.recordings), samples(given));
}

/// Whether pressures move about as far as good valves' do on these inputs: what is left of those in psi says nothing of
/// a reading in another unit.
bool reads_as_good_valves(std::span<const Recording> recordings, const Reference& reference) {
  constexpr double kMostTimes = 3;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double input_low = kInfinity, input_high = -kInfinity, low = kInfinity, high = -kInfinity;
  for (const Recording& recording : recordings) {
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (!recording.is_valid(i)) continue;
      input_low = std::min(input_low, recording.input.values[i]);
      input_high = std::max(input_high, recording.input.values[i]);
      low = std::min(low, recording.output.values[i]);
      high = std::max(high, recording.output.values[i]);
    }
  }
  if (!(high > low)) return false;
  const double usual = (*reference.model.map)(input_high) - (*reference.model.map)(input_low);
  return high - low < kMostTimes * usual && usual < kMostTimes * (high - low);
}

void put_back_into_all(std::span<const std::vector<double>> common, FreeRuns& runs) {
  const auto put_back_into = [&](FreeRunsOf& simulated) {
    if (simulated.empty()) return;
    for (std::size_t r = 0; r < common.size(); ++r) put_back(common[r], simulated[r]);
  };
  put_back_into(runs.baseline);
  put_back_into(runs.extended);
  for (auto& without : runs.without_cause) put_back_into(without);
}

Result<FreeRuns> run_reference(std::span<const Recording> recordings, const StageReport& report, Analysis& analysis) {
  const Reference& reference = *analysis.baseline.reference;
  if (const auto current = require_current(reference); !current) return tl::unexpected(current.error());
  const ValveParameters usual{.volume = *reference.model.volume, .mode = reference.model.mode};
  const double memory_s = kMemories * usual.lag_behind_map_s();
  std::vector<Recording> kept;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    std::size_t outside = 0;
    kept.push_back(within_reference(recordings[r], reference, outside));
    if (outside > 0) analysis.recordings[r].quality.push_back(outside_item(recordings[r], reference, outside));
    const std::size_t lost = leave_out_lost_input(kept.back(), memory_s);
    if (lost > 0) analysis.recordings[r].quality.push_back(lost_input_item(lost));
  }
  std::vector<std::vector<double>> common;
  const Reference* compared = &reference;
  for (const OnKnownTests& known : reference.on_known_tests) {
    if (!require_current(known.reference) || !reads_as_good_valves(kept, reference)) continue;
    auto left = all_left_in_common(kept, known.tests);
    if (!left) continue;
    common = std::move(*left);
    for (std::size_t r = 0; r < kept.size(); ++r) take_off(common[r], kept[r]);
    compared = &known.reference;
    analysis.baseline.on_known_tests = true;
    analysis.baseline.reason += "; what the simulations of all of them leave in these tests is taken off";
  }
  const PartToFit part = part_to_fit(kept, compared->sample_period_s);
  if (!part.is_whole) analysis.baseline.reason += part_words(recordings, part);
  ValveFitOptions options;
  options.knots = compared->model.map->input;
  options.reference_psi = compared->model.volume->reference_psi;
  options.prior = prior_of(*compared);
  options.usual = usual_mechanisms(compared->model);
  auto fit = fit_valve(part.recordings, options);
  if (!fit) return tl::unexpected(fit.error());
  analysis.baseline.model =
      to_model(fit->parameters, KnotCurve(options.knots).rising_through(fit->map.output), options.usual);

  FreeRuns runs;
  runs.not_comparable = not_comparable(recordings, kept, reference, std::max(kLeastCompared_s, memory_s));
  // A reference learned without the engine's survey of its valves has no scale to name a cause by, and samples that the
  // reference cannot be compared with are no sign of a good valve.
  if (!compared->causes.empty() && runs.not_comparable.empty()) {
    const StageReport told = report_part(report, kFitted, kDiagnosed);
    const auto diagnosed = diagnose(kept, part, *fit, options, *compared, told, analysis, runs);
    if (!diagnosed) return tl::unexpected(diagnosed.error());
  }
  auto baseline = on_all_samples(part, std::move(fit->simulated), analysis.baseline.model, recordings);
  if (!baseline) return tl::unexpected(baseline.error());
  runs.baseline = std::move(*baseline);
  put_back_into_all(common, runs);
  for (const Recording& recording : recordings) {
    auto population = simulate_extended(reference.model, recording, InitialState{});
    if (!population) return tl::unexpected(population.error());
    runs.population.push_back(std::move(*population));
  }
  return runs;
}

/// What a linear machine can be fitted to: at least one sample must be valid.
std::vector<Recording> with_valid_samples(std::span<const Recording> recordings) {
  std::vector<Recording> measured;
  for (const Recording& recording : recordings) {
    if (recording.valid_samples() > 0) measured.push_back(recording);
  }
  return measured;
}

/// The free runs of those with valid samples, and of the others what the model makes of their inputs.
Result<std::vector<std::vector<double>>> runs_of_all(std::vector<std::vector<double>> runs, const Model& model,
                                                     std::span<const Recording> recordings) {
  std::vector<std::vector<double>> all;
  auto next = runs.begin();
  for (const Recording& recording : recordings) {
    if (recording.valid_samples() > 0) {
      all.push_back(std::move(*next++));
      continue;
    }
    auto run = simulate_extended(model, recording, InitialState{});
    if (!run) return tl::unexpected(run.error());
    all.push_back(std::move(*run));
  }
  return all;
}

/// measured  those of them with valid samples
Result<FreeRuns> run_fitted(std::span<const Recording> recordings, std::span<const Recording> measured,
                            Analysis& analysis) {
  auto fitted =
      analysis.baseline.kind == BaselineKind::kPaper ? fit_paper_baseline(measured) : fit_self_baseline(measured);
  if (!fitted) return tl::unexpected(fitted.error());
  analysis.baseline.model = fitted->model;
  FreeRuns runs;
  if (fitted->simulated.empty()) {
    runs.unstable = true;
    return runs;
  }
  auto baseline = runs_of_all(std::move(fitted->simulated), fitted->model, recordings);
  if (!baseline) return tl::unexpected(baseline.error());
  runs.baseline = std::move(*baseline);
  runs.population = runs.baseline;
  return runs;
}

Simulation figures_of(std::span<const Recording> recordings, const FreeRuns& runs) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  Simulation simulation{.rmse = kUnknown, .fit_percent = kUnknown};
  std::vector<double> measured, simulated;
  std::vector<std::uint8_t> valid;
  double noise_squares = 0, samples = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Recording& recording = recordings[r];
    RecordingFigures figures{
        .name = recording.name, .rmse = kUnknown, .fit_percent = kUnknown, .noise_floor = noise_floor(recording).rms};
    if (recording.valid_samples() == 0) {
      simulation.per_recording.push_back(std::move(figures));
      continue;
    }
    const auto counted = static_cast<double>(recording.valid_samples());
    noise_squares += figures.noise_floor * figures.noise_floor * counted;
    samples += counted;
    if (!runs.unstable) {
      const FitFigures fit = fit_figures(recording.output.values, runs.baseline[r], recording.valid);
      figures.rmse = fit.rmse;
      figures.fit_percent = fit.fit_percent;
      measured.insert(measured.end(), recording.output.values.begin(), recording.output.values.end());
      simulated.insert(simulated.end(), runs.baseline[r].begin(), runs.baseline[r].end());
      for (std::size_t i = 0; i < recording.samples(); ++i) valid.push_back(recording.is_valid(i) ? 1 : 0);
    }
    simulation.per_recording.push_back(std::move(figures));
  }
  simulation.noise_floor = std::sqrt(noise_squares / samples);
  if (!runs.unstable) {
    const FitFigures fit = fit_figures(measured, simulated, valid);
    simulation.rmse = fit.rmse;
    simulation.fit_percent = fit.fit_percent;
  }
  return simulation;
}

Eq20Window window_for(const Baseline& baseline, const AnalysisOptions& options) {
  if (options.rule_base && holds_for_recordings(*options.rule_base)) {
    return {options.rule_base->window->rate_hz, options.rule_base->window->duration_s};
  }
  if (baseline.reference) return baseline.reference->window;
  return {kSelfWindowRate_hz, kSelfWindowDuration_s};
}

/// Several steps to one level become one figure: errors as root mean square, the others as means.
class LevelAverage {
 public:
  LevelAverage(double level, double scale) : level_(rounded_level(level, scale)), scale_(scale) {}
  bool is_at(double level) const { return is_same_level(level, level_, scale_); }

  void add(const LevelFigures& step) {
    const auto square = [](std::optional<double> v) { return v ? std::optional(*v * *v) : v; };
    error_.add(square(step.error_eq20));
    own_.add(square(step.error_eq20_own));
    settling_.add(step.settling_error);
    rise_.add(step.rise_time_s);
  }

  LevelFigures figures() const {
    const auto root = [](std::optional<double> v) { return v ? std::optional(std::sqrt(*v)) : v; };
    return {level_, root(error_.mean()), root(own_.mean()), settling_.mean(), rise_.mean(), {}};
  }

 private:
  struct Mean {
    double sum = 0;
    int n = 0;
    void add(std::optional<double> v) {
      if (!v) return;
      sum += *v;
      ++n;
    }
    std::optional<double> mean() const { return n > 0 ? std::optional(sum / n) : std::nullopt; }
  };
  double level_, scale_;
  Mean error_, own_, settling_, rise_;
};

bool outside(const Baseline& baseline, double level) {
  return baseline.reference && outside_reference(*baseline.reference, level);
}

/// Of the currents that tell one level from another: the reference's, without one that of the largest current. A step
/// test alone need not move a valve over the range that it has.
double current_scale_of(std::span<const Recording> recordings, const Baseline& baseline) {
  if (baseline.reference) return usual_mechanisms(baseline.reference->model).current_scale;
  if (!all_in_valve_units(recordings)) return 1;
  InputSpan span{.low_a = 0, .high_a = 0};
  span.widen(recordings);
  return span.high_a > span.low_a ? span.current_scale() : 1;
}

/// Whether a quality item says of a recording that its gauge shows one value throughout.
bool says_one_value(const QualityItem& item, const Recording& recording) {
  return item.code == "stuck" && item.count == recording.samples();
}

bool shows_one_value(const Recording& recording) {
  return std::ranges::any_of(recording.quality,
                             [&](const QualityItem& item) { return says_one_value(item, recording); });
}

/// Where the gauge is dead while that of other recordings of the valve has noise, no sample says anything about the
/// valve: none is valid. Where all of them show one value, a valve that does not follow looks the same.
std::vector<Recording> without_dead_gauges(std::span<const Recording> recordings) {
  std::vector<Recording> live(recordings.begin(), recordings.end());
  const bool any_live = std::ranges::any_of(
      live, [](const Recording& recording) { return !shows_one_value(recording) && noise_floor(recording).rms > 0; });
  if (!any_live) return live;
  for (Recording& recording : live) {
    if (!shows_one_value(recording)) continue;
    recording.valid.assign(recording.samples(), 0);
    for (QualityItem& item : recording.quality) {
      if (!says_one_value(item, recording)) continue;
      item.detail = fmt::format(
          "{} is exactly {:.6g} {} throughout, while the gauge of other recordings has noise: gauge or cable was dead, "
          "the recording is left out of verdict and naming",
          recording.output.quantity, recording.output.values.front(), recording.output.unit);
    }
  }
  return live;
}

std::vector<LevelFigures> figures_by_level(std::span<const Recording> recordings, const FreeRuns& runs,
                                           const Baseline& baseline, const Eq20Window& window) {
  std::vector<LevelAverage> levels;
  const double scale = current_scale_of(recordings, baseline);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Recording& recording = recordings[r];
    if (recording.valid_samples() == 0) continue;
    const auto steps = rising_steps(recording, r);
    if (steps.empty()) continue;
    const double noise = noise_floor(recording).rms;
    for (const StepWindow& step : steps) {
      if (outside(baseline, step.level)) continue;
      LevelFigures figures{.level_a = step.level};
      if (!runs.unstable) {
        figures.error_eq20 = error_eq20(recording, runs.population[r], step, window);
        figures.error_eq20_own = error_eq20(recording, runs.baseline[r], step, window);
        figures.settling_error = settling_error(recording, runs.population[r], step, window);
      }
      figures.rise_time_s = measured_rise_time_s(recording, step, window, noise);
      auto known = std::find_if(levels.begin(), levels.end(), [&](const auto& l) { return l.is_at(step.level); });
      if (known == levels.end()) known = levels.emplace(levels.end(), step.level, scale);
      known->add(figures);
    }
  }
  std::vector<LevelFigures> by_level;
  for (const LevelAverage& level : levels) by_level.push_back(level.figures());
  std::sort(by_level.begin(), by_level.end(), [](const auto& a, const auto& b) { return a.level_a < b.level_a; });
  return by_level;
}

void add_bandwidths(std::span<const FrequencyResult> results, std::vector<LevelFigures>& by_level) {
  for (LevelFigures& level : by_level) level.bandwidth_hz = bandwidth_at(results, level.level_a);
}

/// The recordings with other outputs.
std::vector<Recording> with_outputs(std::span<const Recording> recordings, FreeRunsOf outputs) {
  std::vector<Recording> changed(recordings.begin(), recordings.end());
  for (std::size_t r = 0; r < changed.size(); ++r) changed[r].output.values = std::move(outputs[r]);
  return changed;
}

/// Eq 20 between the extended model and the same without one cause, by level: the part of the error that it makes.
void add_errors_caused(std::span<const Recording> recordings, const FreeRuns& runs, const Eq20Window& window,
                       Analysis& analysis) {
  if (runs.without_cause.empty()) return;
  const std::vector<Recording> extended = with_outputs(recordings, runs.extended);
  for (std::size_t c = 0; c < runs.without_cause.size(); ++c) {
    const FreeRuns without{.baseline = runs.without_cause[c], .population = runs.without_cause[c]};
    auto& caused = analysis.discrepancy->causes[c].error_eq20_caused;
    for (const LevelFigures& level : figures_by_level(extended, without, analysis.baseline, window)) {
      if (level.error_eq20) caused[fmt::format("{:g}", level.level_a)] = *level.error_eq20;
    }
  }
}

/// The recordings as they would be without what the stand did to them; empty where no cause of the stand is settled.
std::vector<Recording> without_stand(std::span<const Recording> recordings, const FreeRuns& runs,
                                     const Analysis& analysis) {
  if (!analysis.discrepancy || analysis.discrepancy->conclusion == Conclusion::kUnexplained) return {};
  FreeRunsOf outputs;
  for (const Recording& recording : recordings) outputs.push_back(recording.output.values);
  bool any = false;
  for (std::size_t c = 0; c < runs.without_cause.size(); ++c) {
    const NamedCause& cause = analysis.discrepancy->causes[c];
    if (cause.origin != "stand" || !cause.alternatives.empty()) continue;
    any = true;
    for (std::size_t r = 0; r < outputs.size(); ++r) {
      for (std::size_t i = 0; i < outputs[r].size(); ++i) {
        outputs[r][i] -= runs.extended[r][i] - runs.without_cause[c][r][i];
      }
    }
  }
  if (!any) return {};
  return with_outputs(recordings, std::move(outputs));
}

/// What the linear machine gets wrong on its own recordings. Recordings that allow no diagnosis (an output that never
/// changes, different sample times) have none; the rest of the analysis stands.
///
/// measured  those of them with valid samples
void diagnose_self(std::span<const Recording> recordings, std::span<const Recording> measured,
                   const StageReport& report, Analysis& analysis) {
  auto diagnosis = diagnose_machine(measured, {.report = report_part(report, kFitted, 1)});
  if (!diagnosis) return;
  analysis.discrepancy = std::move(diagnosis->discrepancy);
  if (diagnosis->extended.empty()) return;
  auto extended = runs_of_all(std::move(diagnosis->extended), diagnosis->extended_model, recordings);
  if (!extended) return;
  analysis.extended_model = std::move(diagnosis->extended_model);
  analysis.extended = std::move(*extended);
}

}  // namespace

Result<Analysis> analyze(std::span<const Recording> given, const AnalysisOptions& options) {
  if (given.empty()) return fail("no_recordings", "there is nothing to analyse: no recording was given");
  const std::vector<Recording> recordings = without_dead_gauges(given);
  Analysis analysis;
  for (const Recording& recording : recordings) {
    analysis.recordings.push_back({.name = recording.name,
                                   .samples = recording.samples(),
                                   .sample_rate_hz = recording.sample_rate_hz(),
                                   .test = recording.test,
                                   .quality = recording.quality});
  }
  auto baseline = choose_baseline(recordings, options);
  if (!baseline) return tl::unexpected(baseline.error());
  analysis.baseline = std::move(*baseline);

  const bool is_compared = analysis.baseline.kind == BaselineKind::kReference;
  report_stage(options.report, 0, is_compared ? "fitting the valve" : "fitting a linear machine");
  const std::vector<Recording> measured = is_compared ? std::vector<Recording>{} : with_valid_samples(recordings);
  auto runs =
      is_compared ? run_reference(recordings, options.report, analysis) : run_fitted(recordings, measured, analysis);
  if (!runs) return tl::unexpected(runs.error());
  if (is_compared) report_stage(options.report, kDiagnosed, "judging the levels");
  analysis.simulation = figures_of(recordings, *runs);
  analysis.simulation.window = window_for(analysis.baseline, options);
  if (all_in_valve_units(recordings)) {
    analysis.simulation.by_level = figures_by_level(recordings, *runs, analysis.baseline, analysis.simulation.window);
  }
  analysis.frequency_response = analyze_frequency(recordings);
  analysis.simulation.cross_domain_rmse = cross_domain_rmse(recordings, analysis.frequency_response);
  add_bandwidths(analysis.frequency_response, analysis.simulation.by_level);
  const auto classified = [&](std::span<const LevelFigures> by_level) {
    return classify_valve({.by_level = by_level,
                           .baseline = analysis.baseline.kind,
                           .valve_units = all_in_valve_units(recordings),
                           .feedback = any_feedback(recordings),
                           .unstable = runs->unstable,
                           .not_comparable = runs->not_comparable},
                          options.rule_base);
  };
  analysis.classification = classified(analysis.simulation.by_level);
  analysis.classification.without_stand_causes = analysis.classification.verdict;
  if (all_in_valve_units(recordings)) {
    add_errors_caused(recordings, *runs, analysis.simulation.window, analysis);
    const std::vector<Recording> valve_alone = without_stand(recordings, *runs, analysis);
    if (!valve_alone.empty()) {
      auto by_level = figures_by_level(valve_alone, *runs, analysis.baseline, analysis.simulation.window);
      add_bandwidths(analysis.frequency_response, by_level);
      ClassificationResult& result = analysis.classification;
      result.without_stand_causes = classified(by_level).verdict;
      // What the stand does is no fault of the valve: it is mended, and the valve is tested again.
      const bool is_stands_fault = result.without_stand_causes == to_string(Verdict::kGood);
      if (result.action == "reject" && is_stands_fault) result.action = "retest";
    }
  }
  analysis.simulated = std::move(runs->baseline);
  analysis.extended = std::move(runs->extended);
  if (!is_compared) diagnose_self(recordings, measured, options.report, analysis);
  if (analysis.extended.empty()) analysis.extended_model = analysis.baseline.model;
  return analysis;
}

}  // namespace valvetriage
