#include "core/identify/spectrum.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <unsupported/Eigen/FFT>

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

bool is_smooth(std::size_t n) {
  for (const std::size_t factor : {2u, 3u, 5u}) {
    while (n % factor == 0) n /= factor;
  }
  return n == 1;
}

std::vector<Complex> transform(const std::vector<Complex>& x) {
  Eigen::FFT<double> fft;
  std::vector<Complex> lines;
  fft.fwd(lines, x);
  return lines;
}

/// e^(−πj t² / n): t² modulo 2n first, so that the angle stays exact.
Complex chirp(std::size_t t, std::size_t n) {
  const auto square = static_cast<std::size_t>(static_cast<unsigned __int128>(t) * t % (2 * n));
  return std::polar(1.0, -std::numbers::pi * static_cast<double>(square) / static_cast<double>(n));
}

/// X_k = c_k Σ_t (x_t c_t) conj(c_{k−t}),  c the chirp: a convolution of a length that may be chosen.
std::vector<Complex> by_convolution(std::span<const double> x) {
  const std::size_t n = x.size();
  const std::size_t length = smooth_length_above(2 * n - 1);
  std::vector<Complex> signal(length), kernel(length);
  for (std::size_t t = 0; t < n; ++t) {
    const Complex c = chirp(t, n);
    signal[t] = x[t] * c;
    kernel[t] = std::conj(c);
    if (t > 0) kernel[length - t] = std::conj(c);
  }
  std::vector<Complex> product = transform(signal);
  const std::vector<Complex> other = transform(kernel);
  // The inverse transform as a forward one of the conjugate.
  for (std::size_t k = 0; k < length; ++k) product[k] = std::conj(product[k] * other[k]);
  product = transform(product);
  std::vector<Complex> lines(n / 2 + 1);
  for (std::size_t k = 0; k < lines.size(); ++k) {
    lines[k] = std::conj(product[k]) / static_cast<double>(length) * chirp(k, n);
  }
  return lines;
}

}  // namespace

std::size_t smooth_length_below(std::size_t n) {
  while (!is_smooth(n)) --n;
  return n;
}

std::size_t smooth_length_above(std::size_t n) {
  while (!is_smooth(n)) ++n;
  return n;
}

std::vector<Complex> spectrum(std::span<const double> x) {
  if (!is_smooth(x.size())) return by_convolution(x);
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<Complex> lines;
  const std::vector<double> copy(x.begin(), x.end());
  if (copy.size() == 1) return {copy.front()};
  fft.fwd(lines, copy);
  lines.resize(copy.size() / 2 + 1);
  return lines;
}

void SineFit::add(double angle_rad, double value) {
  const double s = std::sin(angle_rad), c = std::cos(angle_rad);
  ss_ += s * s, sc_ += s * c, cc_ += c * c, se_ += s * value, ce_ += c * value;
}

double SineFit::Amplitudes::phase_rad() const {
  return std::atan2(cosine, sine);
}

SineFit::Amplitudes SineFit::amplitudes() const {
  const double determinant = ss_ * cc_ - sc_ * sc_;
  if (!(determinant > 0)) return {};
  return {(cc_ * se_ - sc_ * ce_) / determinant, (ss_ * ce_ - sc_ * se_) / determinant};
}

std::vector<double> autocovariance(std::span<const double> x) {
  const std::size_t n = x.size();
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(n);
  const std::size_t length = smooth_length_above(2 * n);
  std::vector<Complex> padded(length);
  for (std::size_t t = 0; t < n; ++t) padded[t] = x[t] - mean;
  std::vector<Complex> lines = transform(padded);
  for (Complex& line : lines) line = std::norm(line);
  lines = transform(lines);
  std::vector<double> r(n);
  for (std::size_t l = 0; l < n; ++l) r[l] = lines[l].real() / static_cast<double>(length);
  return r;
}

}  // namespace valvetriage
