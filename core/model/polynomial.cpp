#include "core/model/polynomial.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <unsupported/Eigen/Polynomials>

namespace valvetriage {
namespace {

using Complex = std::complex<long double>;

// Aberth's iteration converges cubically from companion eigenvalues; a multiple root creeps and gains nothing beyond
// this.
constexpr int kMaxPolishSteps = 40;

void multiply_by_linear(Polynomial& p, long double root) {
  p.push_back(0);
  for (std::size_t i = p.size() - 1; i > 0; --i) p[i] -= root * p[i - 1];
}

void multiply_by_pair(Polynomial& p, std::complex<double> root) {
  const long double re = root.real(), im = root.imag();
  const long double c1 = -2 * re, c0 = re * re + im * im;
  p.push_back(0);
  p.push_back(0);
  for (std::size_t i = p.size() - 1; i > 0; --i) p[i] += c1 * p[i - 1] + (i > 1 ? c0 * p[i - 2] : 0);
}

struct Evaluation {
  Complex value, derivative;
  long double rounding;  // bound on the error of `value`
};

Evaluation evaluate(const Polynomial& p, Complex x) {
  Evaluation e{p[0], 0, std::abs(p[0])};
  const long double modulus = std::abs(x);
  for (std::size_t i = 1; i < p.size(); ++i) {
    e.derivative = e.derivative * x + e.value;
    e.value = e.value * x + p[i];
    e.rounding = e.rounding * modulus + std::abs(p[i]);
  }
  e.rounding *= 4 * static_cast<long double>(p.size()) * std::numeric_limits<long double>::epsilon();
  return e;
}

// Roots with a negative imaginary part are mirrors of the others, kept exact.
void mirror(std::vector<Complex>& x) {
  for (std::size_t i = 0; i + 1 < x.size(); ++i) {
    if (x[i].imag() > 0) x[i + 1] = std::conj(x[i]);
  }
}

Complex aberth_step(const Polynomial& p, const std::vector<Complex>& x, std::size_t i) {
  const Evaluation e = evaluate(p, x[i]);
  if (std::abs(e.value) <= e.rounding || e.derivative == Complex(0)) return 0;
  const Complex newton = e.value / e.derivative;
  Complex repulsion = 0;
  for (std::size_t j = 0; j < x.size(); ++j) {
    if (j != i && x[j] != x[i]) repulsion += Complex(1) / (x[i] - x[j]);
  }
  return newton / (Complex(1) - newton * repulsion);
}

void polish(const Polynomial& p, std::vector<Complex>& x) {
  for (int step = 0; step < kMaxPolishSteps; ++step) {
    long double largest = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (x[i].imag() < 0) continue;
      Complex change = aberth_step(p, x, i);
      if (x[i].imag() == 0) change.imag(0);
      const Complex next = x[i] - change;
      if (!std::isfinite(next.real()) || !std::isfinite(next.imag()) || next.imag() < 0) continue;
      x[i] = next;
      largest = std::max(largest, std::abs(change) / std::max(std::abs(next), std::numeric_limits<long double>::min()));
    }
    mirror(x);
    if (largest < std::numeric_limits<double>::epsilon() / 8) return;
  }
}

// Eigen's solver lists conjugates next to each other; the upper one is put first.
std::vector<Complex> companion_roots(const Polynomial& p) {
  Eigen::VectorXd ascending(static_cast<Eigen::Index>(p.size()));
  for (std::size_t i = 0; i < p.size(); ++i) ascending[static_cast<Eigen::Index>(p.size() - 1 - i)] = p[i] / p[0];
  Eigen::PolynomialSolver<double, Eigen::Dynamic> solver(ascending);
  std::vector<Complex> x;
  for (const auto& r : solver.roots()) {
    if (r.imag() < 0) continue;
    x.emplace_back(r.real(), r.imag());
    if (r.imag() > 0) x.emplace_back(r.real(), -r.imag());
  }
  return x;
}

}  // namespace

Polynomial expand(std::span<const std::complex<double>> roots) {
  Polynomial p{1};
  for (const auto& root : roots) {
    if (root.imag() == 0) multiply_by_linear(p, root.real());
    if (root.imag() > 0) multiply_by_pair(p, root);
  }
  return p;
}

Polynomial shifted(Polynomial p, long double shift) {
  for (std::size_t last = p.size(); last > 1; --last) {
    for (std::size_t i = 1; i < last; ++i) p[i] += shift * p[i - 1];
  }
  return p;
}

std::vector<std::complex<double>> roots(const Polynomial& p) {
  std::vector<std::complex<double>> result;
  Polynomial rest = p;
  while (rest.size() > 1 && rest.back() == 0) {
    rest.pop_back();
    result.emplace_back(0, 0);
  }
  if (rest.size() == 2) result.emplace_back(static_cast<double>(-rest[1] / rest[0]), 0);
  if (rest.size() <= 2) return result;
  std::vector<Complex> x = companion_roots(rest);
  polish(rest, x);
  for (const Complex& r : x) result.emplace_back(static_cast<double>(r.real()), static_cast<double>(r.imag()));
  return result;
}

}  // namespace valvetriage
