#include "core/discrepancy/advise.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/discrepancy/settled.h"
#include "core/linear_algebra/solve.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/model/test_plan.h"
#include "core/recording/intersample.h"
#include "core/recording/segments.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostAlternatives = 8;
// Chance of settling the question that a second test after the first has to add to be worth its time.
constexpr double kWorthASecond = 0.1;
constexpr double kEqual = 0.01;      // tests whose worth differs by a smaller share are equal
constexpr double kBiasSamples = 20;  // samples over which a model's bias is one and the same
// What is simulated of a longer test is compared at every second, third... sample: a bound on memory, far above 200 Hz.
constexpr std::size_t kMostLooks = 20000;
// A freedom that the ones before it have taken up but for this share of its square is none.
constexpr double kTakenUp = 1e-14;

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

/// A test's input between its samples, made once for all that is simulated on it.
struct PlayedInput {
  PlayedInput(const Play& play, double sample_rate_hz, InputBetween between)
      : sample_period_s(1 / sample_rate_hz), samples(play.input.size()) {
    Recording recording;
    recording.sample_period_s = sample_period_s;
    recording.input.values = play.input;
    recording.segments = find_segments(play.input, sample_period_s);
    between_samples = input_between_samples(recording, between);
  }
  double sample_period_s;
  std::size_t samples;
  IntervalSignal between_samples;
};

std::optional<VectorXd> simulated(const Model& model, const PlayedInput& input) {
  const auto y = simulate_extended(model, input.between_samples, input.sample_period_s, {}, {});
  if (!y) return std::nullopt;
  return Eigen::Map<const VectorXd>(y->data(), static_cast<Index>(y->size()));
}

/// Columns of `Products`: those of the first alternative's output, which the others are measured from, and by
/// alternative its output's difference from that and how each of its moved models differs from it.
enum Shared : Index { kOnes, kOutput, kSlope, kSquare, kSharedColumns };
struct Columns {
  Index difference = 0, first_loose = 0, loose = 0;
};

std::vector<Columns> columns_of(std::span<const Alternative* const> alternatives) {
  std::vector<Columns> columns;
  Index next = kSharedColumns;
  for (const Alternative* alternative : alternatives) {
    const auto loose = static_cast<Index>(alternative->moved.size());
    columns.push_back({next, next + 1, loose});
    next += 1 + loose;
  }
  return columns;
}

/// Inner products of all that a test may show, over its samples: two tests one after the other show the sum.
struct Products {
  MatrixXd of;
  std::size_t samples = 0;
};

/// Empty where one of them cannot be simulated.
std::optional<Products> products_on(const Play& play, std::span<const Alternative* const> alternatives,
                                    std::span<const Columns> columns, const AdviceOptions& options) {
  const PlayedInput input(play, options.sample_rate_hz, alternatives.front()->model.input_between);
  const auto every = static_cast<Index>(1 + input.samples / kMostLooks);
  const Index looks = (static_cast<Index>(input.samples) + every - 1) / every;
  MatrixXd seen = MatrixXd::Zero(looks, columns.back().first_loose + columns.back().loose);
  const auto show = [&](Index column, const VectorXd& y) { seen.col(column) = y(Eigen::seqN(0, looks, every)); };
  VectorXd first;
  for (std::size_t a = 0; a < alternatives.size(); ++a) {
    const auto output = simulated(alternatives[a]->model, input);
    if (!output) return std::nullopt;
    if (a == 0) {
      first = *output;
      VectorXd slope = VectorXd::Zero(first.size());
      const Index inner = std::max<Index>(first.size() - 2, 0);
      slope.segment(std::min<Index>(1, first.size()), inner) = first.tail(inner) - first.head(inner);
      seen.col(kOnes).setOnes();
      show(kOutput, first);
      show(kSlope, slope);
      show(kSquare, first.array().square());
    }
    show(columns[a].difference, *output - first);
    for (Index k = 0; k < columns[a].loose; ++k) {
      const auto moved = simulated(alternatives[a]->moved[static_cast<std::size_t>(k)], input);
      if (moved) show(columns[a].first_loose + k, *moved - *output);
    }
  }
  MatrixXd of = MatrixXd::Zero(seen.cols(), seen.cols());
  of.selfadjointView<Eigen::Lower>().rankUpdate(seen.transpose(), static_cast<double>(every));
  return Products{of.selfadjointView<Eigen::Lower>(), input.samples};
}

