#include <gtest/gtest.h>

#include <algorithm>

#include "core/identify/asymptotic_bode.h"
#include "core/identify/rational_fit.h"
#include "tests/unit/identify/frequency_oracle_numbers.h"
#include "tests/unit/identify/responses.h"

// SciPy says the same: frequency_oracle.py made the numbers without any of the product's code.

namespace valvetriage {
namespace {

using test::kOracleCorners;
using test::kOracleFits;
using test::OracleCorners;
using test::OracleFit;
using test::plant_s;

/// As SYSTEMS in frequency_oracle.py.
TransferFunction system_of(int order) {
  switch (order) {
    case 3:
      return plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004);
    case 5:
      return plant_s(470, {2.4}, {{25, 0.7}, {40, 0.2}}, {13}, 0.004);
    case 7:
      return plant_s(470, {2.4}, {{9, 0.3}, {25, 0.7}, {40, 0.2}}, {6, 30}, 0.004);
    default:
      return plant_s(470, {0.8}, {{3, 0.4}, {9, 0.3}, {25, 0.3}, {40, 0.2}}, {2, 6, 30}, 0.004);
  }
}

FrequencyResponse measured(const OracleFit& oracle) {
  FrequencyResponse response;
  for (std::size_t k = 0; k < oracle.frequency_hz.size(); ++k) {
    response.points.push_back({.frequency_hz = oracle.frequency_hz[k],
                               .gain = oracle.measured[k],
                               .std_error = oracle.std_error[k],
                               .coherence = 0.9999,
                               .degrees_of_freedom = 1e6,
                               .group = static_cast<int>(k)});
  }
  return response;
}

FrequencyResponse measured(const OracleCorners& oracle) {
  FrequencyResponse response;
  for (std::size_t k = 0; k < oracle.frequency_hz.size(); ++k) {
    response.points.push_back({.frequency_hz = oracle.frequency_hz[k],
                               .gain = oracle.gain[k],
                               .std_error = 0.02 * oracle.gain[k],
                               .coherence = 0.999,
                               .degrees_of_freedom = 1e6,
                               .group = static_cast<int>(k)});
  }
  return response;
}

void expect_same_roots(const std::vector<std::complex<double>>& roots,
                       const std::vector<std::complex<double>>& expected) {
  ASSERT_EQ(roots.size(), expected.size());
  for (const auto& root : expected) {
    const auto nearest = *std::min_element(roots.begin(), roots.end(),
                                           [&](auto a, auto b) { return std::abs(a - root) < std::abs(b - root); });
    EXPECT_LT(std::abs(nearest - root), 3e-3 * std::abs(root)) << nearest << " for " << root;
  }
}

TEST(FrequencyOracle, ResponsesOfTransferFunctionsAreTheSame) {
  for (const OracleFit& oracle : kOracleFits) {
    const auto own = frequency_response(system_of(oracle.order), oracle.frequency_hz);
    for (std::size_t k = 0; k < own.size(); ++k) {
      EXPECT_LT(std::abs(own[k] - oracle.exact[k]), 1e-9 * std::abs(oracle.exact[k])) << oracle.order << ", " << k;
    }
  }
}

TEST(FrequencyOracle, TheBestRationalFunctionOfANoisyResponseIsTheSame) {
  for (const OracleFit& oracle : kOracleFits) {
    SCOPED_TRACE("order " + std::to_string(oracle.order));
    const auto fit = fit_rational(measured(oracle), {.order = oracle.order, .zeros = oracle.zeros}).value();
    // The product adds 1e-4 of the gain to each standard error of 1e-2: a ten-thousandth of chi square.
    EXPECT_NEAR(fit.chi_square / oracle.chi_square, 1, 5e-4);
    EXPECT_NEAR(fit.static_gain, oracle.static_gain, 0.01 * fit.static_gain_std_error + 1e-4 * oracle.static_gain);
    EXPECT_NEAR(fit.transfer_function.delay_s, oracle.delay_s, 0.05 * fit.delay_std_error_s);
    expect_same_roots(fit.transfer_function.poles, oracle.poles);
    expect_same_roots(fit.transfer_function.zeros, oracle.fitted_zeros);
  }
}

TEST(FrequencyOracle, TheRealCornersThatMinimiseVAreTheSame) {
  for (const OracleCorners& oracle : kOracleCorners) {
    const auto fit = fit_asymptotic(measured(oracle), {.poles = static_cast<int>(oracle.pole_hz.size()),
                                                       .zeros = static_cast<int>(oracle.zero_hz.size())})
                         .value();
    EXPECT_NEAR(fit.v / oracle.v, 1, 1e-5);
    const auto as_roots = [](const std::vector<double>& corners_hz) {
      std::vector<std::complex<double>> roots;
      for (const double hz : corners_hz) roots.emplace_back(-2 * std::numbers::pi * hz);
      return roots;
    };
    expect_same_roots(fit.transfer_function.poles, as_roots(oracle.pole_hz));
    expect_same_roots(fit.transfer_function.zeros, as_roots(oracle.zero_hz));
  }
}

TEST(FrequencyOracle, ASweepThroughAContinuousPlantIsTheSame) {
  TransferFunction prompt = system_of(3);
  prompt.delay_s = 0;
  const auto recording = test::recording_of(prompt, test::swept_sine(4000, 200, 0.2, 20, 0.1), 200);
  for (std::size_t i = 0; i < test::kOracleSweepOutput.size(); ++i) {
    EXPECT_NEAR(recording.output.values[100 * i] - 100, test::kOracleSweepOutput[i], 1e-6) << i;
  }
}

}  // namespace
}  // namespace valvetriage
