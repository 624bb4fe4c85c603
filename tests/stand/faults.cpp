#include "tests/stand/faults.h"

#include <functional>
#include <stdexcept>

#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

struct Draft {
  double size;
  const Unit& unit;
  Random& random;
  Faults& faults;
};
using Parameters = std::vector<EffectParameter>;

struct Effect {
  EffectInfo info;
  Parameters (*apply)(Draft);
};

Parameters friction(Draft d) {
  const double kinetic = d.size * d.random.uniform(0.55, 0.85);
  d.faults.breakaway_a += d.size;
  d.faults.kinetic_a += kinetic;
  return {{"breakaway_A", d.size, "A"}, {"kinetic_A", kinetic, "A"}};
}

Parameters leakage(Draft d) {
  d.faults.leak_fraction += d.size;
  return {{"loss_fraction", d.size, ""}};
}

Parameters extra_lag(Draft d) {
  d.faults.extra_lag_s += d.size;
  return {{"time_constant_s", d.size, "s"}};
}

Parameters thermal_drift(Draft d) {
  d.faults.warming_gain_change = -d.size;
  d.faults.warming_time_constant_s = d.random.uniform(3, 8);
  return {{"gain_change", -d.size, ""}, {"time_constant_s", d.faults.warming_time_constant_s, "s"}};
}

Parameters sensor_offset(Draft d) {
  d.faults.offset_psi += d.size;
  return {{"offset_psi", d.size, "psi"}};
}

Parameters sensor_drift(Draft d) {
  d.faults.drift_psi_per_s += d.size;
  return {{"drift_psi_per_s", d.size, "psi/s"}};
}

const std::vector<Effect>& effects() {
  static const std::vector<Effect> table = {
      {{"friction", "valve", "memory", "breakaway over the healthy one [A]", true, 0.012, 0.035}, friction},
      {{"leakage", "valve", "flow", "loss over through-flow at 210 psi, over the healthy one", true, 0.06, 0.18},
       leakage},
      {{"extra_lag", "valve", "timing", "time constant of one more lag [s]", true, 0.05, 0.15}, extra_lag},
      {{"thermal_drift", "valve", "slow", "fraction of gain lost when warm", true, 0.05, 0.15}, thermal_drift},
      {{"sensor_offset", "stand", "slow", "offset [psi]", true, 5, 15}, sensor_offset},
      {{"sensor_drift", "stand", "slow", "drift [psi/s]", true, 0.3, 1.0}, sensor_drift},
  };
  return table;
}

}  // namespace

const std::vector<EffectInfo>& effect_table() {
  static const std::vector<EffectInfo> table = [] {
    std::vector<EffectInfo> rows;
    for (const Effect& effect : effects()) rows.push_back(effect.info);
    return rows;
  }();
  return table;
}

HiddenEffect apply_effect(const EffectRequest& request, const Unit& unit, std::uint64_t seed, Faults& faults) {
  if (!(request.size >= 0))
    throw std::invalid_argument("effect '" + request.effect + "': the size must not be negative");
  for (const Effect& effect : effects()) {
    if (effect.info.effect != request.effect) continue;
    Random random(seed, "effect " + request.effect);
    Faults scratch;
    Faults& target = request.size > 0 ? faults : scratch;
    const EffectInfo& info = effect.info;
    return {info.effect,
            info.origin,
            info.family,
            request.size,
            info.size_meaning,
            info.in_vocabulary,
            effect.apply({request.size, unit, random, target})};
  }
  throw std::invalid_argument("the stand has no effect '" + request.effect + "'");
}

}  // namespace valvetriage::stand