/// The products of what is left of all columns beside one of them.
void take_out(Index column, double least, MatrixXd& products) {
  const double square = products(column, column);
  if (!(square > least)) return;
  const VectorXd with = products.col(column);
  products -= with * with.transpose() / square;
}

/// d of two alternatives by the matrix inversion lemma: σ² d² = Δᵀ Δ − Δᵀ G (σ² I + Gᵀ G)⁻¹ Gᵀ Δ. Where nothing is
/// known of how open one of them is, a refitted baseline takes up offset, gain, timing and curvature, whatever they
/// are.
double distance(const Products& products, const Columns& a, const Columns& b, double noise) {
  std::vector<Index> used{a.difference, b.difference};
  for (const Columns* each : {&a, &b}) {
    for (Index k = 0; k < each->loose; ++k) used.push_back(each->first_loose + k);
  }
  const bool is_unknown = a.loose == 0 || b.loose == 0;
  const auto of_both = static_cast<Index>(used.size());
  if (is_unknown) used.insert(used.end(), {kOnes, kOutput, kSlope, kSquare});
  MatrixXd of = products.of(used, used);
  of.row(0) -= of.row(1).eval();
  of.col(0) -= of.col(1).eval();
  const VectorXd squares = of.diagonal();
  for (Index k = of_both; k < of.rows(); ++k) take_out(k, kTakenUp * squares(k), of);
  const Index loose = a.loose + b.loose;
  MatrixXd inner = of.block(2, 2, loose, loose);
  inner.diagonal().array() += noise * noise;
  const VectorXd seen = of.col(0).segment(2, loose);
  const double left = of(0, 0) - seen.dot(solve_symmetric(inner, seen));
  return std::sqrt(std::max(left, 0.0)) / noise;
}

/// Chance that the true one reaches the settling posterior against a rival.
double beats(const PlayedTest& test, const Alternative& own, const Alternative& rival, const AdviceOptions& options) {
  const Settling asked = options.settling ? options.settling(own, rival, test) : Settling{};
  const double by_posterior =
      std::log(kSettledProbability / (1 - kSettledProbability) * rival.probability / own.probability);
  const double odds = std::max(by_posterior, asked.least_log_odds), d = test.distance;
  if (!std::isfinite(odds) || !std::isfinite(d)) return 0;
  if (d < 1e-9) return odds <= 0 ? 1 : 0;
  return normal_upper_tail((odds - 0.5 * d * d) / (d * std::sqrt(asked.noise_along)));
}

/// What one test is worth.
struct Worth {
  double expected = 0;  ///< chance that it settles the question
  double beaten = 0;    ///< chance that the true alternative beats a given rival
  double duration_s = 0;
  std::set<std::string> separated;    ///< single causes that it is likely to settle
  std::size_t first = 0, second = 1;  ///< the pair hardest to tell apart
  double least_distance = 0;

  /// By which tests are chosen: where none is likely to settle the question, the one that leaves the least of it open.
  double score() const { return expected >= kWorthAsking ? expected : kWorthAsking * beaten; }
};

/// The rivals of a question, and what each test shows of them.
class Question {
 public:
  Question(std::vector<const Alternative*> rivals, const AdviceOptions& options)
      : options_(options), rivals_(std::move(rivals)), all_(rivals_) {
    if (options.nothing) all_.push_back(&*options.nothing);
    columns_ = columns_of(all_);
    const double bias = options.bias_rms;
    noise_ = std::sqrt(options.noise_rms * options.noise_rms + kBiasSamples * bias * bias);
  }

