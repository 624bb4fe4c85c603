#include "core/model/linear_filter.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/unit/model/half_way.h"
#include "tests/unit/model/random_models.h"

namespace valvetriage {
namespace {

using test::kPeriod_s;

std::vector<double> noise(unsigned seed, std::size_t n) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> values(n);
  for (double& v : values) v = normal(random);
  return values;
}

std::vector<double> run(const LinearFilter& filter, FilterState state, const std::vector<double>& input,
                        const std::vector<double>& end) {
  std::vector<double> y(input.size());
  filter.run(state, input, end, y);
  return y;
}

// Linear between samples.
std::vector<double> run(const LinearFilter& filter, const FilterState& state, const std::vector<double>& input) {
  std::vector<double> end(input.begin() + 1, input.end());
  end.push_back(input.back());
  return run(filter, state, input, end);
}

std::vector<double> from_rest(const LinearFilter& filter, const std::vector<double>& input) {
  return run(filter, filter.rest(), input);
}

double largest(const std::vector<double>& v) {
  double m = 0;
  for (double x : v) m = std::max(m, std::abs(x));
  return m;
}

RC_GTEST_PROP(LinearFilter, EqualsTheDifferenceEquationOfItsCoefficients, ()) {
  const auto order = *rc::gen::inRange(1, 5);
  TransferFunction g = *discretise_zoh(random_continuous(*rc::gen::arbitrary<unsigned>(), order), 0.05);
  g.delay_s = *rc::gen::inRange(0, 5) * g.sample_time_s;
  const auto c = *to_coefficients(g);
  const auto u = noise(1, 300);
  std::vector<double> wanted(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) {
    double y = 0;
    for (std::size_t i = 0; i < c.b.size(); ++i) {
      if (t >= i + c.delay_samples) y += c.b[i] * u[t - i - c.delay_samples];
    }
    for (std::size_t j = 1; j < c.a.size() && j <= t; ++j) y -= c.a[j] * wanted[t - j];
    wanted[t] = y;
  }
  const auto y = from_rest(*LinearFilter::recursion(g), u);
  // The expanded polynomial is the inaccurate one of the two: order 4 at 20 Hz loses about six digits.
  for (std::size_t t = 0; t < u.size(); ++t) RC_ASSERT(std::abs(y[t] - wanted[t]) < 1e-8 * largest(wanted));
}

RC_GTEST_PROP(LinearFilter, IsLinear, ()) {
  const auto filter =
      *LinearFilter::sampled(random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 12)), kPeriod_s);
  const auto u = noise(1, 200), v = noise(2, 200);
  std::vector<double> mixed(u.size());
  for (std::size_t i = 0; i < u.size(); ++i) mixed[i] = 2 * u[i] - 3 * v[i];
  const auto yu = from_rest(filter, u), yv = from_rest(filter, v), y = from_rest(filter, mixed);
  for (std::size_t i = 0; i < u.size(); ++i) RC_ASSERT(std::abs(y[i] - (2 * yu[i] - 3 * yv[i])) < 1e-10 * 94);
}

RC_GTEST_PROP(LinearFilter, DoesNotDependOnWhenTheInputComes, ()) {
  TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 10));
  g.delay_s = *rc::gen::inRange(0, 40) * 0.1 * kPeriod_s;
  const auto filter = *LinearFilter::sampled(g, kPeriod_s);
  const auto shift = *rc::gen::inRange<std::size_t>(1, 20);
  auto u = noise(3, 150);
  u[0] = 0;
  std::vector<double> later(shift, 0.0);
  later.insert(later.end(), u.begin(), u.end());
  const auto y = from_rest(filter, u), moved = from_rest(filter, later);
  for (std::size_t i = 0; i < u.size(); ++i) RC_ASSERT(std::abs(y[i] - moved[i + shift]) < 1e-10 * 94);
}

RC_GTEST_PROP(LinearFilter, SettlesAtTheStaticGain, ()) {
  TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 12));
  g.delay_s = *rc::gen::inRange(0, 30) * 0.1 * kPeriod_s;
  const auto filter = *LinearFilter::sampled(g, kPeriod_s);
  const std::vector<double> u(50, 1.7);
  const auto y = run(filter, *filter.steady(1.7), u);
  // Nine poles with a gap of 0.005 or more to z = 1, each known to 1e-16.
  for (double value : y) RC_ASSERT(std::abs(value / (1.7 * 94) - 1) < 1e-11);
}

TEST(LinearFilter, HasNoEquilibriumWithAPoleAtOne) {
  EXPECT_FALSE(LinearFilter::sampled({.domain = Domain::kS, .poles = {0}}, 1)->steady(1));
}

