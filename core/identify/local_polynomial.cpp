#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "core/linear_algebra/solve.h"
#include "core/statistics/distributions.h"

#include "core/identify/response_spectra.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;

constexpr std::size_t kTerms = 3;             // a parabola
constexpr std::size_t kFewestLines = 12;      // six unknowns and as many freedoms left for the noise
constexpr double kExcitedOfStrongest = 1e-5;  // power of a window over that of the strongest
constexpr double kLeastRough = 0.05;          // share of the input's power that no transient could imitate
constexpr double kFirstLineOfWindow = 0.25;   // power of the first line over the strongest of the dozen behind it
constexpr double kLeastReciprocalCondition = 1e-5;
constexpr double kWellDescribed = 0.999;  // coherence above which a parabola needs no rival
constexpr double kResonanceLeaves = 0.5;  // of the parabola's noise: else the window holds no resonance
constexpr double kChance = 1e-4;          // of calling a window's noise a resonance
constexpr int kPasses = 3;                // of the local rational function's weights
constexpr double kLeastDenominator = 1e-3;
constexpr std::array<double, 3> kGaussNodes3{-kGaussNode, 0, kGaussNode};
// Five complex unknowns of a local rational function: as many nodes (Gauss-Legendre) carry what it knows.
constexpr std::array<double, 5> kGaussNodes5{-0.9061798459386640, -0.5384693101056831, 0, 0.5384693101056831,
                                             0.9061798459386640};

struct Window {
  double from_hz = 0;
  double to_hz = 0;  ///< both included
  double centre_hz() const { return 0.5 * (from_hz + to_hz); }
  double half_width_hz() const { return 0.5 * (to_hz - from_hz); }
};

std::size_t first_line(const Window& window, const RecordSpectra& record) {
  return static_cast<std::size_t>(std::ceil(window.from_hz / record.line_hz - 1e-6));
}
std::size_t last_line(const Window& window, const RecordSpectra& record) {
  const auto line = static_cast<std::size_t>(std::floor(window.to_hz / record.line_hz + 1e-6));
  return std::min(line, record.input.size() - 1);
}

double input_power(const Window& window, std::span<const RecordSpectra> records) {
  double sum = 0;
  std::size_t lines = 0;
  for (const RecordSpectra& record : records) {
    for (std::size_t k = first_line(window, record); k <= last_line(window, record); ++k, ++lines) {
      sum += std::norm(record.input[k]);
    }
  }
  return lines > 0 ? sum / static_cast<double>(lines) : 0;
}

/// The first line that is not much weaker than what follows: below it a sweep has not begun.
std::size_t first_excited_line(const RecordSpectra& record) {
  const auto& u = record.input;
  for (std::size_t k = 1; k + kFewestLines < u.size(); ++k) {
    double strongest = 0;
    for (std::size_t i = k; i < k + kFewestLines; ++i) strongest = std::max(strongest, std::norm(u[i]));
    if (strongest > 0 && std::norm(u[k]) > kFirstLineOfWindow * strongest) return k;
  }
  return 1;
}

/// Windows side by side, a dozen lines wide at least and growing with frequency. Three points come from each.
std::vector<Window> windows_of(const RecordSpectra& record, double highest_hz, int points_per_decade) {
  const double growth = std::pow(10.0, static_cast<double>(kTerms) / points_per_decade);
  const auto last = static_cast<std::size_t>(highest_hz / record.line_hz);
  std::vector<Window> windows;
  for (std::size_t k = first_excited_line(record); k + kFewestLines - 1 <= last;) {
    const auto by_growth = static_cast<std::size_t>(static_cast<double>(k) * (growth - 1));
    const std::size_t width = std::max(kFewestLines, by_growth);
    const std::size_t end = std::min(k + width, last + 1);
    windows.push_back({static_cast<double>(k) * record.line_hz, static_cast<double>(end - 1) * record.line_hz});
    k = end;
  }
  return windows;
}

/// Y = G U + T of one window as rows, all repeats below each other; the parabola of G comes first.
struct Regression {
  Eigen::MatrixXcd columns;
  Eigen::VectorXcd output;
  Eigen::VectorXd abscissa;  ///< −1 to 1 across the window
  double input_scale = 1;
};

