#include "core/analysis/paper_stability.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

constexpr int kCircleSamples = 1024;
// A piece narrower than this changes |P| by less than the other coefficients do: cutting further proves no more.
constexpr double kNarrowestPiece = 1e-5;
// Circles that are tried, from the unit circle outwards.
constexpr double kLargestRadius = 1.15, kRadiusStep = 0.0025;
// A margin that needs no better circle.
constexpr double kAmpleMargin = 2;

struct Tangent {
  double value, slope;  // moduli of P and P'
};

Tangent tangent_at(const std::vector<PrintedCoefficient>& p, Complex z) {
  Complex value = 0, slope = 0;
  for (const PrintedCoefficient& c : p) {
    slope = slope * z + value;
    value = value * z + c.value;
  }
  return {std::abs(value), std::abs(slope)};
}

// Σ |c_k| m (m − 1) R^{m−2}, m = n − k: |P''| is nowhere larger on the disc.
double largest_curvature(const std::vector<PrintedCoefficient>& p, double radius) {
  double curvature = 0;
  for (std::size_t k = 0; k < p.size(); ++k) {
    const auto m = static_cast<double>(p.size() - 1 - k);
    curvature += std::abs(p[k].value) * m * (m - 1) * std::pow(radius, m - 2);
  }
  return curvature;
}

// Taylor's bound from each sample to half way to the next: |P| ≥ |P(z_i)| − |P'(z_i)| h − ½ max|P''| h².
double smallest_modulus(const std::vector<PrintedCoefficient>& p, double radius) {
  const double h = std::numbers::pi * radius / kCircleSamples;
  double smallest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kCircleSamples; ++i) {
    const Tangent t = tangent_at(p, std::polar(radius, 2 * std::numbers::pi * i / kCircleSamples));
    smallest = std::min(smallest, t.value - t.slope * h);
  }
  return smallest - 0.5 * largest_curvature(p, radius) * h * h;
}

double largest_change(const std::vector<PrintedCoefficient>& p, double radius) {
  double change = 0;
  for (const PrintedCoefficient& c : p) change = change * radius + c.half_unit;
  return change;
}

// The best margin over the circles that leave a root outside.
double best_margin(const std::vector<PrintedCoefficient>& p) {
  const TransferFunction g = transfer_function_of(PaperDiscreteModel{.numerator = {1}, .denominator = p});
  const double largest_root = std::abs(*std::max_element(
      g.poles.begin(), g.poles.end(), [](Complex left, Complex right) { return std::abs(left) < std::abs(right); }));
  double best = 0;
  for (double radius = 1; radius < std::min(largest_root, kLargestRadius) && best < kAmpleMargin;
       radius += kRadiusStep) {
    best = std::max(best, smallest_modulus(p, radius) / largest_change(p, radius));
  }
  return best;
}

// By Gauss and Lucas the roots of P' lie among those of P: were all of them inside the unit circle, P'(1) > 0.
bool derivative_at_one_is_negative(const std::vector<PrintedCoefficient>& p) {
  double highest = 0;
  for (std::size_t k = 0; k < p.size(); ++k) {
    highest += static_cast<double>(p.size() - 1 - k) * (p[k].value + p[k].half_unit);
  }
  return highest < 0;
}

}  // namespace

InstabilityProof prove_unstable(const PaperDiscreteModel& model) {
  std::vector<PrintedCoefficient> piece = model.denominator;
  PrintedCoefficient& widest = *std::max_element(
      piece.begin(), piece.end(), [](const auto& left, const auto& right) { return left.half_unit < right.half_unit; });
  std::vector<PrintedCoefficient> open{widest};
  InstabilityProof proof{.proven = false, .pieces = 0, .smallest_margin = std::numeric_limits<double>::infinity()};
  while (!open.empty()) {
    widest = open.back();
    open.pop_back();
    if (derivative_at_one_is_negative(piece)) {
      ++proof.pieces;
      continue;
    }
    const double margin = best_margin(piece);
    if (margin <= 1) {
      if (widest.half_unit < kNarrowestPiece) return proof;
      const double quarter = widest.half_unit / 2;
      open.push_back({widest.value - quarter, quarter});
      open.push_back({widest.value + quarter, quarter});
      continue;
    }
    ++proof.pieces;
    proof.smallest_margin = std::min(proof.smallest_margin, margin);
  }
  proof.proven = true;
  return proof;
}

double smallest_root_product(const PaperDiscreteModel& model) {
  return std::abs(model.denominator.back().value) - model.denominator.back().half_unit;
}

PaperPoleCheck check_poles(const PaperDiscreteModel& model) {
  const TransferFunction g = transfer_function_of(model);
  const RationalCoefficients c = coefficients_of(model);
  PaperPoleCheck check;
  check.pole_product = 1;
  for (const Complex& p : g.poles) {
    check.pole_product *= std::abs(p);
    if (std::abs(p) > check.largest_modulus && p.imag() >= 0) {
      check.largest_modulus = std::abs(p);
      check.largest_pole = p;
    }
  }
  check.numerator_sum = std::accumulate(c.b.begin(), c.b.end(), 0.0);
  check.denominator_sum = std::accumulate(c.a.begin(), c.a.end(), 0.0);
  check.static_gain = static_gain(g);
  return check;
}

}  // namespace valvetriage
