#include "core/discrepancy/advise.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/linear_algebra/solve.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/model/test_plan.h"
#include "core/recording/segments.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostAlternatives = 8;
constexpr double kSettled = 0.95;  // posterior that the contract calls settled
// Chance of settling the question, or of beating a rival: below, no test of the repertoire is worth its time.
constexpr double kWorthAsking = 0.05;
constexpr double kEqual = 0.01;      // tests whose worth differs by a smaller share are equal
constexpr double kFree = 1e4;        // a freedom of the baseline: so many noise rms per sample that nothing is left
constexpr double kBiasSamples = 20;  // samples over which a model's bias is one and the same

/// One test of the repertoire.
struct Play {
  std::string name;
  std::vector<double> input;
};

/// The tests on a range, its levels as inputs: the plan's map is the identity. unit  of the input, for the names
std::vector<Play> repertoire(const AdviceOptions& options, const std::string& unit) {
  const double low = options.input_low, range = options.input_high - low;
  const StaticMap identity{.input = {low, low + range}, .output = {low, low + range}};
  const auto levels = [&](std::initializer_list<double> shares) {
    std::vector<double> list;
    for (const double share : shares) list.push_back(low + share * range);
    return list;
  };
  std::vector<Play> plays;
  const auto add = [&](std::string name, TestPlan plan) {
    plan.sample_rate_hz = options.sample_rate_hz;
    plan.to_hz = std::min(plan.to_hz, 0.1 * options.sample_rate_hz);
    if (auto input = plan_current(plan, identity)) plays.push_back({std::move(name), std::move(*input)});
  };
  const std::string suffix = unit.empty() ? "" : " " + unit;
  const auto span = [&](double from, double to) {
    return fmt::format("{:.3g} to {:.3g}{}", low + from * range, low + to * range, suffix);
  };
  add(fmt::format("steps from {:.3g}{} to five levels up to {:.3g}{}, 2 s each", low, suffix, low + range, suffix),
      {.test = PlannedTest::kStep, .levels_psi = levels({0.2, 0.4, 0.6, 0.8, 1}), .hold_s = 2});
  add(fmt::format("small steps from {:.3g}{}: 5, 10 and 15 % of the range, 2 s each", low, suffix),
      {.test = PlannedTest::kStep, .levels_psi = levels({0.05, 0.1, 0.15}), .hold_s = 2});
  add(fmt::format("staircase from {} and back in ten levels, 1 s each", span(0, 1)),
      {.test = PlannedTest::kStaircase,
       .levels_psi = levels({0, 0.11, 0.22, 0.33, 0.44, 0.56, 0.67, 0.78, 0.89, 1}),
       .hold_s = 1});
  add(fmt::format("staircase from {} and back in three levels, 8 s each", span(0.3, 1)),
      {.test = PlannedTest::kStaircase, .levels_psi = levels({0.3, 0.65, 1}), .hold_s = 8});
  for (const double duration_s : {3.0, 18.0, 40.0}) {
    add(fmt::format("triangle from {} and back in {:g} s", span(0, 1), duration_s),
        {.test = PlannedTest::kTriangle, .levels_psi = levels({0, 1}), .duration_s = duration_s});
  }
  add(fmt::format("triangle from {} and back in 10 s", span(0.45, 0.75)),
      {.test = PlannedTest::kTriangle, .levels_psi = levels({0.45, 0.75}), .duration_s = 10});
  for (const double half : {0.05, 0.15, 0.4}) {
    add(fmt::format("sweep of {}, 0.2 to 20 Hz in 20 s", span(0.55 - half, 0.55 + half)),
        {.test = PlannedTest::kSweep,
         .levels_psi = levels({0.55 - half, 0.55 + half}),
         .duration_s = 20,
         .from_hz = 0.2,
         .to_hz = 20});
  }
  add(fmt::format("multisine of {}, odd lines to 15 Hz, 20 s", span(0.25, 0.85)), {.test = PlannedTest::kMultisine,
                                                                                   .levels_psi = levels({0.25, 0.85}),
                                                                                   .duration_s = 20,
                                                                                   .from_hz = 0.1,
                                                                                   .to_hz = 15});
  return plays;
}

std::optional<VectorXd> simulated(Model model, const Play& play, const AdviceOptions& options) {
  std::erase_if(model.mechanisms, [](const MechanismUse& use) { return use.cause == "side_input"; });
  Recording recording;
  recording.sample_period_s = 1 / options.sample_rate_hz;
  recording.input.values = play.input;
  recording.segments = find_segments(play.input, recording.sample_period_s);
  const auto y = simulate_extended(model, recording, {});
  if (!y) return std::nullopt;
  return Eigen::Map<const VectorXd>(y->data(), static_cast<Index>(y->size()));
}

