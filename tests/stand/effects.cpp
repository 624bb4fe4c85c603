#include "tests/stand/effects.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

using Parameters = std::vector<EffectParameter>;

/// What an effect is made from. `at_s` is the instant inside the one recording it may be confined to.
struct Draft {
  double size;
  const Unit& unit;
  Random& random;
  Faults& faults;
  double at_s;

  double sign() const { return random.uniform() < 0.5 ? -1.0 : 1.0; }
  void need(bool possible, const char* why) const {
    if (!possible) throw std::invalid_argument(why);
  }
};

struct Effect {
  EffectInfo info;
  Parameters (*apply)(const Draft&);
  bool in_one_recording = false;
};

Parameters friction(const Draft& d) {
  const double kinetic = d.size * d.random.uniform(0.55, 0.85);
  d.faults.breakaway_a = d.size;
  d.faults.kinetic_a = kinetic;
  return {{"breakaway_A", d.size, "A"}, {"kinetic_A", kinetic, "A"}};
}

Parameters backlash(const Draft& d) {
  d.faults.backlash_a = d.size;
  return {{"width_A", d.size, "A"}};
}

Parameters hysteresis(const Draft& d) {
  d.faults.loop_a = d.size;
  return {{"width_A", d.size, "A"}};
}

Parameters dead_band(const Draft& d) {
  d.faults.dead_width_a = d.size;
  d.faults.dead_centre_a = d.random.uniform(1.42, 1.85);
  return {{"centre_A", d.faults.dead_centre_a, "A"}, {"width_A", d.size, "A"}};
}

Parameters saturation(const Draft& d) {
  d.faults.ceiling_psi = steady_pressure_psi(d.unit, 2.0) - d.size;
  d.need(d.faults.ceiling_psi > 5, "saturation: the size must leave a ceiling above 5 psi");
  return {{"level_psi", d.faults.ceiling_psi, "psi"}};
}

Parameters gain_loss(const Draft& d) {
  d.need(d.size < 1, "gain_loss: the size must be below 1");
  d.faults.pressure_ratio = 1 - d.size;
  return {{"ratio", 1 - d.size, ""}};
}

Parameters static_curve(const Draft& d) {
  d.need(d.size < 0.9, "static_curve: the size must be below 0.9, the map would turn");
  d.faults.curvature = d.sign() * d.size;
  return {{"curvature", d.faults.curvature, ""}};
}

Parameters rectified_sensor(const Draft& d) {
  d.faults.rectified = d.size > 0;
  return {};
}

Parameters transport_delay(const Draft& d) {
  d.faults.delay_s = d.size;
  return {{"delay_s", d.size, "s"}};
}

Parameters extra_lag(const Draft& d) {
  d.need(d.size >= 5e-5, "extra_lag: below 0.05 ms nothing at 200 Hz shows it");
  d.faults.extra_lag_s = d.size;
  return {{"time_constant_s", d.size, "s"}};
}

Parameters resonance(const Draft& d) {
  d.need(d.size >= 1e-3, "resonance: above 1000 Hz nothing at 200 Hz shows it");
  d.faults.mode_period_s = d.size;
  d.faults.mode_damping = d.random.log_uniform(0.03, 0.2);
  return {{"frequency_hz", 1 / d.size, "Hz"}, {"damping_ratio", d.faults.mode_damping, ""}};
}

Parameters rate_limit(const Draft& d) {
  d.faults.slew_a_per_s = 1 / d.size;
  return {{"limit_A_per_s", 1 / d.size, "A/s"}};
}

Parameters asymmetric_response(const Draft& d) {
  d.faults.fall_to_rise = 1 + d.size;
  return {{"fall_to_rise_ratio", 1 + d.size, ""}};
}

Parameters leakage(const Draft& d) {
  d.faults.leak_fraction = d.size;
  return {{"loss_fraction", d.size, ""}};
}

Parameters orifice_flow(const Draft& d) {
  d.need(d.unit.outflow_exponent - d.size > 0.1, "orifice_flow: the size must leave an exponent above 0.1");
  d.faults.exponent_loss = d.size;
  return {{"exponent", d.unit.outflow_exponent - d.size, ""}};
}

Parameters stiffening_spring(const Draft& d) {
  d.faults.spring_cubic = d.size;
  const double full_psi = steady_pressure_psi(d.unit, 2.0) - steady_pressure_psi(d.unit, 1.0);
  return {{"cubic_coefficient", d.size / (full_psi * full_psi), "1/psi2"}};
}

Parameters self_oscillation(const Draft& d) {
  d.faults.hunting_psi = d.size;
  d.faults.hunting_hz = d.random.log_uniform(3, 14);
  d.faults.hunting_level_psi = d.random.uniform() < 0.5 ? 120 : 160;
  return {{"frequency_hz", d.faults.hunting_hz, "Hz"},
          {"amplitude_psi", d.size, "psi"},
          {"strongest_at_psi", d.faults.hunting_level_psi, "psi"}};
}

