#include "core/identify/spool_rests.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace valvetriage {
namespace {

// A window is as long as the volume takes, in samples no fewer than these on either side.
constexpr std::ptrdiff_t kFewestAround = 4;
// Standard deviations that a pressure which stands still may wander.
constexpr double kStill = 4;
// Where the map rises less than this share of what it does in the mean, a pressure tells no position.
constexpr double kSteepEnough = 0.1;
// While the spool slips the input moves by less than this share of the slip.
constexpr double kHardlyMoves = 0.3;

/// The steady pressure that a volume follows, from a straight line through a window around each sample: its height, and
/// its slope times the time constant.
class SteadyPressure {
 public:
  SteadyPressure(const Recording& recording, double time_constant_s, double noise_psi)
      : recording_(recording),
        around_(std::max<std::ptrdiff_t>(
            kFewestAround, std::lround(0.5 * std::min(time_constant_s / recording.sample_period_s, 1e6)))),
        lag_(time_constant_s / recording.sample_period_s) {
    const double n = static_cast<double>(2 * around_ + 1);
    squares_ = n * (n * n - 1) / 12;
    sd_psi_ = noise_psi * std::sqrt(1 / n + lag_ * lag_ / squares_);
  }

  std::ptrdiff_t around() const { return around_; }
  double sd_psi() const { return sd_psi_; }

  /// NaN where the window leaves the recording or a sample in it is missing.
  double at(std::ptrdiff_t sample) const {
    const auto samples = static_cast<std::ptrdiff_t>(recording_.samples());
    if (sample < around_ || sample + around_ >= samples) return std::numeric_limits<double>::quiet_NaN();
    double sum = 0, moment = 0;
    for (std::ptrdiff_t k = -around_; k <= around_; ++k) {
      const auto i = static_cast<std::size_t>(sample + k);
      if (!recording_.is_valid(i)) return std::numeric_limits<double>::quiet_NaN();
      sum += recording_.output.values[i];
      moment += static_cast<double>(k) * recording_.output.values[i];
    }
    return sum / static_cast<double>(2 * around_ + 1) + lag_ * moment / squares_;
  }

 private:
  const Recording& recording_;
  std::ptrdiff_t around_;
  double lag_, squares_ = 0, sd_psi_ = 0;
};

}  // namespace

std::vector<double> spool_rests(const Recording& recording, const ValveParameters& valve, const StaticMap& map,
                                double gauge_lag_s, double noise_psi) {
  const double nowhere = std::numeric_limits<double>::quiet_NaN();
  const auto samples = static_cast<std::ptrdiff_t>(recording.samples());
  std::vector<double> rests(recording.samples(), nowhere);
  const SteadyPressure steady(recording, valve.lag_behind_map_s() + gauge_lag_s, noise_psi);
  const double secant = (map.output.back() - map.output.front()) / (map.input.back() - map.input.front());

  const auto close = [&](std::ptrdiff_t first, std::ptrdiff_t end, double mean_psi) {
    if (end - first < steady.around()) return;
    const auto position = map.inverse(mean_psi);
    if (!position || !(map.slope(*position) / secant > kSteepEnough)) return;
    // A rest lasts to the ends of the windows that lie within it.
    const auto from = std::max<std::ptrdiff_t>(0, first == steady.around() ? 0 : first);
    const auto to = end + steady.around() >= samples ? samples : end;
    std::fill(rests.begin() + from, rests.begin() + to, *position);
  };
  std::ptrdiff_t first = 0;
  double sum = 0, count = 0;
  for (std::ptrdiff_t i = 0; i < samples; ++i) {
    const double psi = steady.at(i);
    const bool stands = count > 0 && std::abs(psi - sum / count) <= kStill * steady.sd_psi();
    if (!stands) {
      if (count > 0) close(first, i, sum / count);
      first = i;
      sum = count = 0;
    }
    if (std::isnan(psi)) continue;
    sum += psi;
    ++count;
  }
  if (count > 0) close(first, samples, sum / count);
  return rests;
}

std::vector<Slip> slips_between(std::span<const double> input, std::span<const double> rests) {
  std::vector<Slip> slips;
  std::optional<std::size_t> last;  // sample of the rest before
  for (std::size_t i = 0; i < rests.size(); ++i) {
    if (!std::isfinite(rests[i])) continue;
    if (last && rests[i] != rests[*last]) {
      const double slip = rests[i] - rests[*last], before = input[*last] - rests[*last], after = input[i] - rests[i];
      // A spool sets off and comes to rest behind its input; anything else is one rest taken for two.
      const bool lags = before * slip > 0 && after * slip > 0 && std::abs(after) < std::abs(before);
      if (lags && std::abs(input[i] - input[*last]) < kHardlyMoves * std::abs(slip)) {
        slips.push_back({.direction = slip > 0 ? 1 : -1, .before_a = before, .after_a = after});
      }
    }
    last = i;
  }
  return slips;
}

}  // namespace valvetriage
