#include "core/model/transfer_function.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "tests/unit/model/random_models.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

TransferFunction discrete(std::vector<Complex> zeros, std::vector<Complex> poles, double gain,
                          double period_s = 0.005) {
  return {.domain = Domain::kZ, .sample_time_s = period_s, .zeros = zeros, .poles = poles, .gain = gain};
}

// Largest distance from a root to its nearest counterpart.
double distance(const std::vector<Complex>& found, const std::vector<Complex>& wanted) {
  if (found.size() != wanted.size()) return std::numeric_limits<double>::infinity();
  double worst = 0;
  for (const Complex& w : wanted) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Complex& f : found) nearest = std::min(nearest, std::abs(f - w));
    worst = std::max(worst, nearest);
  }
  return worst;
}

TEST(TransferFunction, BecomesTheDifferenceEquationOfItsRoots) {
  // 2 (z − 0.5) / ((z − 0.9)(z − 0.8)) = (2 z⁻¹ − z⁻²) / (1 − 1.7 z⁻¹ + 0.72 z⁻²)
  const auto c = to_coefficients(discrete({0.5}, {0.9, 0.8}, 2));
  ASSERT_TRUE(c);
  ASSERT_EQ(c->a.size(), 3u);
  EXPECT_DOUBLE_EQ(c->a[1], -1.7);
  EXPECT_DOUBLE_EQ(c->a[2], 0.72);
  ASSERT_EQ(c->b.size(), 3u);
  EXPECT_EQ(c->b[0], 0);
  EXPECT_DOUBLE_EQ(c->b[1], 2);
  EXPECT_DOUBLE_EQ(c->b[2], -1);
}

RC_GTEST_PROP(TransferFunction, ReturnsFromItsCoefficientsUnchanged, ()) {
  const auto order = *rc::gen::inRange(1, 6);
  const auto seed = *rc::gen::arbitrary<unsigned>();
  const TransferFunction g = *discretise_zoh(random_continuous(seed, order), 0.02);
  const auto back = to_transfer_function(*to_coefficients(g));
  RC_ASSERT(back.has_value());
  // Roots may be ill-conditioned; what they describe may not: the coefficients return to rounding.
  const auto c = *to_coefficients(g), again = *to_coefficients(*back);
  for (std::size_t i = 0; i < c.a.size(); ++i)
    RC_ASSERT(std::abs(c.a[i] - again.a[i]) < 1e-11 * (1 + std::abs(c.a[i])));
  RC_ASSERT(back->zeros.size() == g.zeros.size());
}

TEST(TransferFunction, FindsNinePolesThatClusterNearOne) {
  std::vector<Complex> poles;
  for (int i = 0; i < 9; ++i) poles.emplace_back(0.90 + 0.012 * i, 0);
  const auto c = to_coefficients(discrete({}, poles, 1));
  const auto g = to_transfer_function(*c);
  ASSERT_TRUE(g);
  // Condition of the outermost roots: coefficients of up to 126 rounded at 1e-16 over ∏|p_i − p_j| ≥ 4!² 0.012⁸
  // = 2.5e-13. The distances are hence known to about 0.01 at worst; the coefficients the roots stand for must return
  // to rounding.
  EXPECT_LT(distance(g->poles, poles), 0.02);
  const auto again = to_coefficients(*g);
  for (std::size_t i = 0; i < c->a.size(); ++i) EXPECT_NEAR(again->a[i], c->a[i], 1e-12 * 126);
}

TEST(TransferFunction, FindsSeparatedRootsOfOrderNineToRounding) {
  std::vector<Complex> poles;
  for (int i = 0; i < 4; ++i) {
    poles.push_back(std::polar(0.95, 0.3 + 0.6 * i));
    poles.push_back(std::conj(poles.back()));
  }
  poles.emplace_back(0.5, 0);
  const auto g = to_transfer_function(*to_coefficients(discrete({}, poles, 1)));
  EXPECT_LT(distance(g->poles, poles), 1e-13);
}