Parameters periodic_disturbance(const Draft& d) {
  d.faults.tone_psi = d.size;
  d.faults.tone_hz = d.random.log_uniform(0.7, 40);
  return {{"frequency_hz", d.faults.tone_hz, "Hz"}, {"amplitude_psi", d.size, "psi"}};
}

Parameters thermal_drift(const Draft& d) {
  d.need(d.size < 0.7, "thermal_drift: the size must be below 0.7");
  d.faults.warming_gain_change = -d.size;
  d.faults.warming_time_constant_s = d.random.uniform(2, 6);
  return {{"gain_change", -d.size, ""}, {"time_constant_s", d.faults.warming_time_constant_s, "s"}};
}

Parameters sensor_offset(const Draft& d) {
  d.faults.offset_psi = d.sign() * d.size;
  return {{"offset_psi", d.faults.offset_psi, "psi"}};
}

Parameters sensor_drift(const Draft& d) {
  d.faults.drift_psi_per_s = d.sign() * d.size;
  return {{"drift_psi_per_s", d.faults.drift_psi_per_s, "psi/s"}};
}

Parameters intermittent(const Draft& d) {
  d.need(d.size <= 1, "intermittent: the size must not be above 1");
  d.faults.contact_gain_change = -d.size;
  d.faults.contact_s = d.at_s;
  return {{"time_s", d.at_s, "s"}, {"gain_change", -d.size, ""}};
}

/// The size is in psi of output per 1 % of the channel's nominal value, so that both channels weigh alike.
Parameters side_input(const Draft& d) {
  const bool warm = d.random.uniform() < 0.5;
  double& coefficient = warm ? d.faults.psi_per_c : d.faults.psi_per_supply_psi;
  coefficient = d.sign() * d.size / (warm ? 0.4 : 4.8);
  return {
      {warm ? "coefficient of temperature_C" : "coefficient of supply_psi", coefficient, warm ? "psi/C" : "psi/psi"}};
}

Parameters telegraph_gain(const Draft& d) {
  d.faults.telegraph_gain = d.sign() * d.size;
  return {{"gain_change", d.faults.telegraph_gain, ""}};
}

Parameters pump_surge(const Draft& d) {
  d.need(d.size < 0.9, "pump_surge: the size must be below 0.9");
  d.faults.surge_share = d.size;
  return {{"supply_share_lost", d.size, ""}};
}

Parameters entrained_air(const Draft& d) {
  d.faults.entrained_air = d.size;
  return {{"compressibility_ratio_at_26_psi", d.size, ""}};
}

Parameters clock_drift(const Draft& d) {
  d.faults.clock_error = d.size;
  return {{"clock_error", d.size, "s/s"}};
}

Parameters sticky_gauge_tube(const Draft& d) {
  d.faults.tube_stick_psi = d.size;
  return {{"breakaway_psi", d.size, "psi"}};
}

Parameters creep(const Draft& d) {
  d.need(d.size < 1, "creep: the size must be below 1");
  d.faults.creep = d.size;
  return {{"late_share", d.size, ""}};
}