/// What a refitted baseline takes up where nothing is known of how open it is: offset, gain, timing, curvature; each as
/// large as a free parameter needs.
MatrixXd baseline_freedoms(const VectorXd& y, double noise) {
  MatrixXd columns(y.size(), 4);
  const VectorXd centred = y.array() - y.mean();
  columns.col(0).setOnes();
  columns.col(1) = centred;
  columns.col(2).setZero();
  for (Index i = 1; i + 1 < y.size(); ++i) columns(i, 2) = y(i + 1) - y(i - 1);
  columns.col(3) = centred.array().square();
  for (Index k = 0; k < columns.cols(); ++k) {
    const double norm = columns.col(k).norm();
    if (norm > 0) columns.col(k) *= kFree * noise / norm;
  }
  return columns;
}

/// An alternative on a test: its output, and by column what may still move.
struct Run {
  VectorXd output;
  MatrixXd loose;
};

std::optional<Run> run_of(const Alternative& alternative, const Play& play, const AdviceOptions& options) {
  const auto output = simulated(alternative.model, play, options);
  if (!output) return std::nullopt;
  Run run{*output, MatrixXd(output->size(), static_cast<Index>(alternative.moved.size()))};
  Index column = 0;
  for (const Model& moved : alternative.moved) {
    const auto there = simulated(moved, play, options);
    if (there) run.loose.col(column++) = *there - *output;
  }
  run.loose.conservativeResize(Eigen::NoChange, column);
  return run;
}

/// d of two runs by the matrix inversion lemma: σ² d² = Δᵀ Δ − Δᵀ G (σ² I + Gᵀ G)⁻¹ Gᵀ Δ.
double distance(const Run& a, const Run& b, double noise) {
  const VectorXd delta = a.output - b.output;
  const bool is_unknown = a.loose.cols() == 0 || b.loose.cols() == 0;
  const MatrixXd least = is_unknown ? baseline_freedoms(0.5 * (a.output + b.output), noise) : MatrixXd(delta.size(), 0);
  MatrixXd g(delta.size(), least.cols() + a.loose.cols() + b.loose.cols());
  g << least, a.loose, b.loose;
  MatrixXd inner = g.transpose() * g;
  inner.diagonal().array() += noise * noise;
  const VectorXd seen = g.transpose() * delta;
  const double squares = delta.squaredNorm() - seen.dot(solve_symmetric(inner, seen));
  return std::sqrt(std::max(squares, 0.0)) / noise;
}

double normal_below(double z) {
  return 0.5 * std::erfc(-z / std::sqrt(2.0));
}

/// Chance that the true one reaches the settling posterior against a rival.
double beats(double d, std::size_t samples, const Alternative& own, const Alternative& rival,
             const AdviceOptions& options) {
  const double asked = options.least_log_odds ? options.least_log_odds(own, rival, samples) : 0;
  const double odds = std::max(std::log(kSettled / (1 - kSettled) * rival.probability / own.probability), asked);
  if (!std::isfinite(odds)) return 0;
  if (d < 1e-9) return odds <= 0 ? 1 : 0;
  return normal_below((0.5 * d * d - odds) / d);
}

/// What one test is worth.
struct Worth {
  double expected = 0;  ///< chance that it settles the question
  double told = 0;      ///< chance that the true alternative beats a given rival
  double duration_s = 0;
  std::set<std::string> separated;    ///< single causes that it is likely to settle
  std::size_t first = 0, second = 1;  ///< the pair hardest to tell apart
  double least_distance = 0;

  /// By which tests are chosen: where none is likely to settle the question, the one that leaves the least of it open.
  double score() const { return expected >= kWorthAsking ? expected : kWorthAsking * told; }
};

