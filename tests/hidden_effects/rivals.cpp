#include "tests/hidden_effects/rivals.h"

#include <algorithm>
#include <cmath>

namespace valvetriage::hidden_effects {
namespace {

using stand::Faults;
using stand::Unit;
using Values = std::span<const double>;

std::vector<double> log_grid(double low, double high, int count) {
  std::vector<double> grid;
  for (int i = 0; i < count; ++i) grid.push_back(low * std::pow(high / low, (i + 0.5) / count));
  return grid;
}

/// The size of an effect over the range that the stand gives it, a little wider; `count` values on the screening grid.
Axis size_of(const std::string& effect, int count) {
  const stand::EffectInfo& info = stand::effect_info(effect);
  return {0.5 * info.smallest, 1.5 * info.largest, true, log_grid(info.smallest, info.largest, count)};
}

}  // namespace

double Axis::coordinate(double value) const {
  return logarithmic ? std::log(value) : value;
}

double Axis::value(double coordinate) const {
  return std::clamp(logarithmic ? std::exp(coordinate) : coordinate, low, high);
}

const std::vector<Rival>& simulated_rivals() {
  static const std::vector<Rival> table = {
      {"friction",
       {size_of("friction", 9), {0.3, 1, false, {0.7}}},
       [](Values p, const Unit&, Faults& f) {
         f.breakaway_a += p[0];
         f.kinetic_a += p[0] * p[1];
       }},
      {"backlash", {size_of("backlash", 8)}, [](Values p, const Unit&, Faults& f) { f.backlash_a += p[0]; }},
      {"hysteresis", {size_of("hysteresis", 6)}, [](Values p, const Unit&, Faults& f) { f.loop_a += p[0]; }},
      {"dead_band",
       {size_of("dead_band", 6), {1.3, 1.95, false, {1.45, 1.6, 1.75, 1.85}}},
       [](Values p, const Unit&, Faults& f) {
         f.dead_width_a = p[0];
         f.dead_centre_a = p[1];
       }},
      {"saturation",
       {size_of("saturation", 10)},
       [](Values p, const Unit& unit, Faults& f) { f.ceiling_psi = stand::steady_pressure_psi(unit, 2.0) - p[0]; }},
      {"gain_loss",
       {{-0.5, 0.6, false, {-0.2, -0.05, 0.02, 0.1, 0.3}}},
       [](Values p, const Unit&, Faults& f) { f.pressure_ratio = 1 - p[0]; }},
      {"static_curve",
       {{-0.8, 0.8, false, {-0.4, -0.15, -0.03, 0.03, 0.15, 0.4}}},
       [](Values p, const Unit&, Faults& f) { f.curvature = p[0]; }},
      {"transport_delay", {size_of("transport_delay", 6)}, [](Values p, const Unit&, Faults& f) { f.delay_s += p[0]; }},
      {"extra_lag", {size_of("extra_lag", 7)}, [](Values p, const Unit&, Faults& f) { f.extra_lag_s = p[0]; }},
      {"resonance",
       {size_of("resonance", 12), {0.01, 0.7, true, {0.08}}},
       [](Values p, const Unit&, Faults& f) {
         f.mode_period_s = p[0];
         f.mode_damping = p[1];
       }},
      {"rate_limit", {size_of("rate_limit", 8)}, [](Values p, const Unit&, Faults& f) { f.slew_a_per_s = 1 / p[0]; }},
      {"asymmetric_response",
       {{0.3, 6, true, {0.6, 0.9, 1.1, 1.4, 2, 3.5}}},
       [](Values p, const Unit&, Faults& f) { f.fall_to_rise = p[0]; }},
      {"leakage", {size_of("leakage", 6)}, [](Values p, const Unit&, Faults& f) { f.leak_fraction += p[0]; }},
      {"orifice_flow",
       {{-0.15, 0.15, false, {-0.05, -0.01, 0.003, 0.015, 0.06}}},
       [](Values p, const Unit&, Faults& f) { f.exponent_loss += p[0]; }},
      {"stiffening_spring",
       {size_of("stiffening_spring", 6)},
       [](Values p, const Unit&, Faults& f) { f.spring_cubic += p[0]; }},
      {"thermal_drift",
       {size_of("thermal_drift", 6), {1, 20, true, {2, 6}}},
       [](Values p, const Unit&, Faults& f) {
         f.warming_gain_change = -p[0];
         f.warming_time_constant_s = p[1];
       }},
  };
  return table;
}

}  // namespace valvetriage::hidden_effects
