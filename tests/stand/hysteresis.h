#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace valvetriage::stand {

/// Rate-independent magnetic memory, Prandtl-Ishlinskii: a weighted sum of plays of half widths r_1 … r_n.
///
///   h = i + w Σ_j (F_j(i) − i) / n      F_j ← max(i − r_j, min(i + r_j, F_j))
///
/// The full width of the major loop is 2 w mean(r). Source: Brokate and Sprekels, Hysteresis and Phase Transitions,
/// 1996.
class MagneticMemory {
 public:
  explicit MagneticMemory(double loop_width_a)
      : weight_(loop_width_a / (2 * kLargestPlayA * (kPlays + 1) / (2.0 * kPlays))) {}

  /// Effective current [A] if the current went monotonically from the last `remember` to `current_a`.
  double effective_a(double current_a) const {
    double sum = 0;
    for (std::size_t j = 0; j < kPlays; ++j) sum += played(j, current_a) - current_a;
    return current_a + weight_ * sum / kPlays;
  }
  /// Makes `current_a` the point from which the next monotone branch starts.
  void remember(double current_a) {
    for (std::size_t j = 0; j < kPlays; ++j) play_[j] = played(j, current_a);
  }

 private:
  static constexpr std::size_t kPlays = 12;
  static constexpr double kLargestPlayA = 0.12;

  double played(std::size_t j, double current_a) const {
    const double half_width_a = kLargestPlayA * static_cast<double>(j + 1) / kPlays;
    return std::max(current_a - half_width_a, std::min(current_a + half_width_a, play_[j]));
  }
  double weight_;
  std::array<double, kPlays> play_{};
};

}  // namespace valvetriage::stand