TEST(TransferFunction, DropsCommonFactorsOfZAndReadsLeadingZerosAsMissingZeros) {
  const RationalCoefficients c{.domain = Domain::kZ, .sample_time_s = 1, .b = {0, 0.5, 0}, .a = {1, -0.5}};
  const auto g = to_transfer_function(c);
  ASSERT_TRUE(g);
  EXPECT_TRUE(g->zeros.empty());
  ASSERT_EQ(g->poles.size(), 1u);
  EXPECT_DOUBLE_EQ(g->poles[0].real(), 0.5);
}

TEST(TransferFunction, RefusesWhatIsNotATransferFunction) {
  EXPECT_EQ(to_transfer_function({.b = {1}, .a = {0, 1}}).error().code, "leading_zero");
  EXPECT_EQ(to_transfer_function({.b = {NAN}, .a = {1}}).error().code, "not_finite");
  EXPECT_EQ(to_transfer_function({.domain = Domain::kS, .b = {1, 0}, .a = {1}}).error().code, "improper");
  EXPECT_EQ(to_coefficients(discrete({0.1, 0.2}, {0.5}, 1)).error().code, "improper");
  TransferFunction late = discrete({}, {0.5}, 1);
  late.delay_s = 1.5 * late.sample_time_s;
  EXPECT_EQ(to_coefficients(late).error().code, "fractional_delay");
  EXPECT_EQ(discretise_zoh({.domain = Domain::kS, .poles = {-1}}, 0).error().code, "not_positive");
  EXPECT_EQ(discretise_zoh({.domain = Domain::kS, .poles = {{-1, 1}}}, 1).error().code, "not_conjugate");
  EXPECT_EQ(discretise_zoh(discrete({}, {0.5}, 1), 1).error().code, "wrong_domain");
}

TEST(TransferFunction, IsStableInsideTheCircleOnlyAndInTheLeftHalfPlaneOnly) {
  EXPECT_TRUE(is_stable(discrete({}, {0.999999, -0.999999}, 1)));
  EXPECT_FALSE(is_stable(discrete({}, {1.0}, 1)));
  EXPECT_FALSE(is_stable(discrete({}, {std::polar(1.0001, 1.0), std::polar(1.0001, -1.0)}, 1)));
  EXPECT_TRUE(is_stable({.domain = Domain::kS, .poles = {-1e-9}}));
  EXPECT_FALSE(is_stable({.domain = Domain::kS, .poles = {0}}));
}

TEST(TransferFunction, HasItsGainAtRest) {
  EXPECT_DOUBLE_EQ(static_gain(discrete({}, {0.5}, 3)), 6);
  EXPECT_DOUBLE_EQ(static_gain({.domain = Domain::kS, .zeros = {-2}, .poles = {-4, -1}, .gain = 10}), 5);
  EXPECT_TRUE(std::isinf(static_gain(discrete({}, {1.0}, 1))));
  EXPECT_EQ(static_gain(discrete({1.0}, {0.5}, 1)), 0);
  EXPECT_DOUBLE_EQ(static_gain(discrete({1.0}, {0.5, 1.0}, 1)), 2);
}

TEST(TransferFunction, RespondsAtACornerWithMinusThreeDecibelsAndFortyFiveDegrees) {
  const TransferFunction lag{.domain = Domain::kS, .poles = {-2 * std::numbers::pi}, .gain = 2 * std::numbers::pi};
  const double corner_hz = 1;
  const Complex at_corner = frequency_response(lag, {&corner_hz, 1})[0];
  EXPECT_NEAR(std::abs(at_corner), std::numbers::sqrt2 / 2, 1e-15);
  EXPECT_NEAR(std::arg(at_corner), -std::numbers::pi / 4, 1e-15);
}

TEST(TransferFunction, LagsByItsDelayAtEveryFrequency) {
  TransferFunction g = discrete({}, {0.5}, 1);
  const std::vector<double> f{0.1, 3, 70};
  const auto prompt = frequency_response(g, f);
  g.delay_s = 3 * g.sample_time_s;
  const auto late = frequency_response(g, f);
  for (std::size_t i = 0; i < f.size(); ++i) {
    EXPECT_LT(std::abs(late[i] - prompt[i] * std::polar(1.0, -2 * std::numbers::pi * f[i] * g.delay_s)), 1e-14);
  }
}

