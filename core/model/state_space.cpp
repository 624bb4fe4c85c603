#include "core/model/state_space.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <unsupported/Eigen/MatrixFunctions>

#include "core/model/polynomial.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

// A delay this close to a whole number of samples is one: 1e-9 of a sample moves no output beyond rounding.
constexpr double kWholeSampleTolerance = 1e-9;

bool finite(Complex z) {
  return std::isfinite(z.real()) && std::isfinite(z.imag());
}

/// One or two poles and the zeros they carry.
struct Section {
  std::vector<Complex> poles;  // one real, two real, or a conjugate pair with the upper one first
  std::vector<Complex> zeros;
  std::size_t room() const { return poles.size() - zeros.size(); }
  Complex centre() const { return poles.size() == 2 && poles[0].imag() == 0 ? 0.5 * (poles[0] + poles[1]) : poles[0]; }
};

// Real roots in order, and the upper root of every pair.
struct SplitRoots {
  std::vector<double> real;
  std::vector<Complex> upper;
};

Result<SplitRoots> split(const std::vector<Complex>& roots, const char* what) {
  SplitRoots parts;
  std::size_t lower = 0;
  for (const Complex& r : roots) {
    if (!finite(r)) return fail("not_finite", fmt::format("a {} of the transfer function is not finite", what));
    if (r.imag() == 0) parts.real.push_back(r.real());
    if (r.imag() > 0) parts.upper.push_back(r);
    if (r.imag() < 0) ++lower;
  }
  if (lower != parts.upper.size()) {
    return fail("not_conjugate", fmt::format("the complex {}s do not come in conjugate pairs", what));
  }
  std::sort(parts.real.begin(), parts.real.end());
  return parts;
}

std::vector<Section> sections_of(const SplitRoots& poles) {
  std::vector<Section> sections;
  for (const Complex& p : poles.upper) sections.push_back({{p, std::conj(p)}, {}});
  std::size_t i = 0;
  for (; i + 1 < poles.real.size(); i += 2) sections.push_back({{poles.real[i], poles.real[i + 1]}, {}});
  if (i < poles.real.size()) sections.push_back({{poles.real[i]}, {}});
  return sections;
}

// The nearest section that has room takes the zero. Pairs go first: they need a whole section.
void place_zeros(std::vector<Section>& sections, const SplitRoots& zeros) {
  const auto nearest = [&](Complex z, std::size_t needed) {
    Section* best = nullptr;
    for (Section& s : sections) {
      if (s.room() >= needed && (best == nullptr || std::abs(s.centre() - z) < std::abs(best->centre() - z))) best = &s;
    }
    return best;
  };
  for (const Complex& z : zeros.upper) nearest(z, 2)->zeros = {z, std::conj(z)};
  for (double z : zeros.real) nearest(z, 1)->zeros.emplace_back(z);
}

// ∏ (x − zeros[i]) of a section at a real x.
double numerator_at(const Section& s, double x) {
  Complex product = 1;
  for (const Complex& z : s.zeros) product *= x - z;
  return product.real();
}

/// The signal between two sections as a combination of states and input.
struct Signal {
  RowVectorXd row;
  double direct;
};

// (∏ (x − z)) / (x − p):  x₁' = p x₁ + v
void append_first_order(const Section& s, Index i, Signal& v, StateSpace& system) {
  const double p = s.poles[0].real();
  system.a.row(i) += v.row;
  system.a(i, i) = p;
  system.b[i] = v.direct;
  const bool biproper = s.zeros.size() == 1;
  const double c = biproper ? p - s.zeros[0].real() : 1.0;
  if (!biproper) v = {RowVectorXd::Zero(v.row.size()), 0};
  v.row[i] = c;
}

// x₁' = a₁₁ x₁ + a₁₂ x₂ + v,  x₂' = x₁ + a₂₂ x₂; then x₁ is (x − a₂₂)/den and x₂ is 1/den.
void append_second_order(const Section& s, Index i, Signal& v, StateSpace& system) {
  const bool pair = s.poles[0].imag() != 0;
  const double a11 = s.poles[0].real();
  const double a22 = s.poles[1].real();
  const double a12 = pair ? -s.poles[0].imag() * s.poles[0].imag() : 0.0;
  system.a.row(i) += v.row;
  system.a(i, i) = a11;
  system.a(i, i + 1) = a12;
  system.a(i + 1, i) = 1;
  system.a(i + 1, i + 1) = a22;
  system.b[i] = v.direct;
  double c1 = 0, c2 = 1;
  if (s.zeros.size() == 1) {
    c1 = 1;
    c2 = numerator_at(s, a22);
  } else if (s.zeros.size() == 2) {
    c1 = (a11 - s.zeros[0].real()) + (a22 - s.zeros[1].real());
    c2 = numerator_at(s, a22) + a12;
  }
  if (s.zeros.size() < 2) v = {RowVectorXd::Zero(v.row.size()), 0};
  v.row[i] = c1;
  v.row[i + 1] = c2;
}

