// extra_lag: one more, or a slower, first-order lag.
//
//   τ dy/dt = y_in − y,   exact for the parabola through the last three samples, from steady state
//
// Ahead of the static map it is one more pole of coil and spool, behind it a lag of the pressure; in a linear model the
// two are the same.
//
// Source     a second chamber behind a restriction, a clogged gauge line: Merritt, Hydraulic Control Systems (1967),
//            chapter 3; ahead of the map eddy currents or a shorted turn, chapter 10
// Looks like rounder and later edges, the same shape at every step size and level
// Confused   with transport_delay (no rounding), rate_limit (straight edges), asymmetric_response (one direction),
//            hysteresis in one slow triangle at one rate

#include <array>

#include "core/mechanisms/bounds.h"
#include "core/model/gauge.h"

namespace valvetriage {
namespace {

enum Parameter { kTimeConstant, kAhead };

constexpr std::array<MechanismParameter, 2> kParameters{
    {{"time_constant_s", "s", "of the additional lag"},
     {"ahead_of_map", "", "1: of coil or spool, ahead of the static map; 0: of the pressure or its gauge", 0}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"transport_delay", "rate_limit", "asymmetric_response",
                                                        "hysteresis"};

constexpr double kStep_samples = 0.02;
constexpr double kShortest_s = 1e-9;  // a pole faster than this is none

MechanismBounds bounds(const MechanismScales& scales) {
  const double period = scales.sample_period_s;
  MechanismBounds bounds{
      .lower = {0, 0}, .upper = {scales.longest_s, 1}, .step = {kStep_samples * period, 0}, .starts = {}};
  for (const double lag_s : spread(0.5 * period, 0.05 * scales.longest_s, 6)) {
    for (const double ahead : {0.0, 1.0}) bounds.starts.push_back({lag_s, ahead});
  }
  return bounds;
}

bool is_ahead(std::span<const double> parameters) {
  return parameters[kAhead] != 0;
}

void add_to_spool(std::span<const double> parameters, ValveBlocks blocks) {
  if (is_ahead(parameters) && parameters[kTimeConstant] > kShortest_s) {
    blocks.spool.lag_s.push_back(parameters[kTimeConstant]);
  }
}

void filter(std::span<const double> parameters, const LawContext& context, std::span<double> signal) {
  if (signal.size() < 2) return;
  read_behind_lag(parameters[kTimeConstant], context.time_s[1] - context.time_s[0], signal);
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double>,
             std::span<double> change) {
  filter(parameters, context, change);
}

}  // namespace

extern constinit const Mechanism kExtraLag{
    .order = 10,
    .cause = "extra_lag",
    .family = "timing",
    .origin = "valve",
    .wrong = "one more, or a slower, first-order lag",
    .law = "τ dy/dt = y_in − y",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 3",
    .signature = "rounder and later edges, the same shape at every step size and level",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kTimeConstant,
    .neutral = 0,
    .bounds = bounds,
    .apply = filter,
    .tangent = tangent,
    .reshape = add_to_spool,
    .is_in_blocks = is_ahead};

}  // namespace valvetriage
