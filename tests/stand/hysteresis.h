#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace valvetriage::stand {

/// One play (lost motion): the output holds while the input crosses the full width. Branches between two `remember`s
/// must be monotone.
class Play {
 public:
  explicit Play(double width = 0) : half_width_(width / 2) {}
  double at(double input) const { return std::max(input - half_width_, std::min(input + half_width_, output_)); }
  void remember(double input) { output_ = at(input); }

 private:
  double half_width_;
  double output_ = 0;
};

/// Rate-independent magnetic memory, Prandtl-Ishlinskii: a weighted sum of plays of half widths r_1 … r_n.
///
///   h = i + w Σ_j (F_j(i) − i) / n      F_j ← max(i − r_j, min(i + r_j, F_j))
///
/// The full width of the major loop is 2 w mean(r). Source: Brokate and Sprekels, Hysteresis and Phase Transitions,
/// 1996.
class MagneticMemory {
 public:
  /// loop_width full width of the major loop; largest_play the half width of the widest play, both in the input's unit.
  MagneticMemory(double loop_width, double largest_play)
      : weight_(loop_width / (largest_play * (kPlays + 1) / kPlays)) {
    for (std::size_t j = 0; j < kPlays; ++j)
      play_[j] = Play(2 * largest_play * static_cast<double>(j + 1) / static_cast<double>(kPlays));
  }

  /// Effective input if the input went monotonically from the last `remember` to this.
  double at(double input) const {
    double sum = 0;
    for (const Play& play : play_) sum += play.at(input) - input;
    return input + weight_ * sum / kPlays;
  }
  /// Makes this the point from which the next monotone branch starts.
  void remember(double input) {
    for (Play& play : play_) play.remember(input);
  }

 private:
  static constexpr int kPlays = 12;
  double weight_;
  std::array<Play, kPlays> play_;
};

}  // namespace valvetriage::stand