RC_GTEST_PROP(LinearFilter, RunsALinearInputAsTheTriangleEquivalentDoes, ()) {
  TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 6));
  g.delay_s = *rc::gen::inRange(0, 30) * 0.1 * kPeriod_s;
  auto u = noise(4, 200);
  u[0] = 0;
  const auto wanted = from_rest(*LinearFilter::recursion(*discretise_foh(g, kPeriod_s)), u);
  const auto y = from_rest(*LinearFilter::sampled(g, kPeriod_s), u);
  for (std::size_t i = 0; i < u.size(); ++i) RC_ASSERT(std::abs(y[i] - wanted[i]) < 1e-8 * 94);
}

RC_GTEST_PROP(LinearFilter, RunsAHeldInputAsTheHoldEquivalentDoes, ()) {
  TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 6));
  g.delay_s = *rc::gen::inRange(0, 30) * 0.1 * kPeriod_s;
  const auto u = noise(5, 200);
  const auto wanted = from_rest(*LinearFilter::recursion(*discretise_zoh(g, kPeriod_s)), u);
  const auto filter = *LinearFilter::sampled(g, kPeriod_s);
  const auto y = run(filter, filter.rest(), u, u);
  for (std::size_t i = 0; i < u.size(); ++i) RC_ASSERT(std::abs(y[i] - wanted[i]) < 1e-8 * 94);
}

TEST(LinearFilter, FollowsARampExactly) {
  // 1/(τ s + 1) on u = t from rest: y = t − τ (1 − e^{−t/τ}), behind a delay of 1.4 samples
  const double tau = 0.03, delay_s = 1.4 * kPeriod_s;
  const auto filter = *LinearFilter::sampled(
      {.domain = Domain::kS, .poles = {-1 / tau}, .gain = 1 / tau, .delay_s = delay_s}, kPeriod_s);
  std::vector<double> u(100);
  for (std::size_t i = 0; i < u.size(); ++i) u[i] = static_cast<double>(i) * kPeriod_s;
  const auto y = from_rest(filter, u);
  for (std::size_t i = 0; i < u.size(); ++i) {
    const double t = std::max(0.0, u[i] - delay_s);
    EXPECT_NEAR(y[i], t - tau * (1 - std::exp(-t / tau)), 1e-14);
  }
}

TEST(LinearFilter, HoldsAtAJumpAndIsLinearElsewhere) {
  // An integrator sums areas: 0, a ramp to 1 (half a sample), a jump to 3 (held at 1: one sample), then 3.
  const auto filter = *LinearFilter::sampled({.domain = Domain::kS, .poles = {0}}, 1);
  const auto y = run(filter, filter.rest(), {0, 1, 3, 3}, {1, 1, 3, 3});
  EXPECT_NEAR(y[1], 0.5, 1e-15);
  EXPECT_NEAR(y[2], 1.5, 1e-15);
  EXPECT_NEAR(y[3], 4.5, 1e-15);
}

TEST(LinearFilter, StaysAccurateAtOrderNineWithPolesOfOneCluster) {
  // Nine equal lags sampled at 10 kHz, poles at 0.9995: expanded coefficients hold no digit of (1 − p)⁹ = 2e-30.
  const double corner = 5, period_s = 1e-4;
  TransferFunction g{
      .domain = Domain::kS, .poles = std::vector<std::complex<double>>(9, -corner), .gain = std::pow(corner, 9)};
  const auto filter = *LinearFilter::sampled(g, period_s);
  const std::vector<double> u(60'000, 1.0);
  const auto y = run(filter, filter.rest(), u, u);
  for (std::size_t i = 0; i < u.size(); i += 997) {
    // Step response of nine lags: 1 − e^{−x} Σ_{k<9} x^k / k!
    const double x = corner * period_s * static_cast<double>(i);
    double term = 1, sum = 0;
    for (int k = 0; k < 9; ++k) {
      sum += term;
      term *= x / (k + 1);
    }
    // 60,000 roundings of 1e-16 with a memory of 2,000 samples.
    EXPECT_NEAR(y[i], 1 - std::exp(-x) * sum, 1e-11);
  }
}

TEST(LinearFilter, RefusesADelayThatIsNoWholeNumberOfSamples) {
  const TransferFunction g{.domain = Domain::kZ, .sample_time_s = 0.01, .poles = {0.5}, .delay_s = 0.025};
  EXPECT_EQ(LinearFilter::recursion(g).error().code, "fractional_delay");
}

TEST(LinearFilter, PassesAPureGainThroughItsDelay) {
  const auto filter = *LinearFilter::sampled({.domain = Domain::kS, .gain = 2, .delay_s = 1.5}, 1);
  const auto y = run(filter, filter.rest(), {0, 1, 2, 3, 4});
  EXPECT_EQ(y, (std::vector<double>{0, 0, 1, 3, 5}));
}

}  // namespace
}  // namespace valvetriage
