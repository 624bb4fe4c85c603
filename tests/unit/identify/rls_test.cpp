#include "core/identify/rls.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <Eigen/Dense>
#include <limits>

#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;

RecursiveLeastSquares fitted(const RlsOptions& options, const std::vector<double>& u, const std::vector<double>& y) {
  auto rls = RecursiveLeastSquares::create(options);
  EXPECT_TRUE(rls.has_value());
  for (std::size_t t = 0; t < u.size(); ++t) EXPECT_TRUE(rls->update(u[t], y[t]).has_value());
  return *rls;
}

double static_gain_of(const RecursiveLeastSquares& rls) {
  const RationalCoefficients c = rls.coefficients(1);
  double numerator = 0;
  double denominator = 0;
  for (const double b : c.b) numerator += b;
  for (const double a : c.a) denominator += a;
  return numerator / denominator;
}

/// Weighted batch least squares with the prior that P(0) and θ̂(0) = 0 stand for.
Eigen::VectorXd batch(const Eigen::MatrixXd& phi, const Eigen::VectorXd& y, double lambda, double initial_covariance) {
  const Eigen::Index n = phi.rows();
  const Eigen::Index p = phi.cols();
  Eigen::MatrixXd rows(n + p, p);
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(n + p);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double weight = std::pow(lambda, 0.5 * static_cast<double>(n - 1 - i));
    rows.row(i) = weight * phi.row(i);
    rhs[i] = weight * y[i];
  }
  rows.bottomRows(p) =
      std::pow(lambda, 0.5 * static_cast<double>(n)) / std::sqrt(initial_covariance) * Eigen::MatrixXd::Identity(p, p);
  return rows.householderQr().solve(rhs);
}

RC_GTEST_PROP(Rls, KernelEqualsWeightedBatchLeastSquaresForAnySizeAndForgetting, ()) {
  const auto p = *rc::gen::inRange(1, 40);  // beyond 32 the kernel is not unrolled
  const double lambda = *rc::gen::element(1.0, 0.999, 0.97);
  Normal normal(*rc::gen::arbitrary<std::uint32_t>());
  const int n = 3 * p + 20;
  Eigen::MatrixXd phi(n, p);
  Eigen::VectorXd y(n);
  RlsKernel kernel(std::vector<double>(static_cast<std::size_t>(p)), lambda, 100);
  for (int i = 0; i < n; ++i) {
    std::vector<double> row(static_cast<std::size_t>(p));
    for (int j = 0; j < p; ++j) row[static_cast<std::size_t>(j)] = phi(i, j) = normal();
    y[i] = normal();
    RC_ASSERT(kernel.update(row, y[i]).has_value());
  }
  const Eigen::VectorXd expected = batch(phi, y, lambda, 100);
  for (int j = 0; j < p; ++j) {
    // Rounding alone: condition number below 1e4 here.
    RC_ASSERT(std::abs(kernel.theta_hat()[static_cast<std::size_t>(j)] - expected[j]) < 1e-9);
  }
}

TEST(Rls, EqualsBatchLeastSquaresWhenNothingIsForgotten) {
  const auto u = random_levels(400, 5, 1);
  auto y = run(second_order_valve(), u);
  add_noise(y, 0.35, 2);
  const auto rls = fitted({.form = RlsForm::kIncremental, .order = 2, .input_terms = 2, .delay_samples = 1}, u, y);

  std::vector<std::size_t> rows;
  for (std::size_t t = 3; t < u.size(); ++t) rows.push_back(t);
  Eigen::MatrixXd phi(rows.size(), 4);
  Eigen::VectorXd rhs(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::size_t t = rows[i];
    phi.row(static_cast<Eigen::Index>(i)) << -(y[t - 1] - y[t - 2]), -(y[t - 2] - y[t - 3]), u[t - 1] - u[t - 2],
        u[t - 2] - u[t - 3];
    rhs[static_cast<Eigen::Index>(i)] = y[t] - y[t - 1];
  }
  ASSERT_EQ(rls.updates(), rows.size());
  const Eigen::VectorXd expected = batch(phi, rhs, 1, 1e6);
  for (Eigen::Index j = 0; j < 4; ++j) {
    EXPECT_NEAR(rls.theta_hat()[static_cast<std::size_t>(j)], expected[j], 1e-8 * (1 + std::abs(expected[j])));
  }
  const Eigen::MatrixXd information = phi.transpose() * phi + 1e-6 * Eigen::MatrixXd::Identity(4, 4);
  EXPECT_LT((rls.covariance() * information - Eigen::MatrixXd::Identity(4, 4)).norm(), 1e-8);
}

TEST(Rls, FindsThePlantExactlyWithoutNoiseInEveryForm) {
  const Plant plant = second_order_valve();
  const auto u = random_levels(3000, 10, 3);
  const auto y = run(plant, u);
  for (const RlsForm form : {RlsForm::kIncremental, RlsForm::kExtended, RlsForm::kAbsolute}) {
    const auto rls =
        fitted({.form = form, .order = 2, .input_terms = 2, .delay_samples = 1, .initial_covariance = 1e12}, u, y);
    EXPECT_NEAR(rls.theta_hat()[0], plant.a[1], 1e-6);
    EXPECT_NEAR(rls.theta_hat()[1], plant.a[2], 1e-6);
    EXPECT_NEAR(static_gain_of(rls), 470, 0.01);
  }
}

