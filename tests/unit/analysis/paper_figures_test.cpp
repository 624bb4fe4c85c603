#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "core/analysis/paper_error_scaling.h"
#include "core/analysis/paper_frequency.h"
#include "core/analysis/paper_rls_bias.h"
#include "core/analysis/paper_stability.h"
#include "core/model/model.h"

namespace valvetriage {
namespace {

// The paper prints three or four digits: half a unit of the last one quoted.
constexpr double kFourthDigit = 0.00005;

TEST(PaperEquations2To5, HoldInCornerFormOnly) {
  const CornerFormCheck check = check_corner_form();
  // Logarithms of up to e^{22}: rounding of a few 1e-15.
  EXPECT_LT(check.largest_deviation, 1e-13);
  EXPECT_LT(check.response_deviation, 1e-13);
  EXPECT_NEAR(check.largest_gap, 0.5 * std::log(2.0), 1e-15);
  EXPECT_GT(check.largest_deviation_as_printed, 1);
}

TEST(PaperEquation16, HasOrderSevenAndTheCornersOfTheNotes) {
  const TransferFunction g = transfer_function_of(kPaperEquation16, 0.5, 0.7);
  EXPECT_EQ(g.poles.size(), 7u);
  EXPECT_NEAR(kPaperEquation16.zero, 13.125, 1e-12);
  EXPECT_NEAR(kPaperEquation16.pole, 6.125, 1e-12);
  EXPECT_NEAR(static_gain(g), 1, 1e-12);
}

TEST(PaperEquation17, HasOrderEightAndTheCornersOfTheNotes) {
  EXPECT_EQ(transfer_function_of(kPaperEquation17, 0.5, 0.7).poles.size(), 8u);
  EXPECT_NEAR(kPaperEquation17.zero, 13.125, 1e-12);
  EXPECT_NEAR(kPaperEquation17.pole, 3.675, 1e-12);
}

TEST(PaperEquations16And17, CancelTheirQuadraticsWithOneDampingRatio) {
  const std::array<double, 3> f{0.1, 1, 3};
  const auto full = frequency_response(transfer_function_of(kPaperEquation16, 0.3, 0.3), f);
  const auto short_form = frequency_response(cancelled(kPaperEquation16), f);
  for (std::size_t i = 0; i < f.size(); ++i) EXPECT_LT(std::abs(full[i] - short_form[i]), 1e-13);
}

TEST(PaperEquations16And17, LetTheReturnedValveDecayFirst) {
  EXPECT_NEAR(half_power_frequency(cancelled(kPaperEquation16)), 4.5, 0.05);
  EXPECT_NEAR(half_power_frequency(cancelled(kPaperEquation17)), 2.9, 0.05);
}

TEST(PaperEquation18, IsUnstableByAPairOfPoles) {
  const PaperPoleCheck check = check_poles(paper_equation_18());
  EXPECT_NEAR(check.largest_pole.real(), 1.0503, kFourthDigit);
  EXPECT_NEAR(check.largest_pole.imag(), 0.2027, kFourthDigit);
  EXPECT_NEAR(check.largest_modulus, 1.0697, kFourthDigit);
  EXPECT_NEAR(check.numerator_sum, 0.051, 1e-15);
  EXPECT_NEAR(check.denominator_sum, 0.035, 1e-15);
  EXPECT_NEAR(check.static_gain, 0.051 / 0.035, 1e-10);
}

TEST(PaperEquation18, IsUnstableForEveryValueThatRoundsToThePrintedDigits) {
  const InstabilityProof proof = prove_unstable(paper_equation_18());
  EXPECT_TRUE(proof.proven);
  EXPECT_GT(proof.smallest_margin, 1);
  // Read as 1.000, like its neighbours, the "1" needs one circle and no cutting.
  PaperDiscreteModel narrow = paper_equation_18();
  narrow.denominator[3].half_unit = 0.0005;
  EXPECT_EQ(prove_unstable(narrow).pieces, 1);
  EXPECT_GT(prove_unstable(narrow).smallest_margin, 5);
}

TEST(PaperEquation19, IsUnstableByARealPoleAndByTheProductOfItsPoles) {
  const PaperPoleCheck check = check_poles(paper_equation_19());
  EXPECT_NEAR(check.largest_modulus, 1.4928, kFourthDigit);
  EXPECT_EQ(check.largest_pole.imag(), 0);
  EXPECT_NEAR(check.pole_product, 1.416, 1e-9);
  EXPECT_NEAR(check.denominator_sum, -0.222, 1e-12);
  EXPECT_GT(smallest_root_product(paper_equation_19()), 1);
}

TEST(PaperStability, ProvesNothingAboutAStableModel) {
  PaperDiscreteModel model{.numerator = {1}, .denominator = {{1, 0}, {-0.5, 0.0005}}};
  EXPECT_FALSE(prove_unstable(model).proven);
  // A root at 1.0004 whose digits allow 0.9999 as well.
  model.denominator = {{1, 0}, {-1.0004, 0.0005}};
  EXPECT_FALSE(prove_unstable(model).proven);
}

TEST(PaperEquations18And19, AreRefusedBySimulateUnlessTheHorizonIsFinite) {
  Model model;
  IntervalSignal step{{0, 1, 1, 1, 1, 1, 1, 1}, {0, 1, 1, 1, 1, 1, 1, 1}};
  for (const auto& printed : {paper_equation_18(), paper_equation_19()}) {
    model.dynamics = transfer_function_of(printed);
    EXPECT_EQ(simulate(model, step, 1, {}, {}).error().code, "unstable");
    EXPECT_TRUE(simulate(model, step, 1, {}, {}, Horizon::kFinite));
  }
}

TEST(PaperEquations7To15, AreBiasedInIncrementsAndNotInLevels) {
  const std::array<std::uint64_t, 2> seeds{1, 2};
  for (const RlsOutcome& outcome : compare_rls_forms({}, seeds)) {
    if (outcome.form == RlsForm::kIncremental) {
      EXPECT_LT(outcome.static_gain, 0.2 * 470);
      EXPECT_GT(outcome.free_run_rmse, 20);
    }
    if (outcome.form == RlsForm::kAbsolute) {
      EXPECT_NEAR(outcome.static_gain, 470, 10);
      EXPECT_LT(outcome.free_run_rmse, 2);
    }
  }
}

TEST(PaperSimulatedData, TellsAReturnedValveOnlyFromTheGoodModel) {
  const SimulatedDataReadings readings = compare_simulated_data_readings({}, 1.4, 1);
  EXPECT_GT(readings.good_model, 3 * readings.own_model);
}

TEST(PaperEquation20, ScalesDifferentlyForResidualsThatStayAndThatDieOut) {
  const ErrorScaling scaling = measure_error_scaling();
  // A sampled exponential's sum differs from its integral by T/τ = 1 %.
  EXPECT_NEAR(scaling.stationary_by_rate, std::sqrt(2.0), 1e-6);
  EXPECT_NEAR(scaling.stationary_by_duration, std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(scaling.transient_by_rate, std::sqrt(2.0), 0.01);
  EXPECT_NEAR(scaling.transient_by_duration, 0.5, 1e-6);
}

}  // namespace
}  // namespace valvetriage