void append_blocks(const Section& s, std::vector<PoleBlock>& first_to_last) {
  if (s.poles[0].imag() != 0) {
    first_to_last.push_back({s.poles[0].real(), s.poles[0].imag()});
    return;
  }
  for (const Complex& p : s.poles) first_to_last.push_back({p.real(), 0});
}

}  // namespace

Result<StateSpace> cascade(const TransferFunction& g) {
  if (g.zeros.size() > g.poles.size()) {
    return fail("improper", fmt::format("the transfer function has {} zeros and {} poles: it is improper",
                                        g.zeros.size(), g.poles.size()));
  }
  if (!std::isfinite(g.gain) || !std::isfinite(g.delay_s) || g.delay_s < 0) {
    return fail("not_finite", "the gain of the transfer function is not finite or its delay is negative");
  }
  const auto poles = split(g.poles, "pole");
  if (!poles) return tl::unexpected(poles.error());
  const auto zeros = split(g.zeros, "zero");
  if (!zeros) return tl::unexpected(zeros.error());
  std::vector<Section> sections = sections_of(*poles);
  place_zeros(sections, *zeros);

  const auto n = static_cast<Index>(g.poles.size());
  StateSpace system{MatrixXd::Zero(n, n), VectorXd::Zero(n), RowVectorXd::Zero(n), 0, {}};
  Signal v{RowVectorXd::Zero(n), 1};
  Index i = 0;
  for (const Section& s : sections) {
    if (s.poles.size() == 1) {
      append_first_order(s, i, v, system);
    } else {
      append_second_order(s, i, v, system);
    }
    append_blocks(s, system.blocks);
    i += static_cast<Index>(s.poles.size());
  }
  std::reverse(system.blocks.begin(), system.blocks.end());
  system.c = g.gain * v.row;
  system.d = g.gain * v.direct;
  return system;
}

ChainForm chain_form(const MatrixXd& phi, const MatrixXd& gamma, const RowVectorXd& c, const RowVectorXd& d,
                     const std::vector<PoleBlock>& blocks) {
  const Index n = phi.rows();
  ChainForm chain{{}, {}, MatrixXd(n, gamma.cols()), d, blocks};
  RowVectorXd w = c;
  Index row = 0;
  const auto take = [&](double diagonal, double lower) {
    chain.diagonal.push_back(diagonal);
    chain.lower.push_back(lower);
    chain.input.row(row++) = w * gamma;
  };
  for (const PoleBlock& block : blocks) {
    take(block.re, 0);
    RowVectorXd next = w * phi - block.re * w;
    if (block.is_pair()) {
      const RowVectorXd first = w;
      w = next;
      take(block.re, -block.im * block.im);
      next = w * phi - block.re * w + block.im * block.im * first;
    }
    w = next;
    w.tail(row).setZero();  // what Cayley and Hamilton promise, without its rounding
  }
  return chain;
}

