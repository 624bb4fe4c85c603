#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "tests/unit/mechanisms/example.h"

namespace valvetriage {
namespace {

using example::largest_gap;
using example::Sight;

std::vector<double> run(std::string_view cause, std::vector<double> parameters, std::vector<double> signal,
                        LawContext context = {}) {
  const std::vector<double> stamps = example::stamps();
  if (context.time_s.empty()) context.time_s = stamps;
  find_mechanism(cause)->apply(parameters, context, signal);
  return signal;
}

TEST(Laws, BeginInsideTheirBoundsAndWithAnEffect) {
  for (const Mechanism* law : all_mechanisms()) {
    SCOPED_TRACE(law->cause);
    MechanismScales scales = example::scales();
    if (law->cause == "rectified_sensor") scales.output_low = -100;
    const MechanismBounds bounds = law->bounds(scales);
    const std::size_t n = law->parameters.size();
    ASSERT_EQ(bounds.lower.size(), n);
    ASSERT_EQ(bounds.upper.size(), n);
    ASSERT_EQ(bounds.step.size(), n);
    EXPECT_GE(bounds.starts.size(), 1u);
    EXPECT_LE(bounds.starts.size(), 48u);
    for (const auto& start : bounds.starts) {
      ASSERT_EQ(start.size(), n);
      for (std::size_t j = 0; j < n; ++j) {
        EXPECT_GE(start[j], bounds.lower[j]);
        EXPECT_LE(start[j], bounds.upper[j]);
      }
      if (!law->apply) continue;
      Sight sight(*law);
      if (law->cause == "intermittent") sight.context.recording = static_cast<std::size_t>(start.back());
      EXPECT_GT(largest_gap(sight.behind(*law, start), sight.signal), 0) << "a start without effect";
    }
  }
}

TEST(Laws, BoundsAreSoundWhereNothingIsExcited) {
  MechanismScales nothing{.sample_period_s = 0.005, .longest_s = 10};
  for (const Mechanism* law : all_mechanisms()) {
    SCOPED_TRACE(law->cause);
    const MechanismBounds bounds = law->bounds(nothing);
    for (std::size_t j = 0; j < bounds.lower.size(); ++j) EXPECT_LE(bounds.lower[j], bounds.upper[j]);
  }
}

TEST(Laws, DoNothingWhereNeutral) {
  for (const Mechanism* law : all_mechanisms()) {
    if (!law->apply || law->parameters.empty()) continue;
    SCOPED_TRACE(law->cause);
    const Sight sight(*law);
    for (const auto& start : law->bounds(example::scales()).starts) {
      std::vector<double> parameters = example::neutral(*law, start);
      if (law->cause == "saturation") parameters[1] = -std::numeric_limits<double>::infinity();
      EXPECT_LT(largest_gap(sight.behind(*law, parameters), sight.signal), 1e-12 * 210);
    }
  }
}

TEST(Laws, GiveFiniteNumbersOverAllTheirBounds) {
  for (const Mechanism* law : all_mechanisms()) {
    if (!law->apply || law->parameters.empty()) continue;
    SCOPED_TRACE(law->cause);
    const Sight sight(*law);
    const MechanismBounds bounds = law->bounds(example::scales());
    for (const auto& corner : {bounds.lower, bounds.upper}) {
      for (const double y : sight.behind(*law, corner)) ASSERT_TRUE(std::isfinite(y));
    }
  }
}

/// The change of a slightly moved signal, against the tangent. A law with corners is right everywhere but at them.
TEST(Laws, TheirTangentIsTheDifferenceOfTwoRuns) {
  for (const Mechanism* law : all_mechanisms()) {
    if (!law->tangent) continue;
    SCOPED_TRACE(law->cause);
    const Sight sight(*law);
    MechanismScales scales = example::scales();
    if (law->cause == "rectified_sensor") scales.output_low = -100;
    for (const auto& start : law->bounds(scales).starts) {
      const double step = 1e-6 * (law->place == Place::kPosition ? 1 : 210);
      std::vector<double> change(sight.signal.size()), moved = sight.signal;
      for (std::size_t i = 0; i < change.size(); ++i) {
        change[i] = step * std::cos(0.05 * static_cast<double>(i));
        moved[i] += change[i];
      }
      const std::vector<double> base = sight.behind(*law, start);
      law->apply(start, sight.context, moved);
      law->tangent(start, sight.context, sight.signal, change);
      std::size_t wrong = 0;
      for (std::size_t i = 0; i < change.size(); ++i) {
        if (std::abs(moved[i] - base[i] - change[i]) > 1e-3 * step) ++wrong;
      }
      EXPECT_LE(wrong, change.size() / 200) << "at start " << start[0];
    }
  }
}

TEST(Laws, AreTheSameForEqualInput) {
  for (const Mechanism* law : all_mechanisms()) {
    if (!law->apply || law->parameters.empty()) continue;
    const Sight sight(*law);
    const auto start = law->bounds(example::scales()).starts.front();
    EXPECT_EQ(sight.behind(*law, start), sight.behind(*law, start));
  }
}

/// A signal and the same way taken at half the speed, straight between.
RC_GTEST_PROP(Laws, MemoryIsRateIndependent, (std::vector<std::int8_t> turns)) {
  std::vector<double> fast, slow;
  double last = 0;
  for (const int turn : turns) {
    const double at = turn / 100.0;
    fast.push_back(at);
    slow.push_back(0.5 * (last + at));
    slow.push_back(at);
    last = at;
  }
  RC_PRE(!fast.empty());
  fast.insert(fast.begin(), 0.0);
  slow.insert(slow.begin(), 0.0);
  const std::vector<double> quick = run("backlash", {0.3, 0}, fast), patient = run("backlash", {0.3, 0}, slow);
  for (std::size_t i = 0; i < quick.size(); ++i) RC_ASSERT(std::abs(quick[i] - patient[2 * i]) < 1e-12);
}

TEST(Laws, APlayFollowsHalfItsWidthBehind) {
  const auto z = run("backlash", {0.4, 0}, {0, 0.1, 1.0, 0.8, 0.5, 0.0});
  const std::vector<double> expected{0, 0, 0.8, 0.8, 0.7, 0.2};
  EXPECT_LT(largest_gap(z, expected), 1e-15);
}

TEST(Laws, APlayAndAFrictionThatGrowAlongTheInputAreAsWideAsTheyAreThere) {
  // 1 + 0.5 (x − 1) times as wide: half as wide at 0, one and a half times at 2.
  const LawContext context{.input_middle = 1};
  const std::vector<double> low{0, 0.2, 0}, high{2, 2.2, 2};
  EXPECT_NEAR(run("backlash", {0.2, 0.5}, low, context)[1], 0.2 - 0.1 * 0.6, 1e-12);
  EXPECT_NEAR(run("backlash", {0.2, 0.5}, high, context)[1], 2.2 - 0.1 * 1.6, 1e-12);
  EXPECT_NEAR(run("friction", {0.1, 0.05, 1, 0.5}, low, context)[1], 0.2 - 0.05 * 0.5, 1e-12);
  EXPECT_NEAR(run("friction", {0.1, 0.05, 1, 0.5}, high, context)[1], 2.2 - 0.05 * 1.5, 1e-12);
}

TEST(Laws, FrictionHoldsThenSlipsToTheKineticForce) {
  const auto x = run("friction", {0.3, 0.1, 1, 0}, {0, 0.2, 0.29, 0.31, 0.4, 0.0, -0.1});
  const std::vector<double> expected{0, 0, 0, 0.21, 0.21, 0.21, 0.0};
  EXPECT_LT(largest_gap(x, expected), 1e-15);
}

TEST(Laws, KineticAboveBreakawayCountsAsBreakaway) {
  const auto x = example::motion(1, 2, example::stamps());
  EXPECT_EQ(run("friction", {0.1, 0.9, 1, 0}, x), run("friction", {0.1, 0.1, 1, 0}, x));
}

TEST(Laws, NoiseOnAHoldDoesNotMoveAStuckSpool) {
  std::vector<double> driver(400, 1.5), x = driver;
  for (std::size_t i = 0; i < x.size(); ++i) x[i] += i % 2 == 0 ? 0.0005 : -0.0005;
  driver[0] = 1.4;  // arrived from below: the spool stays behind by the kinetic force
  LawContext context{.driver = driver};
  const auto held = run("friction", {0.02, 0.01, 1, 0}, x, context);
  EXPECT_NEAR(held.back(), x.back() - 0.01, 1e-12);
}

TEST(Laws, ADeadBandIsContinuousAndFlatInside) {
  const auto x = run("dead_band", {1.5, 0.2}, {1.0, 1.39, 1.41, 1.5, 1.59, 1.61, 2.0});
  const std::vector<double> expected{1.1, 1.49, 1.5, 1.5, 1.5, 1.51, 1.9};
  EXPECT_LT(largest_gap(x, expected), 1e-12);
}

TEST(Laws, SaturationClampsOnBothSidesAndLeavesTheRest) {
  LawContext context{.output_range = 200};
  const auto y = run("saturation", {150, 10, 0}, {-50, 0, 11, 80, 149, 151, 400}, context);
  const std::vector<double> expected{10, 10, 11, 80, 149, 150, 150};
  EXPECT_LT(largest_gap(y, expected), 1e-12);
}

TEST(Laws, ACurveVanishesAtBothEnds) {
  LawContext context{.output_range = 200};
  const auto y = run("static_curve", {0.4}, {0, 100, 200}, context);
  EXPECT_LT(largest_gap(y, {0, 120, 200}), 1e-12);
}

TEST(Laws, AnExtraLagTakesItsTimeConstant) {
  std::vector<double> step(100, 1.0);
  step[0] = 0;
  const auto y = run("extra_lag", {0.05, 0}, step);
  // The edge itself is a ramp of one sample, so the response is that of a step half a sample later.
  EXPECT_NEAR(y[11], 1 - std::exp(-(10.5 * example::kPeriod_s) / 0.05), 2e-3);
}

/// How far a law on a smooth signal, sampled `per_period` times as often as usual, ends from what it would do between
/// the samples; the largest over two seconds.
double error_between_samples(std::string_view cause, const std::vector<double>& parameters, int per_period) {
  constexpr int kFine = 64;
  const auto sampled = [&](int often) {
    std::vector<double> signal, stamps;
    for (int i = 0; i <= 400 * often; ++i) {
      const double t = example::kPeriod_s * i / often;
      stamps.push_back(t);
      // From rest, and nowhere straight.
      signal.push_back(100 * std::pow(std::sin(2 * std::numbers::pi * 3 * t), 3));
    }
    return run(cause, parameters, signal, LawContext{.time_s = stamps});
  };
  const auto coarse = sampled(per_period), fine = sampled(kFine);
  double largest = 0;
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    largest = std::max(largest, std::abs(coarse[i] - fine[i * static_cast<std::size_t>(kFine / per_period)]));
  }
  return largest;
}

TEST(Laws, FiltersFollowWhatBendsBetweenSamplesToThirdOrder) {
  for (const auto& [cause, parameters] : {std::pair<std::string_view, std::vector<double>>{"extra_lag", {0.03, 0}},
                                          {"extra_lag", {0.004, 0}},
                                          {"resonance", {20, 0.1}},
                                          {"resonance", {60, 0.05}},
                                          {"resonance", {5, 0.7}}}) {
    const double once = error_between_samples(cause, parameters, 1);
    EXPECT_LT(once, 0.3) << cause << parameters.front();
    EXPECT_LT(error_between_samples(cause, parameters, 2), once / 6) << cause << parameters.front();
  }
}

TEST(Laws, AResonanceRingsAtItsFrequencyAndSettlesAtOne) {
  std::vector<double> step(1500, 1.0);
  step[0] = 0;
  const auto y = run("resonance", {10, 0.05}, step);
  EXPECT_NEAR(y.back(), 1, 1e-6);
  const auto peak = std::max_element(y.begin(), y.end());
  EXPECT_NEAR(*peak, 1 + std::exp(-0.05 * std::numbers::pi / std::sqrt(1 - 0.05 * 0.05)),
              0.02);  // the peak lies between samples
  EXPECT_NEAR(static_cast<double>(peak - y.begin()) * example::kPeriod_s, 0.0525, 0.003);
}

TEST(Laws, ARateLimitMovesStraightAndArrives) {
  std::vector<double> step(100, 2.0);
  step[0] = 1.0;
  const auto x = run("rate_limit", {10}, step);
  for (std::size_t i = 1; i <= 20; ++i) EXPECT_NEAR(x[i], 1.0 + 0.05 * static_cast<double>(i), 1e-12);
  EXPECT_EQ(x[21], 2.0);
}

TEST(Laws, AStiffSpringObeysItsForce) {
  LawContext context{.rest_input = 1.0, .secant = 200};
  const double c = 0.3 / (200.0 * 200.0);
  const auto x = run("stiffening_spring", {c}, {1.0, 1.01, 1.5, 2.0}, context);
  for (const auto& [at, asked] : {std::pair{x[0], 1.0}, {x[1], 1.01}, {x[2], 1.5}, {x[3], 2.0}}) {
    const double z = 200 * (at - 1.0);
    EXPECT_NEAR(z + c * z * z * z, 200 * (asked - 1.0), 1e-9);
  }
}

TEST(Laws, HuntingLivesAroundItsLevelOnly) {
  std::vector<double> y(example::kSamples, 20.0);
  std::fill(y.begin() + 500, y.begin() + 1300, 120.0);
  LawContext context{.output_range = 210};
  const auto hunted = run("self_oscillation", {8, 2, 120, 60, 0, 20, 0}, y, context);
  const auto swing = [&](std::size_t from, std::size_t to) {
    double most = 0;
    for (std::size_t i = from; i < to; ++i) most = std::max(most, std::abs(hunted[i] - y[i]));
    return most;
  };
  EXPECT_EQ(swing(0, 500), 0);
  EXPECT_NEAR(swing(1000, 1300), 2, 0.05);
  EXPECT_LT(swing(1700, 2000), 0.02);
}

/// Noise of a gauge, standard deviation 1.
std::vector<double> noise(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> samples(example::kSamples);
  for (double& sample : samples) sample = normal(random);
  return samples;
}

double squares(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

TEST(Laws, HuntingTakesItsPhaseFromTheReadingAroundEachSample) {
  constexpr double kAmplitude = 1, kNoise = 0.5;
  const std::vector<double> level(example::kSamples, 120.0), loud = noise(3);
  std::vector<double> quiet = level, measured = level;
  for (std::size_t i = 0; i < level.size(); ++i) {
    // Half way through it begins anew, with another phase; it lives from the second sample on.
    const double phase = 2 * std::numbers::pi * 8 * example::kPeriod_s * static_cast<double>(i);
    quiet[i] += kAmplitude * std::cos(phase + (i < example::kSamples / 2 ? 0.4 : 2.6));
    measured[i] = quiet[i] + kNoise * loud[i];
  }
  const LawContext free{.output_range = 210};
  const LawContext followed{.output_range = 210, .measured = measured, .noise_rms = kNoise};
  const std::vector<double> parameters{8, kAmplitude, 120, 60, 0, 40, 0};
  const double there = squares(quiet, level);
  EXPECT_GT(squares(run("self_oscillation", parameters, level, free), quiet), there);
  // A phase from half a second to either side, a tenth of a second left out, errs by less than a fifth.
  EXPECT_LT(squares(run("self_oscillation", parameters, level, followed), quiet), 0.1 * there);
}

TEST(Laws, HuntingFollowsNoNoise) {
  const std::vector<double> level(example::kSamples, 120.0);
  for (const unsigned seed : {1u, 2u, 3u, 4u, 5u, 6u, 7u, 8u}) {
    for (const double amplitude : {0.05, 0.2, 0.8}) {
      std::vector<double> measured = noise(seed);
      for (double& value : measured) value += 120;
      const LawContext context{.output_range = 210, .measured = measured, .noise_rms = 1};
      const auto hunted = run("self_oscillation", {8, amplitude, 120, 60, 0, 40, 0}, level, context);
      // What comes of other samples lowers the squares of noise by chance alone: a normal deviate less its cost.
      EXPECT_LT(squares(measured, level) - squares(measured, hunted), 9) << seed << " " << amplitude;
    }
  }
}

TEST(Laws, DisturbancesAreLinearInSineAndCosine) {
  const auto quiet = std::vector<double>(example::kSamples, 0.0);
  const auto sine = run("periodic_disturbance", {7, 1, 0}, quiet);
  const auto cosine = run("periodic_disturbance", {7, 1, std::numbers::pi / 2}, quiet);
  const auto both = run("periodic_disturbance", {7, 2, 0.6}, quiet);
  for (std::size_t i = 0; i < both.size(); ++i) {
    EXPECT_NEAR(both[i], 2 * std::cos(0.6) * sine[i] + 2 * std::sin(0.6) * cosine[i], 1e-9);
  }
}

TEST(Laws, AWarmCoilHasLostItsGainInTheEnd) {
  const auto y = run("thermal_drift", {-0.2, 1.0, 0.5}, std::vector<double>(example::kSamples, 100.0));
  EXPECT_EQ(y[0], 100);
  EXPECT_NEAR(y[200], 100 * (1 - 0.2 * (1 - std::exp(-1.0))), 0.01);
  EXPECT_NEAR(y.back(), 80, 0.01);
}

TEST(Laws, ABrokenContactSpoilsOneRecordingFromItsInstantOn) {
  const std::vector<double> level(example::kSamples, 100.0);
  LawContext context{.recording = 1};
  EXPECT_EQ(run("intermittent", {3, -0.1, 0}, level, context), level);
  context.recording = 0;
  const auto y = run("intermittent", {3, -0.1, 0}, level, context);
  EXPECT_EQ(y[598], 100);
  EXPECT_NEAR(y[602], 90, 1e-12);
}

TEST(Laws, ASideChannelActsByItsDeviationFromItsReference) {
  LawContext context{.side = example::side()};
  const auto y = run("side_input", {1.5, 20, 0}, std::vector<double>(example::kSamples, 100.0), context);
  for (const std::size_t i : {0, 100, 300}) EXPECT_NEAR(y[i], 100 + 1.5 * (example::side()[0].values[i] - 20), 1e-9);
}

}  // namespace
}  // namespace valvetriage