// 0.35 psi of white noise on a 94 psi step (0.2 A × 470 psi/A) at 200 Hz; published simulations gave 16
// and 42.
TEST(Rls, IncrementalFormIsBadlyBiasedByNoiseAndTheOthersLessSo) {
  std::vector<double> u(2400, 1.4);
  std::fill(u.begin() + 400, u.end(), 1.6);
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    auto y = run(second_order_valve(), u);
    y.erase(y.begin(), y.begin() + 300);  // the run starts at rest at 1.4 A
    std::vector<double> input(u.begin() + 300, u.end());
    add_noise(y, 0.35, seed);
    const RlsOptions common{.order = 2, .input_terms = 2, .delay_samples = 1};
    RlsOptions extended = common;
    extended.form = RlsForm::kExtended;
    RlsOptions absolute = common;
    absolute.form = RlsForm::kAbsolute;
    const double incremental_gain = static_gain_of(fitted(common, input, y));
    const double extended_gain = static_gain_of(fitted(extended, input, y));
    const double absolute_gain = static_gain_of(fitted(absolute, input, y));
    EXPECT_LT(std::abs(incremental_gain), 100);
    EXPECT_LT(std::abs(extended_gain - 470), std::abs(incremental_gain - 470));
    EXPECT_NEAR(absolute_gain, 470, 5);
  }
}

TEST(Rls, ForgetsAnOldPlantAsFastAsLambdaSays) {
  const auto u = random_levels(4000, 5, 4);
  Plant before{.b = {1.0}, .a = {1, -0.9}, .delay = 1};
  Plant after{.b = {1.0}, .a = {1, -0.5}, .delay = 1};
  auto y = run(before, u);
  const auto later = run(after, u);
  std::copy(later.begin() + 2000, later.end(), y.begin() + 2000);
  const auto rls =
      fitted({.form = RlsForm::kAbsolute, .order = 1, .input_terms = 1, .delay_samples = 1, .lambda = 0.98}, u, y);
  EXPECT_NEAR(rls.theta_hat()[0], -0.5, 1e-6);  // 0.98^2000 of the old plant is left: 3e-18
}

TEST(Rls, ASampleThatIsNotFiniteLeavesTheStateUnchanged) {
  auto rls = RecursiveLeastSquares::create({.form = RlsForm::kAbsolute}).value();
  const auto u = random_levels(100, 5, 5);
  const auto y = run(second_order_valve(), u);
  auto other = rls;
  for (std::size_t t = 0; t < u.size(); ++t) {
    ASSERT_TRUE(rls.update(u[t], y[t]).has_value());
    ASSERT_TRUE(other.update(u[t], y[t]).has_value());
    const auto refused = other.update(std::numeric_limits<double>::quiet_NaN(), y[t]);
    ASSERT_FALSE(refused.has_value());
    EXPECT_EQ(refused.error().code, "not_finite");
    ASSERT_FALSE(other.update(std::numeric_limits<double>::infinity(), y[t]).has_value());
    if (t > 5) {
      ASSERT_FALSE(other.update(u[t], 1e300).has_value());  // its square overflows
    }
  }
  EXPECT_TRUE(std::equal(rls.theta_hat().begin(), rls.theta_hat().end(), other.theta_hat().begin()));
  EXPECT_EQ(rls.covariance(), other.covariance());
}

TEST(Rls, AMillionSamplesAtRestDoNotOverflowP) {
  auto rls = RecursiveLeastSquares::create({.form = RlsForm::kIncremental, .lambda = 0.98}).value();
  for (int t = 0; t < 1'000'000; ++t) ASSERT_TRUE(rls.update(1.2, 3.1).has_value());
  EXPECT_TRUE(rls.covariance().allFinite());
}

TEST(Rls, RefusesOptionsOutsideTheirRangeByName) {
  const auto refused = [](RlsOptions options, const char* field) {
    const auto made = RecursiveLeastSquares::create(options);
    return !made.has_value() && made.error().code == "bad_option" && made.error().field == field;
  };
  EXPECT_TRUE(refused({.order = 0}, "order"));
  EXPECT_TRUE(refused({.order = kMaxRlsTerms + 1}, "order"));
  EXPECT_TRUE(RecursiveLeastSquares::create({.order = kMaxRlsTerms}).has_value());
  EXPECT_TRUE(refused({.input_terms = 0}, "input_terms"));
  EXPECT_TRUE(refused({.delay_samples = -1}, "delay_samples"));
  EXPECT_TRUE(refused({.delay_samples = kMaxRlsDelay + 1}, "delay_samples"));
  EXPECT_TRUE(refused({.lambda = 0}, "lambda"));
  EXPECT_TRUE(refused({.lambda = 1.001}, "lambda"));
  EXPECT_TRUE(RecursiveLeastSquares::create({.lambda = 1}).has_value());
  EXPECT_TRUE(refused({.initial_covariance = 0}, "initial_covariance"));
  EXPECT_TRUE(refused({.initial_estimate = {1, 2}}, "initial_estimate"));
  EXPECT_TRUE(refused({.form = RlsForm::kExtended, .noise_terms = 0}, "noise_terms"));
}

}  // namespace
}  // namespace valvetriage
