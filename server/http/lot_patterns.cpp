#include "server/http/lot_patterns.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace valvetriage::http {
namespace {

constexpr double kAlike = 0.75;  // correlation of typicality 1/2
constexpr double kSquaredDistance = 2 * (1 - kAlike);
constexpr PossibilisticOptions kClustering{.fuzzifier = 1.5, .most_iterations = 100};
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// A test that several valves were put to, and its columns in the matrices.
struct SharedTest {
  std::string key;
  Eigen::Index bins = 0;
  Eigen::Index first_column = 0;
  double white_sd = 0;
  std::vector<double> time_s;
};

std::vector<SharedTest> shared_tests(const std::vector<ValveResiduals>& valves) {
  std::map<std::string, std::vector<const BinnedResidual*>> by_key;
  for (const ValveResiduals& valve : valves) {
    for (const auto& [key, residual] : valve) by_key[key].push_back(&residual);
  }
  std::vector<SharedTest> tests;
  Eigen::Index column = 0;
  for (const auto& [key, residuals] : by_key) {
    if (residuals.size() < 2) continue;
    std::vector<double> noise;
    for (const BinnedResidual* residual : residuals) noise.push_back(residual->white_sd);
    const auto middle = noise.begin() + static_cast<std::ptrdiff_t>(noise.size() / 2);
    std::nth_element(noise.begin(), middle, noise.end());
    const Eigen::Index bins = residuals.front()->value.size();
    tests.push_back(
        {.key = key, .bins = bins, .first_column = column, .white_sd = *middle, .time_s = residuals.front()->time_s});
    column += bins;
  }
  return tests;
}

Eigen::MatrixXd matrix_of(const std::vector<ValveResiduals>& valves, const std::vector<SharedTest>& tests) {
  const Eigen::Index columns = tests.empty() ? 0 : tests.back().first_column + tests.back().bins;
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Constant(Eigen::Index(valves.size()), columns, kNaN);
  for (std::size_t i = 0; i < valves.size(); ++i) {
    for (const SharedTest& test : tests) {
      const auto found = valves[i].find(test.key);
      if (found == valves[i].end() || found->second.value.size() != test.bins) continue;
      matrix.row(Eigen::Index(i)).segment(test.first_column, test.bins) = found->second.value.transpose();
    }
  }
  return matrix;
}

/// Mean and standard deviation of the finite values; how many there are.
struct Spread {
  double mean = kNaN, sd = kNaN;
  int count = 0;
};

Spread spread_of(const Eigen::VectorXd& values) {
  Spread spread;
  double sum = 0, squares = 0;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    ++spread.count;
    sum += value;
    squares += value * value;
  }
  if (spread.count == 0) return spread;
  spread.mean = sum / spread.count;
  spread.sd = spread.count > 1 ? std::sqrt(std::max(0.0, (squares - sum * spread.mean) / (spread.count - 1))) : 0.0;
  return spread;
}

GroupResidual group_residual(const SharedTest& test, const Eigen::MatrixXd& members, const Eigen::MatrixXd& good) {
  GroupResidual residual{.test = test.key, .time_s = test.time_s, .mean = {}, .sd = {}, .good = {}};
  for (Eigen::Index k = 0; k < test.bins; ++k) {
    const Spread spread = spread_of(members.col(test.first_column + k));
    residual.mean.push_back(spread.mean);
    residual.sd.push_back(spread.sd);
    if (good.rows() > 0) residual.good.push_back(spread_of(good.col(test.first_column + k)).mean);
  }
  return residual;
}

int members_with(const SharedTest& test, const Eigen::MatrixXd& members) {
  const auto columns = members.middleCols(test.first_column, test.bins).array();
  return static_cast<int>((columns.isFinite().cast<int>().rowwise().maxCoeff()).sum());
}

}  // namespace

std::vector<LotPattern> lot_patterns(const std::vector<ValveResiduals>& valves,
                                     const std::vector<ValveResiduals>& good) {
  const std::vector<SharedTest> tests = shared_tests(valves);
  if (tests.empty()) return {};
  const Eigen::MatrixXd residuals = matrix_of(valves, tests), of_good = matrix_of(good, tests);
  Eigen::VectorXd white_sd(residuals.cols());
  for (const SharedTest& test : tests) white_sd.segment(test.first_column, test.bins).setConstant(test.white_sd);
  const Eigen::MatrixXd directions = residual_directions(residuals, of_good, white_sd);
  std::vector<LotPattern> patterns;
  for (const PatternGroup& group : possibilistic_groups(directions, kSquaredDistance, kClustering)) {
    const Eigen::MatrixXd members =
        residuals(std::vector<Eigen::Index>(group.members.begin(), group.members.end()), Eigen::all);
    LotPattern pattern{.members = group.members, .typicality = group.typicality, .residuals = {}};
    for (const SharedTest& test : tests) {
      if (members_with(test, members) < 2) continue;
      pattern.residuals.push_back(group_residual(test, members, of_good));
    }
    patterns.push_back(std::move(pattern));
  }
  return patterns;
}

}  // namespace valvetriage::http
