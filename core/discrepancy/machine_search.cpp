#include "core/discrepancy/machine_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/identify/order.h"
#include "core/model/section_cascade.h"

namespace valvetriage {
namespace {

constexpr int kLargestOrder = 6;
constexpr std::size_t kOrderRows = 2000;
constexpr int kFirstIterations = 2;
constexpr int kScreenIterations = 5;
constexpr int kMiddleIterations = 12;
constexpr int kFinalIterations = 40;
constexpr int kFoldIterations = 8;
constexpr int kStartIterations = 8;
constexpr std::size_t kFinalists = 9;   // explanations that are held out
constexpr std::size_t kKeptFirst = 6;
constexpr std::size_t kKeptStarts = 2;  // of each explanation, after screening
constexpr std::size_t kPairBases = 2;
constexpr double kPairBaseGain = 1.08;    // a single that gains less is no base for a pair
constexpr double kPairScreenGain = 0.97;  // a pair that fits no better than its base is not held out
constexpr double kRounding = 1e-9;        // of the output's deviation: what an exact model leaves

/// The linear machine with given poles; numerator and offset are linear and found at once.
LinearMachine linear_machine(int order, std::span<const std::complex<double>> poles, int dead_samples, double gain,
                             const MachineData& data) {
  LinearMachine machine{.order = order, .fit = {}};
  MachineBlock block;
  std::size_t longest = 2;
  for (const MachineRecord& record : data.records) longest = std::max(longest, record.input.size());
  if (order > 0) block.sections = sections_from_poles(poles, SectionLimits(longest));
  block.numerator.assign(static_cast<std::size_t>(order) + 1, 0.0);
  block.numerator[0] = gain;
  block.delay_samples = dead_samples;
  MachineBlock offset;
  offset.law = MachineLaw::kAffine;
  offset.parameters = {1, 0};
  machine.fit.machine = {.sample_period_s = data.period_s, .interval_means = false, .blocks = {block, offset}};
  machine.fit.free = free_dynamics(block, 0);
  machine.fit.free.push_back({1, MachineField::kParameter, 1, false, -1e3, 1e3});
  return machine;
}

/// Runs the fit's folds: refitted without the judged rows, judged on them.
void hold_out(const MachineData& data, MachineScore& score, MachineBudget& budget) {
  score.log_rms.clear();
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
      double squares = 0;
      for (const std::size_t t : group.rows) squares += std::pow(data.records[group.record].output[t] - run[t], 2);
      const double mean = squares / static_cast<double>(group.rows.size());
      score.log_rms.push_back(std::isfinite(mean) ? 0.5 * std::log(mean + kRounding * kRounding) : 20);
    }
  }
  score.mean = std::accumulate(score.log_rms.begin(), score.log_rms.end(), 0.0) /
               static_cast<double>(std::max<std::size_t>(score.log_rms.size(), 1));
  score.held_out = true;
}

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
  narrow(data, kMiddleIterations, 1, fits, budget);
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

/// The best place of each cause goes first; finalists are refined to the end and held out.
void judge_finalists(const MachineData& data, std::vector<MachineScore>& scores, MachineBudget& budget) {
  std::stable_sort(scores.begin(), scores.end(),
                   [](const auto& a, const auto& b) { return a.fit.rms() < b.fit.rms(); });
  std::size_t judged = 0;
  for (MachineScore& score : scores) {
    if (judged == kFinalists || score.fit.failed || budget.spent()) break;
    refine_machine(data, data.all_rows(), kFinalIterations, score.fit, budget);
    hold_out(data, score, budget);
    ++judged;
  }
  sort_by_score(scores);
}

double log_factorial(std::size_t n) {
  return std::lgamma(static_cast<double>(n) + 1);
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

}  // namespace

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

double sign_test(const std::vector<double>& better, const std::vector<double>& worse) {
  const std::size_t n = std::min(better.size(), worse.size());
  if (n == 0) return 1;
  std::size_t wins = 0;
  for (std::size_t i = 0; i < n; ++i) wins += better[i] < worse[i] ? 1 : 0;
  // P(at least so many heads of n), one by one.
  double tail = 0;
  for (std::size_t k = wins; k <= n; ++k) {
    tail +=
        std::exp(log_factorial(n) - log_factorial(k) - log_factorial(n - k) - static_cast<double>(n) * std::log(2.0));
  }
  return std::min(1.0, 2 * tail);
}

MachineScore search_linear(const MachineData& data, MachineGround& ground, MachineBudget& budget) {
  std::vector<Recording> recordings;
  for (const MachineRecord& record : data.records) recordings.push_back(as_recording(record, data.period_s));
  std::vector<const Recording*> pointers;
  for (const Recording& recording : recordings) pointers.push_back(&recording);
  OrderOptions options;
  options.offsets = OffsetSharing::kShared;
  options.largest_order = kLargestOrder;
  options.max_rows = kOrderRows;
  const auto choice = ground.one_rate ? Result<OrderChoice>(fail("one_rate", "")) : choose_order(pointers, options);
  if (choice) ground.dead_samples = dead_time_samples(choice->structure);
  if (!choice) {
    ground.linear.push_back(linear_machine(0, {}, 0, 1, data));
  }
  OutputErrorOptions fit_options;
  fit_options.offsets = OffsetSharing::kShared;
  fit_options.max_iterations = 15;
  fit_options.max_search_rows = kOrderRows;
  for (int order = 1; choice && order <= kLargestOrder; ++order) {
    const auto fit = fit_output_error(pointers, {order, order, ground.dead_samples}, fit_options);
    if (!fit) break;
    ground.linear.push_back(
        linear_machine(order, fit->transfer_function.poles, ground.dead_samples, fit->static_gain, data));
  }
  if (ground.linear.empty()) ground.linear.push_back(linear_machine(0, {}, 0, 1, data));
  MachineScore best;
  for (LinearMachine& machine : ground.linear) {
    refine_machine(data, data.all_rows(), kMiddleIterations, machine.fit, budget);
    MachineScore score{.fit = machine.fit};
    hold_out(data, score, budget);
    if (best.held_out && score.mean > best.mean - 0.005) continue;
    best = std::move(score);
    ground.chosen_order = machine.order;
  }
  return best;
}

MachineSearch search_machines(const MachineData& data, MachineGround ground, MachineBudget& budget) {
  MachineSearch search;
  search.linear = search_linear(data, ground, budget);
  for (const MachineTrial& trial : single_trials(data, ground)) {
    if (budget.spent()) break;
    MachineScore score = screen(data, trial, budget);
    if (!score.fit.failed) search.scores.push_back(std::move(score));
  }
  judge_finalists(data, search.scores, budget);
  auto found = pairs(data, ground, search.linear, search.scores, budget);
  search.scores.insert(search.scores.end(), std::make_move_iterator(found.begin()),
                       std::make_move_iterator(found.end()));
  sort_by_score(search.scores);
  search.black_box_log_rms = black_box_log_rms(data, ground);
  search.black_box_rms =
      std::exp(std::accumulate(search.black_box_log_rms.begin(), search.black_box_log_rms.end(), 0.0) /
               static_cast<double>(std::max<std::size_t>(search.black_box_log_rms.size(), 1)));
  search.budget_spent = budget.spent();
  search.ground = std::move(ground);
  return search;
}

}  // namespace valvetriage
