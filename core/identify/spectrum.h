#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace valvetriage {

/// Discrete Fourier transform of a real signal of any length.
///
///   X_k = Σ_{t=0}^{n−1} x_t e^(−2πj k t / n),   k = 0 … n/2
///
/// Lengths with no prime factor above 5 are transformed as they are; any other length goes through Bluestein's
/// convolution (IEEE Trans. Audio Electroacoust. 18, 1970) at such a length, so that no length is slow: Eigen's
/// transform alone is quadratic in a large prime, and an upload chooses its length.
///
/// x        n ≥ 1 values
/// returns  n/2 + 1 lines, unit of x (not divided by n)
/// Cost     O(n log n) for every n
std::vector<std::complex<double>> spectrum(std::span<const double> x);

/// Largest length ≤ n without a prime factor above 5; n ≥ 1.
std::size_t smooth_length_below(std::size_t n);
/// Smallest length ≥ n without a prime factor above 5.
std::size_t smooth_length_above(std::size_t n);

/// A sine and a cosine of one frequency in a signal, by least squares, whatever its samples' times.
class SineFit {
 public:
  /// angle_rad  2π f t of the sample
  void add(double angle_rad, double value);
  /// Amplitudes of sine and cosine, unit of the values; 0 where the angles tell none.
  struct Amplitudes {
    double sine = 0, cosine = 0;
    double power() const { return sine * sine + cosine * cosine; }
    double phase_rad() const;  ///< of the sine that they are together
  };
  Amplitudes amplitudes() const;

 private:
  double ss_ = 0, sc_ = 0, cc_ = 0, se_ = 0, ce_ = 0;
};

/// Circular autocovariance of x − mean x padded with zeros: r_l = Σ_t x_t x_{t+l}, l = 0 … n − 1. Cost O(n log n).
std::vector<double> autocovariance(std::span<const double> x);

}  // namespace valvetriage
