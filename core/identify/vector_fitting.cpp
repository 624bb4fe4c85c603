#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/identify/rational_fit.h"

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;

constexpr double kStandsStill = 1e-3;   // relative move of a pole: the refinement does the rest
constexpr double kStartDamping = 0.01;  // Gustavsen's choice: pairs spread over the band, lightly damped

/// Conjugate pairs spread over the band on a logarithmic scale; a real pole in the middle where the order is odd.
std::vector<Complex> spread_poles(double lowest, double highest, int order) {
  std::vector<Complex> poles;
  const int pairs = order / 2;
  for (int i = 0; i < pairs; ++i) {
    const double share = pairs == 1 ? 0.5 : static_cast<double>(i) / (pairs - 1);
    const double omega = lowest * std::pow(highest / lowest, share);
    poles.emplace_back(-kStartDamping * omega, omega);
    poles.emplace_back(-kStartDamping * omega, -omega);
  }
  if (order % 2 != 0) poles.emplace_back(-std::sqrt(lowest * highest), 0);
  return poles;
}

/// Partial fractions with real coefficients: 1/(s − p), or for a pair the sum and j times the difference.
void partial_fractions(const std::vector<Complex>& poles, Complex s, Eigen::RowVectorXcd& row) {
  for (std::size_t i = 0; i < poles.size(); ++i) {
    const Complex one = 1.0 / (s - poles[i]);
    if (poles[i].imag() == 0) {
      row(static_cast<Index>(i)) = one;
      continue;
    }
    const Complex other = 1.0 / (s - std::conj(poles[i]));
    row(static_cast<Index>(i)) = one + other;
    row(static_cast<Index>(i + 1)) = Complex(0, 1) * (one - other);
    ++i;
  }
}

/// Zeros of σ(s) = d + Σ c_i φ_i: eigenvalues of A − b cᵀ / d.
std::vector<Complex> zeros_of_sigma(const std::vector<Complex>& poles, const Eigen::VectorXd& c, double d) {
  const auto n = static_cast<Index>(poles.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Ones(n);
  for (Index i = 0; i < n; ++i) {
    const Complex p = poles[static_cast<std::size_t>(i)];
    a(i, i) = p.real();
    if (p.imag() == 0) continue;
    a(i + 1, i + 1) = p.real();
    a(i, i + 1) = p.imag();
    a(i + 1, i) = -p.imag();
    b(i) = 2;
    b(i + 1) = 0;
    ++i;
  }
  const Eigen::VectorXcd values = eigenvalues(a - b * c.transpose() / d);
  std::vector<Complex> zeros;
  for (const Complex z : values) {
    // The eigenvalues of a real matrix come in exact pairs; one of each stands for both.
    if (z.imag() < 0) continue;
    const double re = z.real() == 0 ? -1e-6 * std::abs(z) : -std::abs(z.real());
    zeros.emplace_back(re, z.imag());
    if (z.imag() > 0) zeros.emplace_back(re, -z.imag());
  }
  return zeros;
}

}  // namespace

std::vector<Complex> vector_fitting_poles(std::span<const ResponsePoint> points, int order, bool proper, double delay_s,
                                          int iterations) {
  const auto n = static_cast<Index>(points.size());
  const double scale = 2 * std::numbers::pi * std::sqrt(points.front().frequency_hz * points.back().frequency_hz);
  const double lowest = 2 * std::numbers::pi * points.front().frequency_hz / scale;
  const double highest = 2 * std::numbers::pi * points.back().frequency_hz / scale;
  std::vector<Complex> poles = spread_poles(lowest, highest, order);
  const Index direct = proper ? 1 : 0;
  const Index unknowns = 2 * order + direct + 1;
  double weight_norm = 0;
  for (const ResponsePoint& p : points) weight_norm += std::norm(p.gain) / (p.std_error * p.std_error);
  Eigen::MatrixXd rows(2 * n + 1, unknowns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(2 * n + 1);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    // Σ r_i φ_i + e − H (Σ c_i φ_i + d) = 0, and Re Σ_k σ(s_k) = points so that σ ≡ 0 is no solution.
    Eigen::RowVectorXcd phi(order);
    Eigen::RowVectorXd relaxation = Eigen::RowVectorXd::Zero(unknowns);
    for (Index k = 0; k < n; ++k) {
      const ResponsePoint& point = points[static_cast<std::size_t>(k)];
      const double omega = 2 * std::numbers::pi * point.frequency_hz;
      const Complex h = point.gain * std::polar(1.0, omega * delay_s);
      partial_fractions(poles, Complex(0, omega / scale), phi);
      Eigen::RowVectorXcd row(unknowns);
      row.head(order) = phi;
      if (proper) row(order) = 1;
      row.segment(order + direct, order) = -h * phi;
      row(unknowns - 1) = -h;
      const double weight = 1 / point.std_error;
      rows.row(2 * k) = weight * row.real();
      rows.row(2 * k + 1) = weight * row.imag();
      relaxation.segment(order + direct, order) += phi.real();
      relaxation(unknowns - 1) += 1;
    }
    const double strength = std::sqrt(weight_norm) / static_cast<double>(n);
    rows.row(2 * n) = strength * relaxation;
    right(2 * n) = strength * static_cast<double>(n);
    const Eigen::VectorXd x = scaled_least_squares(rows, right);
    double d = x(unknowns - 1);
    if (std::abs(d) < 1e-8) d = d < 0 ? -1e-8 : 1e-8;
    const auto c = x.segment(order + direct, order);
    double largest_move = 0;
    for (Index i = 0; i < order; ++i) {
      largest_move = std::max(largest_move, std::abs(c(i) / d) / std::abs(poles[static_cast<std::size_t>(i)]));
    }
    poles = zeros_of_sigma(poles, c, d);
    if (largest_move < kStandsStill) break;
  }
  for (Complex& p : poles) p *= scale;
  return poles;
}

}  // namespace valvetriage