TEST(DiscretiseZoh, MatchesTheClosedFormOfAFirstOrderLag) {
  const double a = 7, period_s = 0.01;
  const auto g = discretise_zoh({.domain = Domain::kS, .poles = {-a}, .gain = 3 * a}, period_s);
  ASSERT_TRUE(g);
  EXPECT_NEAR(g->poles[0].real(), std::exp(-a * period_s), 1e-15);
  EXPECT_NEAR(g->gain, 3 * (1 - std::exp(-a * period_s)), 1e-15);
}

TEST(DiscretiseZoh, MatchesTheClosedFormOfAnIntegratorAndOfTwo) {
  const double period_s = 0.02;
  const auto one = discretise_zoh({.domain = Domain::kS, .poles = {0}}, period_s);
  EXPECT_DOUBLE_EQ(one->gain, period_s);
  EXPECT_DOUBLE_EQ(one->poles[0].real(), 1);
  // 1/s² -> T²/2 (z + 1) / (z − 1)²
  const auto two = discretise_zoh({.domain = Domain::kS, .poles = {0, 0}}, period_s);
  EXPECT_NEAR(two->gain, period_s * period_s / 2, 1e-19);
  ASSERT_EQ(two->zeros.size(), 1u);
  EXPECT_NEAR(two->zeros[0].real(), -1, 1e-14);
}

TEST(DiscretiseZoh, MatchesTheClosedFormOfAnOscillator) {
  // ω²/(s² + ω²) -> (1 − cos ωT)(z + 1) / (z² − 2 cos(ωT) z + 1)
  const double w = 30, period_s = 0.01;
  const auto g = discretise_zoh({.domain = Domain::kS, .poles = {{0, w}, {0, -w}}, .gain = w * w}, period_s);
  EXPECT_NEAR(g->gain, 1 - std::cos(w * period_s), 1e-15);
  ASSERT_EQ(g->zeros.size(), 1u);
  EXPECT_NEAR(g->zeros[0].real(), -1, 1e-13);
  EXPECT_LT(distance(g->poles, {std::polar(1.0, w * period_s), std::polar(1.0, -w * period_s)}), 1e-15);
}

TEST(DiscretiseZoh, HasTheSamplingZerosOfEulerAndFrobeniusForFastSampling) {
  // Four integrators: zeros of z³ + 11 z² + 11 z + 1.
  const auto g = discretise_zoh({.domain = Domain::kS, .poles = {0, 0, 0, 0}}, 0.001);
  const double r = std::sqrt(24.0);
  EXPECT_LT(distance(g->zeros, {-1, -5 - r, -5 + r}), 1e-11);
}

TEST(DiscretiseZoh, KeepsTheFractionOfADelayExactly) {
  // Modified z-transform of a/(s + a) behind a delay (m + f) T: whole delay m, numerator
  // (1 − e^{−a(1−f)T}) z + (e^{−a(1−f)T} − e^{−aT}) over z (z − e^{−aT}).
  const double a = 12, period_s = 0.01, f = 0.3;
  const auto g = discretise_zoh({.domain = Domain::kS, .poles = {-a}, .gain = a, .delay_s = 2.3 * period_s}, period_s);
  ASSERT_TRUE(g);
  EXPECT_DOUBLE_EQ(g->delay_s, 2 * period_s);
  const double now = 1 - std::exp(-a * (1 - f) * period_s);
  const double before = std::exp(-a * (1 - f) * period_s) - std::exp(-a * period_s);
  EXPECT_NEAR(g->gain, now, 1e-14);
  ASSERT_EQ(g->zeros.size(), 1u);
  EXPECT_NEAR(g->zeros[0].real(), -before / now, 1e-13);
  EXPECT_LT(distance(g->poles, {0, std::exp(-a * period_s)}), 1e-15);
}

RC_GTEST_PROP(DiscretiseZoh, KeepsStaticGainAndStability, ()) {
  const TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 10));
  const auto z = discretise_zoh(g, 0.005);
  RC_ASSERT(z.has_value());
  RC_ASSERT(is_stable(*z));
  // The zeros carry the gain: nine sampling zeros at 1e-9 each.
  RC_ASSERT(std::abs(static_gain(*z) / 94 - 1) < 1e-8);
}