Regression regression_of(const Window& window, std::span<const RecordSpectra> records) {
  Index rows = 0;
  for (const RecordSpectra& r : records) {
    const std::size_t first = first_line(window, r), last = last_line(window, r);
    rows += last >= first ? static_cast<Index>(last - first + 1) : 0;
  }
  const auto transients = static_cast<Index>(kTerms * records.size());
  Regression regression;
  regression.columns = Eigen::MatrixXcd::Zero(rows, static_cast<Index>(kTerms) + transients);
  regression.output.resize(rows);
  regression.abscissa.resize(rows);
  regression.input_scale = std::sqrt(std::max(input_power(window, records), 1e-300));
  Index row = 0;
  for (std::size_t r = 0; r < records.size(); ++r) {
    for (std::size_t k = first_line(window, records[r]); k <= last_line(window, records[r]); ++k, ++row) {
      const double x = (static_cast<double>(k) * records[r].line_hz - window.centre_hz()) / window.half_width_hz();
      const Complex u = records[r].input[k] / regression.input_scale;
      const auto transient = static_cast<Index>(kTerms * (r + 1));
      double power = 1;
      for (Index term = 0; term < static_cast<Index>(kTerms); ++term, power *= x) {
        regression.columns(row, term) = u * power;
        regression.columns(row, transient + term) = power;
      }
      regression.output(row) = records[r].output[k];
      regression.abscissa(row) = x;
    }
  }
  return regression;
}

double residual_power(const Eigen::MatrixXcd& columns, const Eigen::VectorXcd& output) {
  const Eigen::HouseholderQR<Eigen::MatrixXcd> qr(columns);
  const Eigen::VectorXcd rotated = qr.householderQ().adjoint() * output;
  return rotated.tail(rotated.size() - columns.cols()).squaredNorm();
}

/// What one window gives: its points, and its residual by which ways are compared.
struct WindowEstimate {
  std::vector<ResponsePoint> points;
  double residual = 0;  ///< Σ |V|²
  double freedom = 0;   ///< complex ones
  double coherence = 0;
  double noise() const { return residual / freedom; }
};

/// The equations of a window solved by least squares, columns brought to one length.
struct WindowSolution {
  Eigen::VectorXcd theta;
  Eigen::MatrixXcd triangle;  ///< R of the scaled columns
  Eigen::RowVectorXd scale;
  double residual = 0;

  /// √(vᴴ (KᴴK)⁻¹ v) of a reading v of the unknowns, |R⁻ᴴ v|.
  double spread(const Eigen::VectorXcd& reading) const {
    const Eigen::VectorXcd scaled = reading.conjugate().cwiseQuotient(scale.transpose().cast<Complex>());
    return triangle.adjoint().triangularView<Eigen::Lower>().solve(scaled).norm();
  }
};

/// Nothing where the equations do not tell gain and transient apart.
std::optional<WindowSolution> solve(const Eigen::MatrixXcd& columns, const Eigen::VectorXcd& output) {
  WindowSolution solution;
  const Index unknowns = columns.cols();
  solution.scale = columns.colwise().norm().cwiseMax(1e-300);
  const Eigen::HouseholderQR<Eigen::MatrixXcd> qr(columns * solution.scale.cwiseInverse().asDiagonal());
  solution.triangle = qr.matrixQR().topRows(unknowns).triangularView<Eigen::Upper>();
  const Eigen::VectorXd diagonal = solution.triangle.diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > kLeastReciprocalCondition * diagonal.maxCoeff())) return std::nullopt;
  const Eigen::VectorXcd rotated = qr.householderQ().adjoint() * output;
  solution.theta = solution.triangle.triangularView<Eigen::Upper>().solve(rotated.head(unknowns));
  solution.theta = solution.theta.cwiseQuotient(solution.scale.transpose().cast<Complex>());
  solution.residual = rotated.tail(output.size() - unknowns).squaredNorm();
  return solution;
}

