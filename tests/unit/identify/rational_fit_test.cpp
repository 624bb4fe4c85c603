#include "core/identify/rational_fit.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/identify/responses.h"

namespace valvetriage {
namespace {

using test::plant_s;
using test::response_of;

/// Known systems of order five to nine, as a valve with lines and volumes around it has them.
TransferFunction known_system(int order) {
  switch (order) {
    case 5:
      return plant_s(470, {2.4}, {{25, 0.7}, {40, 0.2}}, {13}, 0.004);
    case 6:
      return plant_s(470, {2.4, 12}, {{25, 0.7}, {40, 0.2}}, {6, 60}, 0.004);
    case 7:
      return plant_s(470, {2.4}, {{9, 0.3}, {25, 0.7}, {40, 0.2}}, {6, 30}, 0.004);
    case 8:
      return plant_s(470, {1, 4}, {{9, 0.3}, {25, 0.5}, {40, 0.2}}, {2, 6, 30}, 0.004);
    default:
      return plant_s(470, {0.8}, {{3, 0.4}, {9, 0.3}, {25, 0.3}, {40, 0.2}}, {2, 6, 30}, 0.004);
  }
}

/// Rms over seeds and points of |Ĝ − G| over the rms that the Cramér-Rao bound allows, and whether all were stable.
struct Accuracy {
  double ratio = 0;
  bool stable = true;
};
Accuracy accuracy_of(int order, double noise_ratio, int seeds) {
  const TransferFunction truth = known_system(order);
  RationalFitOptions options;
  options.order = order;
  options.zeros = static_cast<int>(truth.zeros.size());
  double squares = 0, bound = 0;
  Accuracy accuracy;
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto response = response_of(truth, 0.2, 80, 200, noise_ratio, static_cast<std::uint32_t>(seed));
    const auto fit = fit_rational(response, options).value();
    accuracy.stable = accuracy.stable && is_stable(fit.transfer_function);
    // The bound at the true system: a fit started there, which stays there in the mean.
    RationalFitOptions at_truth = options;
    at_truth.starts = {truth};
    at_truth.only_given_starts = true;
    at_truth.max_iterations = 0;
    const auto noiseless = response_of(truth, 0.2, 80, 200, 0, 1);
    auto exact = noiseless;
    for (std::size_t k = 0; k < exact.points.size(); ++k) exact.points[k].std_error = response.points[k].std_error;
    const auto known = fit_rational(exact, at_truth).value();
    for (std::size_t k = 0; k < response.points.size(); ++k) {
      const auto& point = response.points[k];
      const auto g = frequency_response(fit.transfer_function, std::span(&point.frequency_hz, 1))[0];
      squares += std::norm(g - noiseless.points[k].gain) / (point.std_error * point.std_error);
      bound += known.response_std_error[k] * known.response_std_error[k] / (point.std_error * point.std_error);
    }
  }
  accuracy.ratio = std::sqrt(squares / bound);
  return accuracy;
}

class KnownSystem : public ::testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(KnownSystem, IsRecoveredNearTheCramerRaoBoundOfItsResponse) {
  const auto [order, decibels] = GetParam();
  const Accuracy accuracy = accuracy_of(order, std::pow(10.0, -decibels / 20.0), 3);
  RecordProperty("ratio_to_bound", std::to_string(accuracy.ratio));
  std::printf("order %d at %d dB: %.3f of the bound\n", order, decibels, accuracy.ratio);
  EXPECT_TRUE(accuracy.stable);
  EXPECT_LT(accuracy.ratio, 1.5);
}

INSTANTIATE_TEST_SUITE_P(OrdersAndNoise, KnownSystem,
                         ::testing::Combine(::testing::Values(5, 6, 7, 8, 9), ::testing::Values(20, 40, 60)),
                         [](const auto& drawn) {
                           return "Order" + std::to_string(std::get<0>(drawn.param)) + "At" +
                                  std::to_string(std::get<1>(drawn.param)) + "dB";
                         });

TEST(RationalFit, OfAResponseWithoutNoiseIsThePlant) {
  const TransferFunction truth = known_system(5);
  const auto fit = fit_rational(response_of(truth, 0.2, 80, 60, 1e-9, 1), {.order = 5, .zeros = 1}).value();
  const TransferFunction& g = fit.transfer_function;
  EXPECT_NEAR(g.delay_s, truth.delay_s, 1e-7);
  EXPECT_NEAR(fit.static_gain, 470, 1e-4);
  for (const auto& pole : truth.poles) {
    const auto nearest = std::min_element(g.poles.begin(), g.poles.end(),
                                          [&](auto a, auto b) { return std::abs(a - pole) < std::abs(b - pole); });
    EXPECT_LT(std::abs(*nearest - pole), 1e-5 * std::abs(pole));
  }
  EXPECT_NEAR(g.gain / truth.gain, 1, 1e-5);
}

TEST(RationalFit, KeepsRealPolesReal) {
  const TransferFunction truth = plant_s(470, {0.5, 2, 8, 30}, {}, {4});
  for (std::uint32_t seed = 1; seed <= 10; ++seed) {
    const auto fit = fit_rational(response_of(truth, 0.1, 100, 120, 0.01, seed), {.order = 4, .zeros = 1}).value();
    for (const auto& pole : fit.transfer_function.poles) EXPECT_EQ(pole.imag(), 0) << "seed " << seed;
  }
}

TEST(RationalFit, IsStableWhateverTheDataSay) {
  // The response of an unstable plant, and one of noise alone.
  TransferFunction unstable = plant_s(10, {}, {{5, -0.1}});
  const auto of_unstable = fit_rational(response_of(unstable, 0.2, 50, 80, 0.01, 1), {.order = 2, .zeros = 0}).value();
  EXPECT_TRUE(is_stable(of_unstable.transfer_function));
  auto noise = response_of(plant_s(1, {3}, {}), 0.2, 50, 80, 30, 2);
  for (int order = 1; order <= 9; ++order) {
    EXPECT_TRUE(is_stable(fit_rational(noise, {.order = order, .zeros = order}).value().transfer_function)) << order;
  }
}

TEST(RationalFit, HasStandardErrorsThatItsPolesKeepTo) {
  const TransferFunction truth = plant_s(470, {2.4}, {{25, 0.3}}, {10}, 0.003);
  const double pole = 2 * std::numbers::pi * 2.4;
  double pole_squares = 0, gain_squares = 0, delay_squares = 0;
  constexpr int kSeeds = 40;
  for (std::uint32_t seed = 1; seed <= kSeeds; ++seed) {
    const auto fit = fit_rational(response_of(truth, 0.2, 80, 60, 0.02, seed), {.order = 3, .zeros = 1}).value();
    const auto& poles = fit.transfer_function.poles;
    const auto real = std::find_if(poles.begin(), poles.end(), [](auto p) { return p.imag() == 0; });
    ASSERT_NE(real, poles.end());
    const auto at = static_cast<std::size_t>(real - poles.begin());
    const auto square = [](double x) { return x * x; };
    pole_squares += square((real->real() + pole) / fit.pole_std_errors[at]) / kSeeds;
    gain_squares += square((fit.static_gain - 470) / fit.static_gain_std_error) / kSeeds;
    delay_squares += square((fit.transfer_function.delay_s - 0.003) / fit.delay_std_error_s) / kSeeds;
  }
  // Mean of 40 squares of unit variance: 1 ± 0.22, three times that.
  EXPECT_NEAR(pole_squares, 1, 0.67);
  EXPECT_NEAR(gain_squares, 1, 0.67);
  EXPECT_NEAR(delay_squares, 1, 0.67);
}

TEST(RationalFit, OfASampledSweepIsTheContinuousPlant) {
  const TransferFunction truth = plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004);
  const auto recording = test::recording_of(truth, test::swept_sine(12000, 200, 0.2, 40, 0.1), 200, 0.1);
  const Recording* const one[] = {&recording};
  const auto response = estimate_frequency_response(one).value();
  const auto fit = fit_rational(response, {.order = 3, .zeros = 0}).value();
  EXPECT_NEAR(fit.static_gain, 470, 5 * fit.static_gain_std_error + 1);
  EXPECT_NEAR(fit.transfer_function.delay_s, 0.004, 5 * fit.delay_std_error_s + 1e-4);
}

TEST(RationalFit, SaysWhatTheDataCannotSupport) {
  const auto response = response_of(plant_s(1, {3}, {}), 0.2, 50, 8, 0.01, 1);
  const auto fit = fit_rational(response, {.order = 9, .zeros = 8});
  ASSERT_FALSE(fit);
  EXPECT_EQ(fit.error().code, "too_few_points");
  EXPECT_EQ(fit_rational(response, {.order = 0}).error().code, "bad_option");
}

}  // namespace
}  // namespace valvetriage