std::optional<Worth> worth_of(std::span<const Alternative* const> rivals, const Play& play,
                              const AdviceOptions& options) {
  std::vector<Run> runs;
  for (const Alternative* rival : rivals) {
    auto run = run_of(*rival, play, options);
    if (!run) return std::nullopt;
    runs.push_back(std::move(*run));
  }
  const double variance = options.noise_rms * options.noise_rms + kBiasSamples * options.bias_rms * options.bias_rms;
  const double noise = std::sqrt(variance);
  MatrixXd d = MatrixXd::Zero(static_cast<Index>(runs.size()), static_cast<Index>(runs.size()));
  Worth worth{.duration_s = static_cast<double>(play.input.size()) / options.sample_rate_hz,
              .least_distance = std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i < runs.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const double apart = distance(runs[i], runs[j], noise);
      d(static_cast<Index>(i), static_cast<Index>(j)) = d(static_cast<Index>(j), static_cast<Index>(i)) = apart;
      if (apart < worth.least_distance) {
        worth.least_distance = apart;
        worth.first = j;
        worth.second = i;
      }
    }
  }
  double total = 0;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    double settled = 1, beaten = 0;
    for (std::size_t j = 0; j < runs.size(); ++j) {
      if (j == i) continue;
      const double apart = d(static_cast<Index>(i), static_cast<Index>(j));
      const double chance = beats(apart, play.input.size(), *rivals[i], *rivals[j], options);
      settled -= 1 - chance;
      beaten += chance;
    }
    settled = std::max(settled, 0.0);
    worth.expected += rivals[i]->probability * settled;
    worth.told += rivals[i]->probability * beaten / static_cast<double>(runs.size() - 1);
    total += rivals[i]->probability;
    if (settled < 0.5) continue;
    std::string cause;
    for (const char c : rivals[i]->cause + "+") {
      if (c != '+') {
        cause += c;
        continue;
      }
      if (find_mechanism(cause)) worth.separated.insert(cause);
      cause.clear();
    }
  }
  worth.expected /= total;
  worth.told /= total;
  return worth;
}

NextTest told(const Play& play, const Worth& worth, std::span<const Alternative* const> rivals, double second_best,
              const AdviceOptions& options) {
  const bool is_current = rivals.front()->model.input_unit == "A";
  NextTest next;
  next.test = play.name;
  next.why = fmt::format(
      "On it {} and {}, the two hardest to tell apart, differ by {:.3g} times the noise, whatever the valve's own "
      "parameters turn out to be ({:.3g} s at {:g} Hz, noise {:.3g}{}); the next best test settles with probability "
      "{:.2f}",
      rivals[worth.first]->cause, rivals[worth.second]->cause, worth.least_distance, worth.duration_s,
      options.sample_rate_hz, options.noise_rms, is_current ? " psi" : "", second_best);
  next.separates.assign(worth.separated.begin(), worth.separated.end());
  next.expected_probability = worth.expected;
  next.input_csv = plan_csv(play.input, options.sample_rate_hz, is_current);
  return next;
}

std::vector<const Alternative*> most_probable(std::span<const Alternative> alternatives) {
  std::vector<const Alternative*> rivals;
  for (const Alternative& alternative : alternatives) {
    if (alternative.probability > 0) rivals.push_back(&alternative);
  }
  std::stable_sort(rivals.begin(), rivals.end(),
                   [](const Alternative* a, const Alternative* b) { return a->probability > b->probability; });
  if (rivals.size() > kMostAlternatives) rivals.resize(kMostAlternatives);
  return rivals;
}

}  // namespace

double chance_to_settle(std::span<const Alternative> alternatives, std::vector<double> input,
                        const AdviceOptions& options) {
  const std::vector<const Alternative*> rivals = most_probable(alternatives);
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  if (rivals.size() < 2 || !(options.noise_rms > 0)) return unknown;
  const auto worth = worth_of(rivals, {.name = {}, .input = std::move(input)}, options);
  return worth ? worth->expected : unknown;
}

std::optional<NextTest> advise_next_test(std::span<const Alternative> alternatives, const AdviceOptions& options) {
  const std::vector<const Alternative*> rivals = most_probable(alternatives);
  if (rivals.size() < 2 || !(options.input_high > options.input_low) || !(options.noise_rms > 0)) return std::nullopt;

  const std::vector<Play> plays = repertoire(options, alternatives.front().model.input_unit);
  std::optional<Worth> best;
  const Play* chosen = nullptr;
  double second_best = 0;
  for (const Play& play : plays) {
    const auto worth = worth_of(rivals, play, options);
    if (!worth) continue;
    const double more = best ? worth->score() - best->score() : 1;
    const bool is_close = std::abs(more) <= kEqual * std::max(worth->score(), best ? best->score() : 0);
    const bool is_better = is_close ? worth->duration_s < best->duration_s : more > 0;
    second_best = std::max(second_best, is_better ? (best ? best->expected : 0) : worth->expected);
    if (!is_better) continue;
    best = worth;
    chosen = &play;
  }
  if (!best || best->told < kWorthAsking) return std::nullopt;
  return told(*chosen, *best, rivals, second_best, options);
}

}  // namespace valvetriage
