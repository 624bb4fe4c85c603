#include "core/model/section_cascade.h"

#include <algorithm>
#include <cmath>

#include "core/model/polynomial.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

constexpr double kLargestE = 1.999;           // a pole product above −1
constexpr double kOfStableTriangle = 0.9995;  // share of 4 − 2e that f may take

constexpr double kAtInfinity = 1e-12;  // |1 / z| below which a root z is at infinity: a vanishing first coefficient

Section section_of(Complex p1, Complex p2) {
  return {.order = 2, .e = 1 - (p1 * p2).real(), .f = ((1.0 - p1) * (1.0 - p2)).real()};
}

Complex inside_unit_circle(Complex pole) {
  return std::abs(pole) > 1 ? 1.0 / std::conj(pole) : pole;
}

}  // namespace

SectionLimits::SectionLimits(std::size_t samples)
    : least_e(6.0 / static_cast<double>(samples)),
      least_f(1e-4 / static_cast<double>(samples) / static_cast<double>(samples)),
      slow_rate(2.0 / static_cast<double>(samples)) {}

Section clamped(Section section, const SectionLimits& limits) {
  double most_f = 2 * kOfStableTriangle;
  if (section.order == 2) {
    section.e = std::clamp(section.e, std::min(limits.least_e, 1.0), kLargestE);
    most_f = (4 - 2 * section.e) * kOfStableTriangle;
  }
  section.f = std::clamp(section.f, limits.least_f, most_f);
  return section;
}

double slowest_rate(const Section& section) {
  return section.order == 2 ? section.f / section.e : section.f;
}

std::vector<Section> sections_from_poles(std::span<const Complex> poles, const SectionLimits& limits) {
  std::vector<double> real;
  std::vector<Section> sections;
  for (Complex pole : poles) {
    pole = inside_unit_circle(pole);
    if (pole.imag() > 0) sections.push_back(section_of(pole, std::conj(pole)));
    if (pole.imag() == 0) real.push_back(pole.real());
  }
  // The slowest with the fastest: two slow poles in one section would run into its limit on e.
  std::sort(real.begin(), real.end());
  std::size_t low = 0;
  std::size_t high = real.size();
  for (; low + 1 < high; ++low, --high) sections.push_back(section_of(real[low], real[high - 1]));
  if (low < high) sections.push_back({.order = 1, .f = 1 - real[low]});
  for (Section& section : sections) section = clamped(section, limits);
  return sections;
}

std::vector<Complex> poles_of(std::span<const Section> sections) {
  std::vector<Complex> poles;
  for (const Section& s : sections) {
    if (s.order == 1) {
      poles.emplace_back(1 - s.f);
      continue;
    }
    // With p = 1 − x: x² − (e + f) x + f = 0; exact where both poles are near 1.
    const double half = 0.5 * (s.e + s.f);
    const double discriminant = half * half - s.f;
    if (discriminant < 0) {
      const double imaginary = std::sqrt(-discriminant);
      poles.emplace_back(1 - half, imaginary);
      poles.emplace_back(1 - half, -imaginary);
    } else {
      const double larger = half + std::sqrt(discriminant);
      poles.emplace_back(1 - s.f / larger);
      poles.emplace_back(1 - larger);
    }
  }
  return poles;
}

std::vector<Section> equal_sections(int order, double rate, const SectionLimits& limits) {
  const std::vector<Complex> poles(static_cast<std::size_t>(order), Complex(1 - rate));
  return sections_from_poles(poles, limits);
}

int order_of(std::span<const Section> sections) {
  int order = 0;
  for (const Section& section : sections) order += section.order;
  return order;
}

double gain_at_rest(std::span<const Section> sections, std::span<const double> weights) {
  double sum = 0;
  std::size_t i = 0;
  for (std::size_t s = sections.size(); s-- > 0 && i < weights.size();) {
    sum += weights[i++];
    if (sections[s].order == 2) ++i;
  }
  if (i < weights.size()) sum += weights[i];
  return sum;
}

void SectionState::settle() {
  if (std::abs(level) + std::abs(difference) < kSettled) level = difference = 0;
}

DifferencePolynomial multiply(const DifferencePolynomial& a, const DifferencePolynomial& b) {
  DifferencePolynomial product(a.size() + b.size() - 1);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

DifferencePolynomial denominator(const Section& s) {
  if (s.order == 1) return {s.f, 1 - s.f};
  return {s.f, s.e - s.f, 1 - s.e};
}

std::vector<DifferencePolynomial> basis_numerators(std::span<const Section> sections) {
  std::vector<DifferencePolynomial> basis;
  DifferencePolynomial behind{1.0};  // ∏D of the sections after this one
  double gain = 1;
  for (const Section& section : sections) gain *= section.f;
  for (auto section = sections.rbegin(); section != sections.rend(); ++section) {
    DifferencePolynomial level = multiply(behind, {gain});
    if (section->order == 2) {
      DifferencePolynomial difference = multiply(level, {0.0, 1.0});
      basis.push_back(std::move(level));
      basis.push_back(std::move(difference));
    } else {
      basis.push_back(std::move(level));
    }
    behind = multiply(behind, denominator(*section));
    gain /= section->f;
  }
  basis.push_back(std::move(behind));
  return basis;
}

std::vector<double> in_powers_of_delay(const DifferencePolynomial& in_w) {
  std::vector<double> result{0.0};
  for (auto coefficient = in_w.rbegin(); coefficient != in_w.rend(); ++coefficient) {
    result = multiply(result, {1.0, -1.0});
    result[0] += *coefficient;
  }
  result.resize(in_w.size());
  return result;
}

// z⁻¹ = 1 − w is its own inverse.
DifferencePolynomial in_powers_of_difference(std::span<const double> in_delay) {
  return in_powers_of_delay(DifferencePolynomial(in_delay.begin(), in_delay.end()));
}

std::vector<Complex> z_roots(const DifferencePolynomial& in_w) {
  DifferencePolynomial p = in_w;
  while (p.size() > 1 && p.back() == 0) p.pop_back();
  std::vector<Complex> in_z;
  if (p.size() < 2 || !std::all_of(p.begin(), p.end(), [](double c) { return std::isfinite(c); })) return in_z;
  for (const Complex& w : roots(Polynomial(p.rbegin(), p.rend()))) {
    if (std::abs(1.0 - w) > kAtInfinity) in_z.push_back(1.0 / (1.0 - w));
  }
  return in_z;
}

}  // namespace valvetriage
