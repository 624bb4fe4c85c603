// intermittent: an abrupt change of gain at an instant of one recording.
//
//   y ← y (1 + g H(t − t0))   in that recording, H rising over one sample
//
// `recording` is its index in the session. The instant is best found by looking at the residual of each recording; the
// starts are one per recording, in its middle.
//
// Source     change-point in a gain: Basseville and Nikiforov, Detection of Abrupt Changes (1993), chapter 2; loose
// contacts Looks like a recording that is right up to an instant and off by one share of the level from there on
// Confused   with thermal_drift (gradual), side_input, gain_loss (everywhere)

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kTime, kChange, kRecording };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"time_s", "s", "instant of the change, from the start of the recording"},
     {"gain_change", "", "relative change of the output from there on"},
     {"recording", "", "index of the recording in the session, from 0", 0}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"thermal_drift", "gain_loss", "side_input"};
constexpr std::size_t kMostStarts = 6;

MechanismBounds bounds(const MechanismScales& scales) {
  const auto last = static_cast<double>(scales.recordings) - 1;
  MechanismBounds bounds{.lower = {0, -1, 0},
                         .upper = {scales.longest_s, 1, last},
                         .step = {0.5 * scales.sample_period_s, 1e-4, 0},
                         .starts = {}};
  for (std::size_t r = 0; r < std::min(scales.recordings, kMostStarts); ++r) {
    bounds.starts.push_back({0.5 * scales.longest_s, -0.05, static_cast<double>(r)});
  }
  return bounds;
}

/// At an end of its recording it is a gain that one recording has as a whole.
bool is_cut_off(std::span<const double> parameters, std::span<const double> lower, std::span<const double> upper) {
  return parameters[kTime] <= lower[kTime] || parameters[kTime] >= upper[kTime];
}

/// Gain at each sample of the recording it is in.
template <typename Use>
void change_gain(std::span<const double> parameters, const LawContext& context, std::size_t samples, Use use) {
  const bool here = std::llround(parameters[kRecording]) == static_cast<long long>(context.recording);
  if (!here || samples < 2) return;
  const double period = context.time_s[1] - context.time_s[0];
  for (std::size_t i = 0; i < samples; ++i) {
    const double late = (context.time_s[i] - parameters[kTime]) / period;
    use(i, 1 + parameters[kChange] * std::clamp(late + 0.5, 0.0, 1.0));
  }
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  change_gain(parameters, context, y.size(), [&](std::size_t i, double gain) { y[i] *= gain; });
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double>,
             std::span<double> change) {
  change_gain(parameters, context, change.size(), [&](std::size_t i, double gain) { change[i] *= gain; });
}

}  // namespace

extern constinit const Mechanism kIntermittent{
    .order = 22,
    .cause = "intermittent",
    .family = "slow",
    .origin = "either",
    .wrong = "abrupt change of gain at an instant",
    .law = "y ← y (1 + g H(t − t0)) in one recording",
    .source = "Basseville, Nikiforov, Detection of Abrupt Changes (1993), chapter 2",
    .signature = "one recording is right up to an instant and off by one share of the level from there on",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kChange,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr,
    .is_cut_off = is_cut_off};

}  // namespace valvetriage