TransferFunction chain_transfer_function(const ChainForm& chain, Domain domain, double negligible) {
  // Numerator and denominator grow from the last block to the first, in powers of (x − centre).
  const long double centre = domain == Domain::kZ ? 1.0L : 0.0L;
  Polynomial numerator{0}, denominator{1};
  const auto add_scaled = [](Polynomial& sum, const Polynomial& term, long double factor) {
    if (term.size() > sum.size()) sum.insert(sum.begin(), term.size() - sum.size(), 0);
    for (std::size_t i = 0; i < term.size(); ++i) sum[sum.size() - term.size() + i] += factor * term[i];
  };
  const auto times_linear = [](Polynomial p, long double root) {
    p.push_back(0);
    for (std::size_t i = p.size() - 1; i > 0; --i) p[i] -= root * p[i - 1];
    return p;
  };
  TransferFunction g{.domain = domain};
  Index row = chain.input.rows();
  for (auto block = chain.blocks.rbegin(); block != chain.blocks.rend(); ++block) {
    const long double re = block->re - centre;
    add_scaled(numerator, denominator, chain.input(--row, 0));
    if (block->is_pair()) {
      const Polynomial once = times_linear(denominator, re);
      add_scaled(numerator, once, chain.input(--row, 0));
      Polynomial twice = times_linear(once, re);
      add_scaled(twice, denominator, static_cast<long double>(block->im) * block->im);
      denominator = twice;
      g.poles.emplace_back(block->re, std::abs(block->im));
      g.poles.emplace_back(block->re, -std::abs(block->im));
    } else {
      denominator = times_linear(denominator, re);
      g.poles.emplace_back(block->re, 0);
    }
  }
  add_scaled(numerator, denominator, chain.direct[0]);
  long double largest = 0;
  for (long double c : numerator) largest = std::max(largest, std::abs(c));
  std::size_t leading = 0;
  while (leading + 1 < numerator.size() && std::abs(numerator[leading]) <= negligible * largest) ++leading;
  numerator.erase(numerator.begin(), numerator.begin() + static_cast<std::ptrdiff_t>(leading));
  g.gain = static_cast<double>(numerator[0]);
  if (g.gain == 0) return g;
  g.zeros = roots(numerator);
  for (Complex& z : g.zeros) z += static_cast<double>(centre);
  return g;
}

SplitDelay split_delay(double delay_s, double sample_time_s) {
  const double samples = std::min(delay_s / sample_time_s, kMostDelaySamples);
  const double nearest = std::round(samples);
  if (std::abs(samples - nearest) < kWholeSampleTolerance * std::max(1.0, nearest)) {
    return {static_cast<int>(nearest), 0};
  }
  return {static_cast<int>(std::floor(samples)), samples - std::floor(samples)};
}

namespace {

/// What a stretch of h sample periods does to the state: Φ, and the response to a constant 1 and to a slope 1.
struct Stretch {
  MatrixXd phi;
  VectorXd constant, slope;
};

Stretch stretch(const StateSpace& system, double h) {
  const Index n = system.a.rows();
  MatrixXd augmented = MatrixXd::Zero(n + 2, n + 2);
  augmented.topLeftCorner(n, n) = system.a;
  augmented.block(0, n, n, 1) = system.b;
  augmented(n, n + 1) = 1;
  const MatrixXd e = (augmented * h).exp();
  return {e.topLeftCorner(n, n), e.block(0, n, n, 1), e.block(0, n + 1, n, 1)};
}

// Unit sample period makes every entry a ratio to the sampling rate.
TransferFunction in_sample_periods(TransferFunction g, double sample_time_s) {
  g.gain *= std::pow(sample_time_s, static_cast<double>(g.poles.size()) - static_cast<double>(g.zeros.size()));
  for (Complex& z : g.zeros) z *= sample_time_s;
  for (Complex& p : g.poles) p *= sample_time_s;
  return g;
}

PoleBlock sampled_block(const PoleBlock& s) {
  const double modulus = std::exp(s.re);
  // A pair that folds onto the real axis stays a pair of states.
  const double im = modulus * std::sin(s.im);
  return {modulus * std::cos(s.im), s.is_pair() && im == 0 ? std::numeric_limits<double>::min() : im};
}

}  // namespace

Result<Sampled> sample(const TransferFunction& continuous, double sample_time_s) {
  if (!(sample_time_s > 0) || !std::isfinite(sample_time_s)) {
    return fail("not_positive", fmt::format("the sample time {} s is not positive", sample_time_s));
  }
  const auto system = cascade(in_sample_periods(continuous, sample_time_s));
  if (!system) return tl::unexpected(system.error());
  const double f = split_delay(continuous.delay_s, sample_time_s).fraction;
  const Index n = system->a.rows();
  Sampled result;
  result.c = system->c;
  for (const PoleBlock& block : system->blocks) result.blocks.push_back(sampled_block(block));
  const Stretch late = stretch(*system, 1 - f);
  if (f == 0) {
    result.phi = late.phi;
    result.gamma.resize(n, 2);
    result.gamma << late.constant, late.slope;
    result.direct = Eigen::RowVector2d(system->d, 0);
    return result;
  }
  const Stretch early = stretch(*system, f);
  result.phi = late.phi * early.phi;
  result.gamma.resize(n, 4);
  result.gamma << late.constant, late.slope, late.phi * early.constant,
      late.phi * (early.constant * (1 - f) + early.slope);
  result.direct = Eigen::RowVector4d(0, 0, system->d, system->d * (1 - f));
  return result;
}

}  // namespace valvetriage
