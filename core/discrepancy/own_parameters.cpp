#include "core/discrepancy/own_parameters.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/identify/valve_fit.h"
#include "core/linear_algebra/solve.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr Index kParameters = static_cast<Index>(kValveParameters.size());
// What a fit's differences are taken over [A]: a loop that all good valves have none of has no smaller spread.
constexpr double kLeastLoopSpread_a = 1e-6;
constexpr double kWorthAFinding = 0.01;

/// How many independent tests as many correlated ones amount to: neighbouring knots say nearly the same thing. By the
/// eigenvalues of their correlation: Li and Ji, Heredity 95 (2005) 221.
double independent_tests(const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
  const Eigen::VectorXd eigenvalues = symmetric_eigen(correlation).values.cwiseMax(0.0);
  double tests = 0;
  for (const double eigenvalue : eigenvalues) {
    tests += (eigenvalue >= 1 ? 1 : 0) + eigenvalue - std::floor(eigenvalue);
  }
  return std::max(tests, 1.0);
}

}  // namespace

OwnParameters own_parameters_of(const Eigen::VectorXd& v, const Eigen::VectorXd& errors,
                                const ValveDiagnosisOptions& options) {
  OwnParameters own;
  if (!options.fit.prior || options.good_valves < 2) return own;
  const ValvePrior& good = *options.fit.prior;
  const double tests = independent_tests(good.covariance);
  Finding of_map;
  for (Index j = 0; j < good.mean.size(); ++j) {
    const bool is_parameter = j < kParameters;
    double spread = std::sqrt(good.covariance(j, j));
    if (is_parameter && kValveParameters[static_cast<std::size_t>(j)].unit == "A") {
      spread = std::max(spread, kLeastLoopSpread_a);
    }
    const double t = (v(j) - good.mean(j)) / std::hypot(spread, errors(j));
    const double p = std::min(1.0, tests * 2 * student_t_upper_tail(options.good_valves - 1, std::abs(t)));
    own.p_value = std::min(own.p_value, p);
    if (p >= kWorthAFinding) continue;
    Finding finding{.where = std::string(kOwnParameters),
                    .statistic = t,
                    .p_value = p,
                    .share_of_structured_residual = std::numeric_limits<double>::quiet_NaN()};
    if (is_parameter) {
      finding.what =
          fmt::format("{} {} good valves' by {:.0f} of their standard deviations",
                      kValveParameters[static_cast<std::size_t>(j)].name, t > 0 ? "above" : "below", std::abs(t));
      own.findings.push_back(std::move(finding));
    } else if (std::abs(t) > std::abs(of_map.statistic)) {
      const double input_a = options.fit.knots[static_cast<std::size_t>(j - kParameters)];
      finding.what = fmt::format("the map at {:.3g} A {} good valves' by {:.0f} of their standard deviations", input_a,
                                 t > 0 ? "above" : "below", std::abs(t));
      of_map = std::move(finding);
    }
  }
  if (!of_map.what.empty()) own.findings.push_back(std::move(of_map));
  std::stable_sort(own.findings.begin(), own.findings.end(),
                   [](const Finding& a, const Finding& b) { return std::abs(a.statistic) > std::abs(b.statistic); });
  return own;
}

}  // namespace valvetriage
