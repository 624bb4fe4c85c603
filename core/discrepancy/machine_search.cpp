#include "core/discrepancy/machine_search.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "core/discrepancy/machine_linear.h"
#include "core/identify/order.h"
#include "core/linear_algebra/solve.h"
#include "core/model/section_cascade.h"

namespace valvetriage {
namespace {

constexpr int kLargestOrder = 6;
constexpr int kFirstIterations = 2;
constexpr int kScreenIterations = 5;
constexpr int kMiddleIterations = 12;
constexpr int kFinalIterations = 40;
constexpr int kLastIterations = 300;  // of those that lead, where the valley is long and narrow
constexpr int kFoldIterations = 8;
constexpr int kStartIterations = 8;
constexpr std::size_t kFinalists = 9;  // explanations that are held out
constexpr std::size_t kKeptFirst = 6;
constexpr std::size_t kKeptStarts = 2;  // of each explanation, after screening
constexpr std::size_t kPairBases = 2;
constexpr double kPairBaseGain = 1.08;    // a single that gains less is no base for a pair
constexpr double kPairScreenGain = 0.97;  // a pair that fits no better than its base is not held out
constexpr double kRinging = 1.5;          // times the least damping that a record can tell
constexpr int kDelayTries = 6;
constexpr double kWorthADelay = 1e-3;     // of the squared error
constexpr double kWorthFinishing = 1e-3;  // of the squared error
constexpr double kWorthAnOrder = 0.005;   // of the held-out error
constexpr double kRounding = 1e-9;        // of the output's deviation: what an exact model leaves

/// Refines every fit so far and keeps the best of them.
void narrow(const MachineData& data, int iterations, std::size_t kept, std::vector<MachineFit>& fits,
            MachineBudget& budget) {
  const auto rows = data.all_rows();
  for (MachineFit& fit : fits) refine_machine(data, rows, iterations, fit, budget);
  std::erase_if(fits, [](const MachineFit& fit) { return fit.failed; });
  std::stable_sort(fits.begin(), fits.end(), [](const auto& a, const auto& b) { return a.squares < b.squares; });
  if (fits.size() > kept) fits.resize(kept);
}

/// The best fit of an explanation from all of its starts: many get a few steps, few get many.
MachineScore screen(const MachineData& data, const MachineTrial& trial, MachineBudget& budget) {
  std::vector<MachineFit> fits = trial.starts;
  narrow(data, kFirstIterations, kKeptFirst, fits, budget);
  narrow(data, kScreenIterations, kKeptStarts, fits, budget);
  if (!trial.last.empty()) {
    narrow(data, kFinalIterations, kKeptStarts, fits, budget);
    for (MachineFit& fit : fits) fit.free.insert(fit.free.end(), trial.last.begin(), trial.last.end());
  }
  narrow(data, kMiddleIterations, 1, fits, budget);
  if (!fits.empty()) move_instant(data, kMiddleIterations, fits.front(), budget);
  MachineScore score{.causes = trial.causes, .place = trial.place};
  score.fit.failed = true;
  if (!fits.empty()) score.fit = std::move(fits.front());
  return score;
}

void sort_by_score(std::vector<MachineScore>& scores) {
  std::stable_sort(scores.begin(), scores.end(), [](const MachineScore& a, const MachineScore& b) {
    if (a.held_out != b.held_out) return a.held_out;
    return a.held_out ? a.mean < b.mean : a.fit.rms() < b.fit.rms();
  });
}

/// The block that holds a fit's delay: dynamics, or a gain in front of a law that has the lag. A static core has none.
MachineBlock* delayed_block(MachineFit& fit) {
  const auto& blocks = fit.machine.blocks;
  const bool lags =
      std::any_of(blocks.begin(), blocks.end(), [](const auto& block) { return block.law == MachineLaw::kLag; });
  for (MachineBlock& block : fit.machine.blocks) {
    const bool dynamics = !block.sections.empty() || (lags && !block.numerator.empty());
    if (dynamics || block.law == MachineLaw::kMotion || block.law == MachineLaw::kTanks) return &block;
  }
  return nullptr;
}

/// A law's own delay. The linear machine's was found without the law, and what a law holds back looks like a delay.
void settle_delay(const MachineData& data, int least, MachineFit& fit, MachineBudget& budget) {
  if (!delayed_block(fit)) return;
  const auto try_delay = [&](int delay) {
    MachineFit trial = fit;
    delayed_block(trial)->delay_samples = delay;
    refine_machine(data, data.all_rows(), kMiddleIterations, trial, budget);
    if (trial.failed || !(trial.squares < fit.squares * (1 - kWorthADelay))) return false;
    fit = std::move(trial);
    return true;
  };
  const int first = delayed_block(fit)->delay_samples;
  for (const int far : {least, (least + first) / 2}) {
    if (first - far > 1) try_delay(far);
  }
  for (const int step : {-1, 1}) {
    int tries = 0;
    while (tries++ < kDelayTries && delayed_block(fit)->delay_samples + step >= least &&
           try_delay(delayed_block(fit)->delay_samples + step)) {
    }
  }
}

/// Those that a second cause is added to are fitted to the end first: what a fit still leaves on its way another law
/// would be credited with.
void finish_leaders(const MachineData& data, std::vector<MachineScore>& scores, MachineBudget& budget) {
  for (std::size_t i = 0; i < std::min(scores.size(), kPairBases) && scores[i].held_out && !budget.spent(); ++i) {
    const double before = scores[i].fit.squares;
    refine_machine(data, data.all_rows(), kLastIterations, scores[i].fit, budget);
    if (scores[i].fit.squares < before * (1 - kWorthFinishing)) hold_out(data, scores[i], budget);
  }
  sort_by_score(scores);
}

/// The best place of each cause goes first; finalists are refined to the end and held out.
void judge_finalists(const MachineData& data, int least_delay, std::vector<MachineScore>& scores,
                     MachineBudget& budget) {
  std::stable_sort(scores.begin(), scores.end(),
                   [](const auto& a, const auto& b) { return a.fit.rms() < b.fit.rms(); });
  std::size_t judged = 0;
  for (MachineScore& score : scores) {
    if (judged == kFinalists || score.fit.failed || budget.spent()) break;
    refine_machine(data, data.all_rows(), kFinalIterations, score.fit, budget);
    settle_delay(data, least_delay, score.fit, budget);
    hold_out(data, score, budget);
    ++judged;
  }
  sort_by_score(scores);
  finish_leaders(data, scores, budget);
}

bool same_family(const MachineScore& base, const std::string& cause) {
  return std::any_of(base.causes.begin(), base.causes.end(),
                     [&](const std::string& known) { return family_of(known) == family_of(cause); });
}

/// A second cause on top of each of the best singles.
std::vector<MachineScore> pairs(const MachineData& data, const MachineGround& ground, const MachineScore& linear,
                                const std::vector<MachineScore>& singles, MachineBudget& budget) {
  std::vector<MachineScore> found;
  std::size_t bases = 0;
  for (const MachineScore& base : singles) {
    if (bases == kPairBases || !base.held_out) break;
    if (base.mean > linear.mean - std::log(kPairBaseGain)) break;
    if (base.causes.size() > 1) continue;  // a third cause never paid
    ++bases;
    for (const SignalLaw& law : signal_laws(ground)) {
      if (same_family(base, law.cause)) continue;
      MachineTrial trial{base.causes, base.place + ", " + law.place, {}};
      trial.causes.push_back(law.cause);
      for (const auto& start : law.starts) trial.starts.push_back(with_law(base.fit, law, start));
      MachineScore score = screen(data, trial, budget);
      if (!score.fit.failed && score.fit.rms() < kPairScreenGain * base.fit.rms()) found.push_back(std::move(score));
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.fit.rms() < b.fit.rms(); });
  if (found.size() > 4) found.resize(4);
  for (MachineScore& score : found) {
    refine_machine(data, data.all_rows(), kFinalIterations, score.fit, budget);
    hold_out(data, score, budget);
  }
  return found;
}

/// Squares of a fit in which what rings for as long as a record can tell starts at rest.
double squares_without_ringing(const MachineData& data, MachineFit fit, MachineBudget& budget) {
  std::size_t longest = 2;
  for (const MachineRecord& record : data.records) longest = std::max(longest, record.input.size());
  const double least_e = SectionLimits(longest).least_e;
  std::size_t at = 0;
  bool rings = false;
  for (const Section& section : fit.machine.blocks[0].sections) {
    const bool ringing = section.order == 2 && section.e < kRinging * least_e && 4 * section.f > section.e * section.e;
    for (int state = 0; state < section.order; ++state, ++at) {
      if (!ringing) continue;
      for (auto& start : fit.starts) start[at] = 0;
      rings = true;
    }
  }
  if (rings) evaluate_machine(data, data.all_rows(), fit, budget);
  return fit.squares;
}

/// Whether a linear machine needs the ringing of its start to be closer than a lower order: a tone beside the input,
/// not an answer to it.
bool only_rings(const MachineData& data, const MachineScore& higher, const MachineScore& lower, MachineBudget& budget) {
  const double still = squares_without_ringing(data, higher.fit, budget);
  return still > higher.fit.squares * (1 + kWorthAnOrder) && !(still < lower.fit.squares);
}

/// Whether a higher order is closer on what was held out, also where slow wander counts once and not once per sample:
/// a slow mode that only its own start drives follows drift, gain steps and wander through the gaps of a record.
bool earns_its_order(const MachineScore& higher, const MachineScore& lower) {
  return higher.mean < lower.mean - kWorthAnOrder && compare_whitened(higher, lower).log_gain > kWorthAnOrder;
}

/// Linear machines of low order without the delay that the best of them seems to have.
void add_prompt(const MachineData& data, MachineGround& ground, MachineBudget& budget) {
  constexpr int kLowOrder = 2;
  for (int order = 1; order <= kLowOrder && ground.dead_samples > ground.least_delay + 1; ++order) {
    auto machine = identified_linear(data, order, ground.least_delay);
    if (!machine || !solve_linear(data, *machine)) return;
    refine_machine(data, data.all_rows(), kMiddleIterations, machine->fit, budget);
    if (!machine->fit.failed) ground.beside.push_back(std::move(*machine));
  }
}

/// Starts of an integrating motion, each with one more lag where the order is 2 and not 1; the better fit stays.
void try_integrating(const MachineData& data, MachineGround& ground, LinearMachine& machine, MachineBudget& budget) {
  std::vector<double> rates{0.5, 0.1, 0.03};  // of the second lag, per sample
  for (const double lag_samples : {1.0, 4.0}) {
    const auto equation = motion_equation(data, {.stiffness = false}, lag_samples);
    if (equation && equation->damping > 0) rates.push_back(-std::expm1(-equation->damping * data.period_s));
  }
  for (const double rate : rates) {
    // Two sections of order 1: a product of rates would hide the small one behind the other.
    std::vector<Section> sections{{.order = 1, .f = data.period_s / (10 * ground.longest_s)}};
    if (machine.order == 2) sections.push_back({.order = 1, .f = rate});
    LinearMachine start = linear_machine(std::move(sections), ground.dead_samples, 1, data);
    if (!solve_linear(data, start)) continue;
    refine_machine(data, data.all_rows(), kMiddleIterations, start.fit, budget);
    if (!start.fit.failed && start.fit.rms() < machine.fit.rms()) machine.fit = std::move(start.fit);
    if (machine.order == 1) break;
  }
}

/// The linear blocks of a fit, its laws left out.
Machine linear_blocks(const MachineFit& fit) {
  Machine core{.sample_period_s = fit.machine.sample_period_s};
  for (const MachineBlock& block : fit.machine.blocks) {
    if (block.law == MachineLaw::kMotion) {
      const double damping = block.parameters[4], stiffness = block.parameters[7] != 0 ? 0 : block.parameters[3];
      const double period = core.sample_period_s;
      const std::complex<double> root = std::sqrt(std::complex<double>(damping * damping / 4 - stiffness));
      std::vector<std::complex<double>> poles{std::exp(-period * (damping / 2 + root))};
      if (block.parameters[7] == 0) poles.push_back(std::exp(-period * (damping / 2 - root)));
      MachineBlock motion{.sections = sections_from_poles(poles, SectionLimits(1'000'000))};
      motion.numerator = {(block.parameters[0] + block.parameters[1]) / (stiffness > 0 ? stiffness : 1e-3)};
      motion.delay_samples = block.delay_samples;
      core.blocks.push_back(std::move(motion));
    } else if (!block.numerator.empty()) {
      core.blocks.push_back({.sections = block.sections, .numerator = block.numerator});
      core.blocks.back().delay_samples = block.delay_samples;
    }
  }
  return core;
}

/// The fit's linear core as one linear machine: its poles together, the numerator that gives the same run. Empty where
/// it has no dynamics or more than a linear machine may have.
std::optional<LinearMachine> linear_core(const MachineFit& fit, const MachineData& data) {
  const Machine core = linear_blocks(fit);
  std::vector<Section> sections;
  int delay = 0;
  for (const MachineBlock& block : core.blocks) {
    sections.insert(sections.end(), block.sections.begin(), block.sections.end());
    delay += block.delay_samples;
  }
  const int order = order_of(sections);
  if (order < 1 || order > kLargestOrder) return {};
  LinearMachine machine = linear_machine(std::move(sections), delay, 1, data);
  MachineBlock& block = machine.fit.machine.blocks[0];
  const std::vector<double>& input = data.records.front().input;
  const auto run = run_machine(core, {}, {}, input);
  const Eigen::MatrixXd basis = linear_basis(block, {}, input);
  const Eigen::VectorXd weights = least_squares(basis, Eigen::Map<const Eigen::VectorXd>(run.data(), basis.rows()));
  if (!weights.allFinite()) return {};
  block.numerator.assign(weights.begin(), weights.end());
  return machine;
}

/// A law must beat the best linear machine there is: the linear cores of the best explanations are machines that the
/// linear search may have missed.
void revise_linear(const MachineData& data, MachineSearch& search, MachineBudget& budget) {
  constexpr std::size_t kCores = 3;
  std::size_t tried = 0;
  for (const MachineScore& score : search.scores) {
    if (!score.held_out || tried == kCores || score.mean > search.linear.mean) break;
    auto core = linear_core(score.fit, data);
    if (!core) continue;
    ++tried;
    // The law that is left out took part of the offset and the start with it: they are solved for, too.
    LinearMachine solved = *core;
    const bool is_solved = solve_linear(data, solved);
    refine_machine(data, data.all_rows(), 2 * kFinalIterations, core->fit, budget);
    if (is_solved) {
      refine_machine(data, data.all_rows(), 2 * kFinalIterations, solved.fit, budget);
      if (core->fit.failed || solved.fit.squares < core->fit.squares) core = std::move(solved);
    }
    if (core->fit.failed || core->fit.rms() > search.linear.fit.rms() * 1.02) continue;
    MachineScore linear{.fit = core->fit};
    hold_out(data, linear, budget);
    if (!(linear.mean < search.linear.mean - 0.005)) continue;
    search.linear = std::move(linear);
    search.ground.chosen_order = core->order;
    std::erase_if(search.ground.linear, [&](const LinearMachine& known) { return known.order == core->order; });
    const auto at = std::find_if(search.ground.linear.begin(), search.ground.linear.end(),
                                 [&](const LinearMachine& known) { return known.order > core->order; });
    search.ground.linear.insert(at, std::move(*core));
  }
}

}  // namespace

void hold_out(const MachineData& data, MachineScore& score, MachineBudget& budget) {
  score.log_rms.clear();
  score.gaps.clear();
  for (const MachineFold& fold : data.folds) {
    MachineFit fit = score.fit;
    refine_machine(data, fold.fit, kFoldIterations, fit, budget);
    if (fold.whole_records) {
      MachineRows judged(data.records.size());
      for (const auto& group : fold.judged) {
        judged[group.record].insert(judged[group.record].end(), group.rows.begin(), group.rows.end());
      }
      refine_starts(data, judged, kStartIterations, fit, budget);
    }
    std::vector<std::vector<double>> runs(data.records.size());
    for (const auto& group : fold.judged) {
      auto& run = runs[group.record];
      if (run.empty()) run = run_record(data, group.record, fit);
      std::vector<double> gaps;
      double squares = 0;
      for (const std::size_t t : group.rows) {
        gaps.push_back(data.records[group.record].output[t] - run[t]);
        squares += gaps.back() * gaps.back();
      }
      score.gaps.push_back(std::move(gaps));
      const double mean = squares / static_cast<double>(group.rows.size());
      score.log_rms.push_back(std::isfinite(mean) ? 0.5 * std::log(mean + kRounding * kRounding) : 20);
    }
  }
  score.mean = std::accumulate(score.log_rms.begin(), score.log_rms.end(), 0.0) /
               static_cast<double>(std::max<std::size_t>(score.log_rms.size(), 1));
  score.held_out = true;
}

double MachineScore::rms() const {
  return std::exp(mean);
}

std::string MachineScore::name() const {
  if (causes.empty()) return "none";
  std::vector<std::string> sorted = causes;
  std::sort(sorted.begin(), sorted.end());
  std::string name = sorted.front();
  for (std::size_t i = 1; i < sorted.size(); ++i) name += "+" + sorted[i];
  return name;
}

MachineScore search_linear(const MachineData& data, MachineGround& ground, MachineBudget& budget) {
  std::vector<Recording> recordings;
  for (const MachineRecord& record : data.records) recordings.push_back(as_recording(record, data.period_s));
  std::vector<const Recording*> pointers;
  for (const Recording& recording : recordings) pointers.push_back(&recording);
  OrderOptions options;
  options.offsets = OffsetSharing::kShared;
  options.largest_order = kLargestOrder;
  options.max_rows = kLinearRows;
  const auto choice = ground.one_rate ? Result<OrderChoice>(fail("one_rate", "")) : choose_order(pointers, options);
  if (choice) ground.dead_samples = std::max(ground.least_delay, dead_time_samples(choice->structure));
  if (!choice) {
    ground.linear.push_back(linear_machine(0, {}, 0, 1, data));
  }
  for (int order = 1; choice && order <= kLargestOrder; ++order) {
    auto machine = identified_linear(data, order, ground.dead_samples);
    if (!machine) break;
    ground.linear.push_back(std::move(*machine));
  }
  if (ground.linear.empty()) ground.linear.push_back(linear_machine(0, {}, 0, 1, data));
  MachineScore best;
  ground.beside.clear();
  if (choice) add_prompt(data, ground, budget);
  for (LinearMachine& machine : ground.linear) {
    if (choice) solve_linear(data, machine);
    refine_machine(data, data.all_rows(), kMiddleIterations, machine.fit, budget);
    if (choice && machine.order <= 2) {
      const LinearMachine plain = machine;
      try_integrating(data, ground, machine, budget);
      if (machine.fit.squares < plain.fit.squares) ground.beside.push_back(plain);
    }
    MachineScore score{.fit = machine.fit};
    hold_out(data, score, budget);
    if (best.held_out && (!earns_its_order(score, best) || only_rings(data, score, best, budget))) continue;
    best = std::move(score);
    ground.chosen_order = machine.order;
  }
  return best;
}

void prefer_lags(const MachineData& data, MachineSearch& search, MachineBudget& budget) {
  constexpr double kClearlyCloser = 1.2;
  MachineGround moving = search.ground;
  moving.one_rate = false;
  moving.linear.clear();
  MachineScore lags = search_linear(data, moving, budget);
  const double margin = std::log(kClearlyCloser);
  const bool closest = std::all_of(search.scores.begin(), search.scores.end(), [&](const MachineScore& score) {
    return !score.held_out || score.mean > lags.mean + margin;
  });
  // The black box has lags of its own: it need not be farther, only not closer.
  if (!closest || !(search.linear.mean > lags.mean + margin)) return;
  if (!(std::log(search.black_box_rms) > lags.mean - margin)) return;
  search.linear = std::move(lags);
  search.ground.chosen_order = moving.chosen_order;
  search.ground.dead_samples = moving.dead_samples;
  search.ground.linear = std::move(moving.linear);
}

MachineSearch search_machines(const MachineData& data, MachineGround ground, MachineBudget& budget) {
  MachineSearch search;
  search.linear = search_linear(data, ground, budget);
  ground.tones_hz = residual_tones(data, search.linear.fit);
  if (ground.single_recording) ground.gain_steps = gain_steps(data, search.linear.fit, ground.output_zero);
  for (const MachineTrial& trial : single_trials(data, ground)) {
    if (budget.spent()) break;
    MachineScore score = screen(data, trial, budget);
    if (!score.fit.failed) search.scores.push_back(std::move(score));
  }
  judge_finalists(data, ground.least_delay, search.scores, budget);
  search.ground = std::move(ground);
  revise_linear(data, search, budget);
  auto found = pairs(data, search.ground, search.linear, search.scores, budget);
  search.scores.insert(search.scores.end(), std::make_move_iterator(found.begin()),
                       std::make_move_iterator(found.end()));
  sort_by_score(search.scores);
  search.black_box_log_rms = black_box_log_rms(data, search.ground);
  search.black_box_rms =
      std::exp(std::accumulate(search.black_box_log_rms.begin(), search.black_box_log_rms.end(), 0.0) /
               static_cast<double>(std::max<std::size_t>(search.black_box_log_rms.size(), 1)));
  if (search.ground.one_rate) prefer_lags(data, search, budget);
  search.budget_spent = budget.spent();
  return search;
}

}  // namespace valvetriage