/// Y D = N U + T with D = 1 + d_1 x + d_2 x², the two unknowns of D last (McKelvey and Guérin, SYSID 2012).
///
/// Its residual is V D: noise alone would buy itself a small one by a D that is small where the noise is. So rows are
/// divided by |D| of the pass before (Sanathanan and Koerner, IEEE Trans. AC 8, 1963) and the residual is V's own, as
/// the parabola's is.
std::optional<WindowSolution> solve_rational(const Regression& regression) {
  const Index rows = regression.columns.rows(), unknowns = regression.columns.cols() + 2;
  Eigen::MatrixXcd columns(rows, unknowns);
  columns.leftCols(unknowns - 2) = regression.columns;
  columns.col(unknowns - 2) = -regression.output.cwiseProduct(regression.abscissa);
  columns.col(unknowns - 1) = columns.col(unknowns - 2).cwiseProduct(regression.abscissa);
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(rows);
  std::optional<WindowSolution> solution;
  for (int pass = 0; pass < kPasses; ++pass) {
    solution = solve(weight.asDiagonal() * columns, weight.cwiseProduct(regression.output));
    if (!solution) return solution;
    const Complex d1 = solution->theta(unknowns - 2), d2 = solution->theta(unknowns - 1);
    for (Index i = 0; i < rows; ++i) {
      const double x = regression.abscissa(i);
      weight(i) = 1 / std::max(kLeastDenominator, std::abs(1.0 + x * d1 + x * x * d2));
    }
  }
  return solution;
}

/// G = N / D read at the nodes of a window.
WindowEstimate estimate_window(const Window& window, const Regression& regression, int group, bool rational) {
  const Index rows = regression.columns.rows(), unknowns = regression.columns.cols() + (rational ? 2 : 0);
  const auto terms = static_cast<Index>(kTerms);
  if (rows <= unknowns) return {};
  const Eigen::MatrixXcd transient_columns = regression.columns.rightCols(regression.columns.cols() - terms);
  // Beyond the end of a sweep its spectrum is as smooth as a transient's: nothing tells the two apart.
  const Eigen::VectorXcd input = regression.columns.col(0);
  if (residual_power(transient_columns, input) < kLeastRough * input.squaredNorm()) return {};
  const auto solution = rational ? solve_rational(regression) : solve(regression.columns, regression.output);
  if (!solution) return {};
  const Eigen::VectorXcd& theta = solution->theta;

  WindowEstimate estimate{.residual = solution->residual, .freedom = static_cast<double>(rows - unknowns)};
  const double without_input =
      residual_power(transient_columns, regression.output) / static_cast<double>(rows - transient_columns.cols());
  if (without_input > 0) estimate.coherence = std::clamp(1 - estimate.noise() / without_input, 0.0, 1.0);
  const std::span<const double> nodes = rational ? std::span<const double>(kGaussNodes5) : kGaussNodes3;
  for (const double x : nodes) {
    const Complex d = rational ? 1.0 + x * theta(unknowns - 2) + x * x * theta(unknowns - 1) : Complex(1);
    const Complex gain = (theta(0) + x * theta(1) + x * x * theta(2)) / d;
    Eigen::VectorXcd reading = Eigen::VectorXcd::Zero(unknowns);  // δG = (δN − G δD) / D
    reading.head(3) << 1.0 / d, x / d, x * x / d;
    if (rational) reading.tail(2) << -gain * x / d, -gain * x * x / d;
    estimate.points.push_back(
        {.frequency_hz = window.centre_hz() + x * window.half_width_hz(),
         .gain = gain / regression.input_scale,
         .std_error = std::sqrt(estimate.noise()) * solution->spread(reading) / regression.input_scale,
         .coherence = estimate.coherence,
         .degrees_of_freedom = estimate.freedom,
         .group = group});
  }
  return estimate;
}

/// Whether the rational function describes a window better than chance lets it: F of its two further complex unknowns,
/// and less than half of the noise. A dozen lines of one record leave six freedoms: halves come about by chance there.
bool holds_a_resonance(const WindowEstimate& parabola, const WindowEstimate& rational) {
  if (rational.points.empty() || !(rational.noise() < kResonanceLeaves * parabola.noise())) return false;
  const double further = 2 * (parabola.freedom - rational.freedom), left = 2 * rational.freedom;
  const double f = (parabola.residual - rational.residual) / further / std::max(rational.residual / left, 1e-300);
  return fisher_f_upper_tail(further, left, f) < kChance;
}