RC_GTEST_PROP(ContinuousFromZoh, UndoesDiscretiseZoh, ()) {
  TransferFunction g = random_continuous(*rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(1, 6));
  const auto back = continuous_from_zoh(*discretise_zoh(g, 0.02));
  RC_ASSERT(back.has_value());
  const std::vector<double> f{0.01, 0.3, 2, 10};
  const auto wanted = frequency_response(g, f), found = frequency_response(*back, f);
  for (std::size_t i = 0; i < f.size(); ++i) RC_ASSERT(std::abs(found[i] / wanted[i] - Complex(1)) < 1e-6);
}

TEST(ContinuousFromZoh, RefusesPolesThatNoSampledSystemHas) {
  EXPECT_EQ(continuous_from_zoh(discrete({}, {-0.5}, 1)).error().code, "no_continuous_equivalent");
  EXPECT_EQ(continuous_from_zoh(discrete({}, {0.0}, 1)).error().code, "no_continuous_equivalent");
  EXPECT_TRUE(continuous_from_zoh(discrete({}, {0.01}, 1)));
}

TEST(DiscretiseFoh, MatchesTheClosedFormOfAnIntegrator) {
  // 1/s -> T/2 (z + 1)/(z − 1): the trapezoidal rule
  const auto g = discretise_foh({.domain = Domain::kS, .poles = {0}}, 0.02);
  EXPECT_NEAR(g->gain, 0.01, 1e-17);
  ASSERT_EQ(g->zeros.size(), 1u);
  EXPECT_NEAR(g->zeros[0].real(), -1, 1e-14);
}

TEST(StepMetrics, OfAFirstOrderLagAreItsLogarithms) {
  const double tau = 0.2;
  const auto m = step_metrics({.domain = Domain::kS, .poles = {-1 / tau}, .gain = 5 / tau, .delay_s = 0.05});
  ASSERT_TRUE(m);
  EXPECT_NEAR(m->rise_time_s, tau * std::log(9.0), 1e-4 * tau);
  EXPECT_NEAR(m->settling_time_s, 0.05 + tau * std::log(50.0), 1e-3 * tau);
  EXPECT_EQ(m->overshoot_ratio, 0);
}

TEST(StepMetrics, OfAnUnderdampedPairOvershootByItsDamping) {
  const double zeta = 0.5, w = 20;
  const Complex p(-zeta * w, w * std::sqrt(1 - zeta * zeta));
  const auto m = step_metrics({.domain = Domain::kS, .poles = {p, std::conj(p)}, .gain = w * w});
  EXPECT_NEAR(m->overshoot_ratio, std::exp(-std::numbers::pi * zeta / std::sqrt(1 - zeta * zeta)), 1e-4);
}

TEST(StepMetrics, ResolveTheRiseOfAStiffSystem) {
  // A slow mode of 1 % hides behind a rise a thousand times faster.
  const double slow = 0.1, fast = 1000;
  TransferFunction g{.domain = Domain::kS, .zeros = {-slow * 1.01}, .poles = {-slow, -fast}, .gain = 1};
  const auto m = step_metrics(g);
  EXPECT_NEAR(m->rise_time_s, std::log(9.0) / fast, 0.1 / fast);
}

TEST(StepMetrics, OfADiscreteLagAgreeWithTheContinuousOne) {
  const TransferFunction g{.domain = Domain::kS, .poles = {-5}, .gain = 5};
  const auto s = step_metrics(g), z = step_metrics(*discretise_zoh(g, 0.001));
  EXPECT_NEAR(z->rise_time_s, s->rise_time_s, 1e-3);
  EXPECT_NEAR(z->settling_time_s, s->settling_time_s, 1e-3);
}

TEST(StepMetrics, RefuseAModelWithoutALevelToSettleAt) {
  EXPECT_EQ(step_metrics(discrete({}, {1.01}, 1)).error().code, "unstable");
  EXPECT_EQ(step_metrics(discrete({1.0}, {0.5}, 1)).error().code, "no_static_gain");
  EXPECT_EQ(step_metrics(discrete({}, {1 - 1e-9}, 1)).error().code, "too_slow");
}

}  // namespace
}  // namespace valvetriage