const std::vector<Effect>& effects() {
  static const std::vector<Effect> table = {
      {{"friction", "valve", "memory", "breakaway [A]", 0.0005, 0.018, 0.022, 0.065}, friction},
      {{"backlash", "valve", "memory", "full width [A]", 0.0007, 0.026, 0.015, 0.045}, backlash},
      {{"hysteresis", "valve", "memory", "full width of the major loop at mid range [A]", 0.0014, 0.12, 0.015, 0.045},
       hysteresis},
      {{"dead_band", "valve", "static", "width [A]", 0.00018, 0.014, 0.02, 0.06}, dead_band},
      {{"saturation", "either", "static", "ceiling below the pressure at 2.0 A [psi]", 0.1, 7, 12, 40}, saturation},
      {{"gain_loss", "valve", "static", "1 - y / y of the healthy unit", 0.016, 0.6, 0.05, 0.15}, gain_loss},
      {{"static_curve", "valve", "static", "|c| of y + c R q (1 - q)", 0.0042, 0.35, 0.06, 0.2}, static_curve},
      {{"rectified_sensor", "stand", "static", "1: magnitude only (bipolar plants)", 1, 1, 1, 1}, rectified_sensor},
      {{"transport_delay", "either", "timing", "excess delay [s]", 0.0008, 0.015, 0.01, 0.03}, transport_delay},
      {{"extra_lag", "valve", "timing", "time constant of one more lag [s]", 0.0008, 0.016, 0.045, 0.16}, extra_lag},
      {{"resonance", "either", "timing", "period of the mode [s]", 0.006, 0.03, 0.04, 0.12}, resonance},
      {{"rate_limit", "valve", "timing", "1 / limit [s/A]", 0.004, 0.018, 0.15, 0.6}, rate_limit},
      {{"asymmetric_response", "valve", "timing", "fall-to-rise ratio of the time constants, less 1", 0.0018, 0.14, 0.6,
        2},
       asymmetric_response},
      {{"leakage", "valve", "flow", "loss over through-flow at 210 psi", 0.003, 0.36, 0.035, 0.12}, leakage},
      {{"orifice_flow", "either", "flow", "exponent of the outflow, lowered by", 0.0022, 0.18, 0.01, 0.03},
       orifice_flow},
      {{"stiffening_spring", "valve", "flow", "cubic over linear force at full travel", 0.0033, 0.15, 0.05, 0.2},
       stiffening_spring},
      {{"self_oscillation", "valve", "disturbance", "amplitude where strongest [psi]", 0.012, 1.2, 2, 8},
       self_oscillation},
      {{"periodic_disturbance", "stand", "disturbance", "amplitude [psi]", 0.0068, 0.68, 2, 6}, periodic_disturbance},
      {{"thermal_drift", "valve", "slow", "share of gain lost when warm", 0.0003, 0.03, 0.1, 0.3}, thermal_drift},
      {{"sensor_offset", "stand", "slow", "|offset| [psi]", 0.3, 30, 5, 15}, sensor_offset},
      {{"sensor_drift", "stand", "slow", "|drift| [psi/s]", 0.001, 0.095, 0.3, 1.0}, sensor_drift},
      {{"intermittent", "either", "slow", "share of gain lost at an instant of one recording", 0.0002, 0.016, 0.1, 0.3},
       intermittent,
       true},
      {{"side_input", "stand", "slow", "|psi| per 1 % of the channel", 0.008, 0.7, 2, 6}, side_input},
      {{"telegraph_gain", "valve", "outside", "gain that comes and goes at random", 0.0001, 0.009, 0.03, 0.1, false},
       telegraph_gain},
      {{"pump_surge", "stand", "outside", "share of supply lost while the accumulator is empty", 0.0003, 0.03, 0.05,
        0.15, false},
       pump_surge},
      {{"entrained_air", "stand", "outside", "compressibility of the air at 26 psi over that of the fluid", 0.0028,
        0.21, 0.5, 1.5, false},
       entrained_air},
      {{"clock_drift", "stand", "outside", "the pressure's clock runs slow by [s/s]", 0.000005, 0.0004, 0.001, 0.004,
        false},
       clock_drift},
      {{"sticky_gauge_tube", "stand", "outside", "pressure difference that frees the gauge [psi]", 0.02, 1.25, 2, 6,
        false},
       sticky_gauge_tube},
      {{"creep", "valve", "outside", "share of the response that creeps in over three decades of time", 0.00035, 0.032,
        0.05, 0.15, false},
       creep},
  };
  return table;
}

const Effect& effect_named(const std::string& name) {
  for (const Effect& effect : effects())
    if (effect.info.effect == name) return effect;
  throw std::invalid_argument("the stand has no effect '" + name + "' (see `valvetriage_stand effects`)");
}

/// Hides one effect in every recording, or in the one that is drawn for it.
HiddenEffect hide(const EffectRequest& request, const Unit& unit, const std::vector<Command>& commands,
                  std::uint64_t seed, std::vector<Faults>& faults) {
  const Effect& effect = effect_named(request.effect);
  if (!(request.size >= 0) || !std::isfinite(request.size))
    throw std::invalid_argument("effect '" + request.effect + "': the size must be a number of at least zero");
  HiddenEffect hidden{effect.info, request.size, {}, ""};
  if (request.size == 0) return hidden;
  Random place(seed, "place of " + request.effect);
  const auto only = static_cast<std::size_t>(place.below(static_cast<int>(commands.size())));
  const double at_s = place.uniform(0.3, 0.7) * commands[only].duration_s();
  for (std::size_t i = 0; i < commands.size(); ++i) {
    if (effect.in_one_recording && i != only) continue;
    Random random(seed, "effect " + request.effect);
    hidden.parameters = effect.apply({request.size, unit, random, faults[i], at_s});
  }
  if (effect.in_one_recording) hidden.recording = commands[only].name;
  return hidden;
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

const EffectInfo& effect_info(const std::string& effect) {
  return effect_named(effect).info;
}

SpoiledSession hide_effects(const std::vector<EffectRequest>& requests, const Unit& unit,
                            const std::vector<Command>& commands, std::uint64_t seed) {
  for (std::size_t i = 0; i < requests.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (requests[i].effect == requests[j].effect)
        throw std::invalid_argument("effect '" + requests[i].effect + "' is asked for twice");
  SpoiledSession spoiled;
  spoiled.faults.resize(commands.size());
  for (const EffectRequest& request : requests)
    spoiled.truth.push_back(hide(request, unit, commands, seed, spoiled.faults));
  return spoiled;
}

}  // namespace valvetriage::stand
