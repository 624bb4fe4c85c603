// transport_delay: everything later by a constant time.
//
//   u(t) → u(t − d),   exact to the fraction of a sample
//
// Source     transport in lines, a slow controller cycle, a logger whose channels are not aligned: Merritt, Hydraulic
//            Control Systems (1967), chapter 10
// Looks like the same response, shifted; a phase that falls linearly with frequency, gain unchanged
// Confused   with extra_lag (rounds as well), rate_limit (depends on the step's size)

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{{{"delay_s", "s", "excess over a good valve's delay"}}};
constexpr std::array<std::string_view, 2> kConfusedWith{"extra_lag", "rate_limit"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double period = scales.sample_period_s;
  return one_parameter(0, 0.25 * scales.longest_s, 0.01 * period, {0.5 * period, 3 * period, 12 * period});
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.spool.delay_s += parameters[0];
}

}  // namespace

extern constinit const Mechanism kTransportDelay{
    .order = 9,
    .cause = "transport_delay",
    .family = "timing",
    .origin = "either",
    .wrong = "everything later by a constant time",
    .law = "u(t) → u(t − d)",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 10",
    .signature = "the same response, shifted; the phase falls linearly with frequency, the gain is unchanged",
    .confused_with = kConfusedWith,
    .place = Place::kPhysics,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = nullptr,
    .tangent = nullptr,
    .reshape = reshape};

}  // namespace valvetriage