  std::span<const Alternative* const> rivals() const { return rivals_; }
  std::optional<Products> products(const Play& play) const { return products_on(play, all_, columns_, options_); }

  Worth worth_of(const Products& products) const {
    const auto n = static_cast<Index>(rivals_.size());
    MatrixXd apart = MatrixXd::Zero(n, n);
    Worth worth{.duration_s = static_cast<double>(products.samples) / options_.sample_rate_hz,
                .least_distance = std::numeric_limits<double>::infinity()};
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < i; ++j) {
        apart(i, j) = apart(j, i) = distance(products, columns_of_rival(i), columns_of_rival(j), noise_);
        if (!(apart(i, j) < worth.least_distance)) continue;
        worth.least_distance = apart(i, j);
        worth.first = static_cast<std::size_t>(j);
        worth.second = static_cast<std::size_t>(i);
      }
    }
    double total = 0;
    for (Index i = 0; i < n; ++i) {
      const Alternative& own = rival(i);
      const auto [settled, beaten] = chances_of(i, apart.row(i), products);
      worth.expected += own.probability * settled;
      worth.beaten += own.probability * beaten;
      total += own.probability;
      if (settled >= 0.5) add_single_causes(own.cause, worth.separated);
    }
    worth.expected /= total;
    worth.beaten /= total;
    return worth;
  }

 private:
  struct Chances {
    double settled = 1;  ///< that all its rivals are beaten
    double beaten = 0;   ///< that a given one is
  };
  /// apart  the distance of the i-th from each
  Chances chances_of(Index i, const Eigen::RowVectorXd& apart, const Products& products) const {
    PlayedTest test{.samples = products.samples};
    if (options_.nothing) {
      const double from_nothing = distance(products, columns_of_rival(i), columns_.back(), noise_);
      test.removed = std::pow(from_nothing * noise_ / options_.noise_rms, 2);
    }
    Chances chances;
    for (Index j = 0; j < apart.size(); ++j) {
      if (j == i) continue;
      test.distance = apart(j);
      const double chance = beats(test, rival(i), rival(j), options_);
      chances.settled *= chance;
      chances.beaten += chance / static_cast<double>(apart.size() - 1);
    }
    return chances;
  }
  const Alternative& rival(Index i) const { return *rivals_[static_cast<std::size_t>(i)]; }
  const Columns& columns_of_rival(Index i) const { return columns_[static_cast<std::size_t>(i)]; }
  static void add_single_causes(const std::string& causes, std::set<std::string>& singles) {
    std::string cause;
    for (const char c : causes + "+") {
      if (c != '+') {
        cause += c;
        continue;
      }
      if (find_mechanism(cause)) singles.insert(cause);
      cause.clear();
    }
  }

  const AdviceOptions& options_;
  std::vector<const Alternative*> rivals_, all_;  ///< all: with none of them
  std::vector<Columns> columns_;
  double noise_ = 0;
};

/// A test, what it shows and what that is worth.
struct Asked {
  Play play;
  Products products;
  Worth worth;
};

/// The test that is asked for, and what another one is worth.
struct Chosen {
  Play play;
  Worth worth;
  std::string beside;
};

bool settles_all(const Worth& worth) {
  return worth.expected > 1 - kEqual;
}

/// Of what has a worth, in the order of the length, the one that is worth most, the shortest of equals; null for none.
template <typename Each>
const Each* best_of(const std::vector<Each>& each) {
  const Each* best = nullptr;
  for (const Each& one : each) {
    const double score = one.worth.score();
    if (std::isfinite(score) && (!best || score - best->worth.score() > kEqual * score)) best = &one;
  }
  return best;
}

/// One test after the other, in one recording.
Play joined(const Play& first, const Play& second) {
  Play both{fmt::format("{}, then {}", first.name, second.name), first.input};
  both.input.insert(both.input.end(), second.input.begin(), second.input.end());
  return both;
}

