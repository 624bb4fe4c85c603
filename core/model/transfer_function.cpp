#include "core/model/transfer_function.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/model/polynomial.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

// z-domain delays are written in seconds: a whole number of samples up to this much rounding.
constexpr double kSampleTolerance = 1e-6;

bool all_finite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

bool all_finite(std::span<const Complex> values) {
  return std::all_of(values.begin(), values.end(),
                     [](Complex v) { return std::isfinite(v.real()) && std::isfinite(v.imag()); });
}

std::vector<double> to_double(const Polynomial& p, long double factor = 1) {
  std::vector<double> values;
  for (long double c : p) values.push_back(static_cast<double>(factor * c));
  return values;
}

// Poles of valves cluster near z = 1: their distances to it, not their values, are what the coefficients tell apart.
std::vector<Complex> roots_about(const Polynomial& p, Domain domain) {
  const bool about_one = domain == Domain::kZ && p.back() != 0;
  std::vector<Complex> found = roots(about_one ? shifted(p, 1) : p);
  if (about_one) {
    for (Complex& r : found) r += 1.0;
  }
  return found;
}

/// ∏ (x − zeros) / ∏ (x − poles) with the factors interleaved, so that nothing overflows on the way.
/// `offset` = x − centre, computed without cancellation.
Complex ratio(const TransferFunction& g, Complex offset, double centre) {
  Complex value = g.gain;
  const std::size_t n = std::max(g.zeros.size(), g.poles.size());
  for (std::size_t i = 0; i < n; ++i) {
    if (i < g.zeros.size()) value *= offset - (g.zeros[i] - centre);
    if (i < g.poles.size()) value /= offset - (g.poles[i] - centre);
  }
  return value;
}

}  // namespace

Result<RationalCoefficients> to_coefficients(const TransferFunction& g) {
  if (!all_finite(g.zeros) || !all_finite(g.poles) || !std::isfinite(g.gain) || !std::isfinite(g.delay_s)) {
    return fail("not_finite", "a root, the gain or the delay of the transfer function is not finite");
  }
  if (g.zeros.size() > g.poles.size()) {
    return fail("improper", fmt::format("the transfer function has {} zeros and {} poles: it is improper",
                                        g.zeros.size(), g.poles.size()));
  }
  RationalCoefficients c{.domain = g.domain, .sample_time_s = g.sample_time_s};
  c.a = to_double(expand(g.poles));
  c.b = to_double(expand(g.zeros), g.gain);
  if (g.domain == Domain::kS) {
    c.delay_s = g.delay_s;
    return c;
  }
  c.b.insert(c.b.begin(), g.poles.size() - g.zeros.size(), 0.0);
  const double samples = g.delay_s == 0 ? 0.0 : g.delay_s / g.sample_time_s;
  if (!(std::abs(samples - std::round(samples)) < kSampleTolerance)) {
    return fail("fractional_delay", fmt::format("the delay {} s is not a whole number of sample times of {} s",
                                                g.delay_s, g.sample_time_s));
  }
  c.delay_samples = static_cast<int>(std::lround(samples));
  return c;
}

Result<TransferFunction> to_transfer_function(const RationalCoefficients& c) {
  if (!all_finite(c.a) || !all_finite(c.b) || !std::isfinite(c.delay_s)) {
    return fail("not_finite", "a coefficient of the transfer function is not finite");
  }
  if (c.a.empty() || c.a[0] == 0) return fail("leading_zero", "the first coefficient of the denominator is zero");
  Polynomial numerator(c.b.begin(), c.b.end()), denominator(c.a.begin(), c.a.end());
  if (c.domain == Domain::kZ) {
    const std::size_t length = std::max(numerator.size(), denominator.size());
    numerator.resize(length, 0);
    denominator.resize(length, 0);
    while (length > 1 && denominator.size() > 1 && denominator.back() == 0 && numerator.back() == 0) {
      numerator.pop_back();
      denominator.pop_back();
    }
  }
  numerator.erase(numerator.begin(),
                  std::find_if(numerator.begin(), numerator.end(), [](long double b) { return b != 0; }));
  if (numerator.size() > denominator.size()) {
    return fail("improper", fmt::format("the numerator has degree {}, the denominator {}: the transfer function is "
                                        "improper",
                                        numerator.size() - 1, denominator.size() - 1));
  }
  TransferFunction g{.domain = c.domain, .sample_time_s = c.sample_time_s};
  g.delay_s = c.domain == Domain::kZ ? c.delay_samples * c.sample_time_s : c.delay_s;
  g.poles = roots_about(denominator, c.domain);
  g.gain = numerator.empty() ? 0.0 : static_cast<double>(numerator[0] / denominator[0]);
  if (!numerator.empty()) g.zeros = roots_about(numerator, c.domain);
  // A zero at the origin of the z plane is a sample less of delay.
  for (int delay = c.domain == Domain::kZ ? c.delay_samples : 0; delay > 0; --delay) {
    const auto at_origin = std::find(g.zeros.begin(), g.zeros.end(), Complex(0));
    if (at_origin == g.zeros.end()) break;
    g.zeros.erase(at_origin);
    g.delay_s = (delay - 1) * c.sample_time_s;
  }
  return g;
}

bool is_stable(const TransferFunction& g) {
  return std::all_of(g.poles.begin(), g.poles.end(),
                     [&](Complex p) { return g.domain == Domain::kZ ? std::abs(p) < 1 : p.real() < 0; });
}

double static_gain(const TransferFunction& g) {
  const double rest = g.domain == Domain::kZ ? 1.0 : 0.0;
  TransferFunction others = g;
  const auto zeros_at_rest = std::erase(others.zeros, Complex(rest));
  const auto poles_at_rest = std::erase(others.poles, Complex(rest));
  if (zeros_at_rest > poles_at_rest) return 0;
  if (zeros_at_rest < poles_at_rest) return std::numeric_limits<double>::infinity();
  return ratio(others, 0, rest).real();
}

std::vector<Complex> frequency_response(const TransferFunction& g, std::span<const double> frequency_hz) {
  std::vector<Complex> response;
  response.reserve(frequency_hz.size());
  for (double f : frequency_hz) {
    const double omega = 2 * std::numbers::pi * f;
    const Complex delay = std::polar(1.0, -omega * g.delay_s);
    if (g.domain == Domain::kS) {
      response.push_back(ratio(g, {0, omega}, 0) * delay);
      continue;
    }
    // e^(jθ) − 1 without cancellation: poles near z = 1 are told apart at the lowest frequencies.
    const double theta = omega * g.sample_time_s;
    const double half = std::sin(theta / 2);
    response.push_back(ratio(g, {-2 * half * half, std::sin(theta)}, 1) * delay);
  }
  return response;
}

}  // namespace valvetriage