/// A parabola where it describes the window, the local rational function where it is plainly none.
std::vector<ResponsePoint> points_of(const Window& window, std::span<const RecordSpectra> records, int group) {
  const Regression regression = regression_of(window, records);
  WindowEstimate parabola = estimate_window(window, regression, group, false);
  if (parabola.points.empty() || parabola.coherence > kWellDescribed) return parabola.points;
  WindowEstimate rational = estimate_window(window, regression, group, true);
  return holds_a_resonance(parabola, rational) ? rational.points : parabola.points;
}

}  // namespace

ResponseEstimate estimate_by_local_polynomials(std::span<const RecordSpectra> records, double highest_hz,
                                               int points_per_decade) {
  const auto shortest = std::max_element(records.begin(), records.end(),
                                         [](const auto& a, const auto& b) { return a.line_hz < b.line_hz; });
  const std::vector<Window> windows = windows_of(*shortest, highest_hz, points_per_decade);
  std::vector<double> powers;
  for (const Window& window : windows) powers.push_back(input_power(window, records));
  const double strongest = powers.empty() ? 0 : *std::max_element(powers.begin(), powers.end());

  ResponseEstimate estimate;
  for (std::size_t w = 0; w < windows.size(); ++w) {
    std::vector<ResponsePoint> points;
    if (powers[w] > kExcitedOfStrongest * strongest) points = points_of(windows[w], records, static_cast<int>(w));
    if (points.empty()) estimate.unusable.push_back({windows[w].from_hz, windows[w].to_hz, "not_excited"});
    estimate.points.insert(estimate.points.end(), points.begin(), points.end());
  }
  return estimate;
}

std::vector<ResponsePoint> thinned(std::vector<ResponsePoint> points, int points_per_decade) {
  constexpr std::size_t kFewestInGroup = 7;  // three unknowns, and freedoms left to see whether a parabola fits
  const double growth = std::pow(10.0, static_cast<double>(kTerms) / points_per_decade);
  std::vector<ResponsePoint> fewer;
  for (std::size_t begin = 0, end = 0; begin < points.size(); begin = end) {
    end = begin + 1;
    while (end < points.size() && points[end].frequency_hz < growth * points[begin].frequency_hz) ++end;
    const std::size_t n = end - begin;
    if (n < kFewestInGroup) {
      fewer.insert(fewer.end(), points.begin() + static_cast<std::ptrdiff_t>(begin),
                   points.begin() + static_cast<std::ptrdiff_t>(end));
      continue;
    }
    const double centre = 0.5 * (points[begin].frequency_hz + points[end - 1].frequency_hz);
    const double half = 0.5 * (points[end - 1].frequency_hz - points[begin].frequency_hz);
    Eigen::MatrixXd columns(static_cast<Index>(n), 3);
    Eigen::VectorXcd values(static_cast<Index>(n));
    double coherence = 0, freedom = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const ResponsePoint& point = points[begin + i];
      const double x = (point.frequency_hz - centre) / half, weight = 1 / point.std_error;
      columns.row(static_cast<Index>(i)) << weight, weight * x, weight * x * x;
      values(static_cast<Index>(i)) = weight * point.gain;
      coherence += point.coherence / static_cast<double>(n);
      freedom += point.degrees_of_freedom;
    }
    const Eigen::MatrixXd inverse = inverse_of_symmetric(columns.transpose() * columns);
    const Eigen::VectorXcd theta = inverse * (columns.transpose() * values);
    const double misfit = (values - columns * theta).squaredNorm() / static_cast<double>(n - 3);
    for (const double x : {-kGaussNode, 0.0, kGaussNode}) {
      const Eigen::Vector3d reading(1, x, x * x);
      fewer.push_back({.frequency_hz = centre + x * half,
                       .gain = theta(0) + x * theta(1) + x * x * theta(2),
                       .std_error = std::sqrt(std::max(1.0, misfit) * reading.dot(inverse * reading)),
                       .coherence = coherence,
                       .degrees_of_freedom = freedom,
                       .group = points[begin].group});
    }
  }
  return fewer;
}

}  // namespace valvetriage