/// What each test of the repertoire is worth, the shortest first, up to one that no longer one can better; those that
/// cannot be simulated are left out.
std::vector<Asked> asked_each(const Question& question, std::vector<Play> plays) {
  std::stable_sort(plays.begin(), plays.end(),
                   [](const Play& a, const Play& b) { return a.input.size() < b.input.size(); });
  std::vector<Asked> each;
  for (Play& play : plays) {
    std::optional<Products> products = question.products(play);
    if (!products) continue;
    const Worth worth = question.worth_of(*products);
    each.push_back({std::move(play), std::move(*products), worth});
    if (settles_all(worth)) break;
  }
  return each;
}

std::string beside(const Asked& chosen, const std::vector<Asked>& each) {
  if (settles_all(chosen.worth)) return "no longer test settles more";
  double next = 0;
  for (const Asked& asked : each) {
    if (&asked != &chosen) next = std::max(next, asked.worth.expected);
  }
  return fmt::format("the next best test settles with probability {:.2f}", next);
}

/// The test, and another one after it where the two settle clearly more than the first alone.
Chosen with_a_second(const Asked& first, const std::vector<Asked>& each, const Question& question) {
  Chosen alone{first.play, first.worth, beside(first, each)};
  if (first.worth.expected > 1 - kWorthASecond) return alone;
  struct Second {
    const Play* play;
    Worth worth;  ///< of both
  };
  std::vector<Second> seconds;
  for (const Asked& second : each) {
    if (&second == &first) continue;
    const Products sum{first.products.of + second.products.of, first.products.samples + second.products.samples};
    seconds.push_back({&second.play, question.worth_of(sum)});
  }
  const Second* best = best_of(seconds);
  if (!best) return alone;
  // Chosen as if each began at rest; what is stated is of the one after the other.
  Play both = joined(first.play, *best->play);
  const std::optional<Products> products = question.products(both);
  if (!products) return alone;
  Worth worth = question.worth_of(*products);
  if (worth.expected < first.worth.expected + kWorthASecond) return alone;
  return {std::move(both), std::move(worth),
          fmt::format("its first part alone settles with probability {:.2f}", first.worth.expected)};
}

NextTest as_next_test(const Chosen& chosen, std::span<const Alternative* const> rivals, const AdviceOptions& options) {
  const auto& [play, worth, beside] = chosen;
  const bool is_current = rivals.front()->model.input_unit == "A";
  NextTest next;
  next.test = play.name;
  next.why = fmt::format(
      "On it {} and {}, the two hardest to tell apart, differ by {:.3g} times the noise, whatever the valve's own "
      "parameters turn out to be ({:.3g} s at {:g} Hz, noise {:.3g}{}); {}",
      rivals[worth.first]->cause, rivals[worth.second]->cause, worth.least_distance, worth.duration_s,
      options.sample_rate_hz, options.noise_rms, is_current ? " psi" : "", beside);
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
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<const Alternative*> rivals = most_probable(alternatives);
  if (rivals.size() < 2 || !(options.noise_rms > 0)) return unknown;
  const Question question(std::move(rivals), options);
  const auto products = question.products({.name = {}, .input = std::move(input)});
  return products ? question.worth_of(*products).expected : unknown;
}

std::optional<NextTest> advise_next_test(std::span<const Alternative> alternatives, const AdviceOptions& options) {
  std::vector<const Alternative*> rivals = most_probable(alternatives);
  if (rivals.size() < 2 || !(options.input_high > options.input_low) || !(options.noise_rms > 0)) return std::nullopt;
  const Question question(std::move(rivals), options);
  const std::vector<Asked> each = asked_each(question, repertoire(options, alternatives.front().model.input_unit));
  const Asked* best = best_of(each);
  if (!best || best->worth.beaten < kWorthAsking) return std::nullopt;
  return as_next_test(with_a_second(*best, each, question), question.rivals(), options);
}

}  // namespace valvetriage
