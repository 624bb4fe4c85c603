#include "tests/second_stand/effects.h"

#include <cmath>
#include <numbers>
#include <set>
#include <stdexcept>

#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/random.h"
#include "tests/second_stand/valve.h"

namespace valvetriage::second_stand {
namespace {

using Parameters = std::vector<Parameter>;

/// What an effect is made from.
struct Making {
  double size;
  const Unit& unit;
  Random random;
  double duration_s;  ///< of the recording
  Faults& faults;
};

void need(bool possible, const std::string& why) {
  if (!possible) throw std::invalid_argument(why);
}

Parameters friction(Making& m) {
  m.faults.breakaway_a = m.size;
  m.faults.kinetic_a = m.size * m.random.between(0.5, 0.9);
  return {{"breakaway_A", m.size, "A"}, {"kinetic_A", m.faults.kinetic_a, "A"}};
}

Parameters backlash(Making& m) {
  m.faults.play_a = m.size;
  return {{"width_A", m.size, "A"}};
}

Parameters hysteresis(Making& m) {
  need(m.size < 0.3, "hysteresis: the size must be below 0.3 A, the loop would not close between 1 A and 2 A");
  m.faults.loop_a = m.size;
  return {{"width_A", m.size, "A"}};
}

Parameters dead_band(Making& m) {
  const double centre_a = m.random.between(1.42, 1.85);
  m.faults.blank_a = m.size;
  m.faults.blank_from_a = centre_a - 0.5 * m.size;
  return {{"centre_A", centre_a, "A"}, {"width_A", m.size, "A"}};
}

Parameters saturation(Making& m) {
  m.faults.stop_psi = steady_psi(m.unit, {}, 2.0) - m.size;
  need(m.faults.stop_psi > 5, "saturation: the size must leave more than 5 psi");
  return {{"level_psi", m.faults.stop_psi, "psi"}};
}

Parameters gain_loss(Making& m) {
  need(m.size < 1, "gain_loss: the size must be below 1");
  m.faults.ratio = 1 - m.size;
  return {{"ratio", 1 - m.size, ""}};
}

Parameters static_curve(Making& m) {
  need(m.size < 0.35, "static_curve: the size must be below 0.35, the port has no more area");
  m.faults.curvature = m.random.sign() * m.size;
  return {{"curvature", m.faults.curvature, ""}};
}

Parameters transport_delay(Making& m) {
  m.faults.gauge_delay_s = m.size;
  return {{"delay_s", m.size, "s"}};
}

Parameters extra_lag(Making& m) {
  m.faults.shorted_turn_s = m.size;
  return {{"time_constant_s", m.size, "s"}};
}

Parameters resonance(Making& m) {
  m.faults.mode_rad_s = 2 * std::numbers::pi / m.size;
  m.faults.mode_damping = m.random.log_between(0.04, 0.2);
  return {{"frequency_hz", 1 / m.size, "Hz"}, {"damping_ratio", m.faults.mode_damping, ""}};
}

Parameters rate_limit(Making& m) {
  m.faults.slew_a_per_s = 1 / m.size;
  return {{"limit_A_per_s", 1 / m.size, "A/s"}};
}

Parameters asymmetric_response(Making& m) {
  m.faults.fall_to_rise = 1 + m.size;
  return {{"fall_to_rise_ratio", 1 + m.size, ""}};
}

Parameters leakage(Making& m) {
  m.faults.leak_fraction = m.size;
  return {{"loss_fraction", m.size, ""}};
}

Parameters orifice_flow(Making& m) {
  const double exponent = Outlet(m.unit).exponent_at_120() + m.size;
  need(exponent < 1, "orifice_flow: the size must leave an exponent below 1");
  m.faults.exponent_added = m.size;
  return {{"exponent", exponent, ""}};
}

Parameters stiffening_spring(Making& m) {
  m.faults.spring_cubic = m.size;
  const double full_psi = steady_psi(m.unit, {}, 2.0) - steady_psi(m.unit, {}, 1.0);
  return {{"cubic_coefficient", m.size / (full_psi * full_psi), "1/psi2"}};
}

Parameters self_oscillation(Making& m) {
  m.faults.hunting_psi = m.size;
  m.faults.hunting_hz = m.random.log_between(3, 14);
  m.faults.hunting_level_psi = m.random.chance(0.5) ? 115 : 165;
  return {{"frequency_hz", m.faults.hunting_hz, "Hz"},
          {"amplitude_psi", m.size, "psi"},
          {"strongest_at_psi", m.faults.hunting_level_psi, "psi"}};
}

Parameters periodic_disturbance(Making& m) {
  m.faults.tone_psi = m.size;
  m.faults.tone_hz = m.random.log_between(0.7, 40);
  return {{"frequency_hz", m.faults.tone_hz, "Hz"}, {"amplitude_psi", m.size, "psi"}};
}

Parameters thermal_drift(Making& m) {
  need(m.size < 0.5, "thermal_drift: the size must be below 0.5");
  m.faults.warm_gain_change = -m.size;
  m.faults.warm_time_s = m.random.between(2, 6);
  return {{"gain_change", -m.size, ""}, {"time_constant_s", m.faults.warm_time_s, "s"}};
}

Parameters sensor_offset(Making& m) {
  m.faults.offset_psi = m.random.sign() * m.size;
  return {{"offset_psi", m.faults.offset_psi, "psi"}};
}

Parameters sensor_drift(Making& m) {
  m.faults.drift_psi_per_s = m.random.sign() * m.size;
  return {{"drift_psi_per_s", m.faults.drift_psi_per_s, "psi/s"}};
}

Parameters intermittent(Making& m) {
  need(m.size <= 1, "intermittent: the size must not be above 1");
  m.faults.contact_gain_change = -m.size;
  m.faults.contact_s = m.random.between(0.3, 0.7) * m.duration_s;
  return {{"time_s", m.faults.contact_s, "s"}, {"gain_change", -m.size, ""}};
}

/// The size is psi per standard deviation of the channel (1.2 C, 4 psi), so that both weigh alike.
Parameters side_input(Making& m) {
  const bool warm = m.random.chance(0.5);
  double& coefficient = warm ? m.faults.psi_per_c : m.faults.psi_per_supply_psi;
  coefficient = m.random.sign() * m.size / (warm ? 1.2 : 4);
  return {
      {warm ? "coefficient of temperature_C" : "coefficient of supply_psi", coefficient, warm ? "psi/C" : "psi/psi"}};
}

Parameters silting(Making& m) {
  need(m.size < 0.9, "silting: the size must be below 0.9");
  m.faults.silting = m.size;
  return {{"area_share_lost", m.size, ""}};
}

Parameters jet_switching(Making& m) {
  m.faults.jet_change = m.random.sign() * m.size;
  need(m.faults.jet_change > -0.9, "jet_switching: the size must be below 0.9");
  return {{"flow_change", m.faults.jet_change, ""}};
}

Parameters cable_pick_up(Making& m) {
  m.faults.pick_up_psi_s_per_a = m.random.sign() * m.size;
  return {{"psi_per_A_per_s", m.faults.pick_up_psi_s_per_a, "psi s/A"}};
}

Parameters line_echo(Making& m) {
  m.faults.echo = m.size;
  m.faults.echo_s = m.random.between(0.12, 0.4);
  return {{"share", m.size, ""}, {"delay_s", m.faults.echo_s, "s"}};
}

Parameters flow_turbulence(Making& m) {
  m.faults.turbulence_psi = m.size;
  return {{"rms_psi_at_120_psi", m.size, "psi"}};
}

Parameters buffer_slip(Making& m) {
  need(m.size < 1, "buffer_slip: the size must be below 1 s");
  m.faults.slip_s = m.size;
  m.faults.slip_at_s = m.random.between(0.3, 0.6) * m.duration_s;
  return {{"delay_s", m.size, "s"}, {"time_s", m.faults.slip_at_s, "s"}};
}

struct Effect {
  EffectKind kind;
  Parameters (*make)(Making&);
  bool in_one_recording = false;
};

const std::vector<Effect>& effects() {
  static const std::vector<Effect> table = {
      {{"friction", "valve", "memory", 0.0005, 0.01, "breakaway [A]"}, friction},
      {{"backlash", "valve", "memory", 0.001, 0.018, "full width [A]"}, backlash},
      {{"hysteresis", "valve", "memory", 0.003, 0.025, "full width of the loop at mid range [A]"}, hysteresis},
      {{"dead_band", "valve", "static", 0.001, 0.012, "width [A]"}, dead_band},
      {{"saturation", "valve", "static", 1.5, 12, "ceiling below the pressure at 2.0 A [psi]"}, saturation},
      {{"gain_loss", "valve", "static", 0.004, 0.14, "1 - y / y of the healthy unit"}, gain_loss},
      {{"static_curve", "valve", "static", 0.012, 0.34, "|c| of y + c R q (1 - q)"}, static_curve},
      {{"transport_delay", "stand", "timing", 0.0008, 0.012, "excess delay [s]"}, transport_delay},
      {{"extra_lag", "valve", "timing", 0.001, 0.02, "time constant of the flux [s]"}, extra_lag},
      {{"resonance", "valve", "timing", 0.005, 0.02, "period of the mode [s]"}, resonance},
      {{"rate_limit", "valve", "timing", 0.02, 0.05, "1 / limit [s/A]"}, rate_limit},
      {{"asymmetric_response", "valve", "timing", 0.004, 0.18, "fall-to-rise ratio of the volume, less 1"},
       asymmetric_response},
      {{"leakage", "valve", "flow", 0.012, 0.34, "loss over through-flow at 210 psi"}, leakage},
      {{"orifice_flow", "either", "flow", 0.008, 0.4, "exponent of the outlet at 120 psi, raised by"}, orifice_flow},
      {{"stiffening_spring", "valve", "flow", 0.008, 0.35, "cubic over linear force at full lift"}, stiffening_spring},
      {{"self_oscillation", "valve", "disturbance", 0.04, 2, "amplitude where strongest [psi]"}, self_oscillation},
      {{"periodic_disturbance", "stand", "disturbance", 0.01, 0.6, "amplitude [psi]"}, periodic_disturbance},
      {{"thermal_drift", "valve", "slow", 0.0004, 0.02, "share of gain lost when warm at 1.6 A"}, thermal_drift},
      {{"sensor_offset", "stand", "slow", 0.5, 20, "|offset| [psi]"}, sensor_offset},
      {{"sensor_drift", "stand", "slow", 0.001, 0.08, "|drift| [psi/s]"}, sensor_drift},
      {{"intermittent", "either", "slow", 0.0003, 0.013, "share of gain lost at an instant of one recording"},
       intermittent,
       true},
      {{"side_input", "stand", "slow", 0.006, 0.45, "|psi| per standard deviation of the channel"}, side_input},
      {{"silting", "valve", "outside", 0.0004, 0.018, "share of the port lost while the spool stands"}, silting},
      {{"jet_switching", "valve", "outside", 0.0004, 0.017, "change of the flow while the jet clings to its wall"},
       jet_switching},
      {{"cable_pick_up", "stand", "outside", 0.002, 0.15, "|psi| per A/s of the current's rate"}, cable_pick_up},
      {{"line_echo", "stand", "outside", 0.0006, 0.025, "share that comes back from the line's far end"}, line_echo},
      {{"flow_turbulence", "valve", "outside", 0.01, 0.5, "rms of the port's flow noise at 120 psi [psi]"},
       flow_turbulence},
      {{"buffer_slip", "stand", "outside", 0.0002, 0.005, "the pressure is late from an instant on [s]"},
       buffer_slip,
       true},
  };
  return table;
}

const Effect& named(const std::string& name) {
  for (const Effect& effect : effects())
    if (effect.kind.name == name) return effect;
  throw std::invalid_argument("no effect '" + name + "' (see `effects`)");
}

HiddenEffect hide_one(const Asked& asked, const Unit& unit, const std::vector<Command>& commands, std::uint64_t seed,
                      std::vector<Faults>& faults) {
  const Effect& effect = named(asked.name);
  need(asked.size >= 0 && std::isfinite(asked.size), asked.name + ": the size must be a number of at least zero");
  HiddenEffect hidden{effect.kind, asked.size, {}, ""};
  if (asked.size == 0) return hidden;
  const int only = Random(seed, "recording of " + asked.name).below(static_cast<int>(commands.size()));
  for (std::size_t i = 0; i < commands.size(); ++i) {
    if (effect.in_one_recording && i != static_cast<std::size_t>(only)) continue;
    Making making{asked.size, unit, Random(seed, asked.name), commands[i].instant_s.back(), faults[i]};
    hidden.parameters = effect.make(making);
    if (effect.in_one_recording) hidden.recording = commands[i].name;
  }
  return hidden;
}

}  // namespace

const std::vector<EffectKind>& effect_kinds() {
  static const std::vector<EffectKind> table = [] {
    std::vector<EffectKind> kinds;
    for (const Effect& effect : effects()) kinds.push_back(effect.kind);
    return kinds;
  }();
  return table;
}

Spoiled hide(const std::vector<Asked>& asked, const Unit& unit, const std::vector<Command>& commands,
             std::uint64_t seed) {
  Spoiled spoiled{std::vector<Faults>(commands.size()), {}};
  std::set<std::string> names;
  for (const Asked& one : asked) {
    need(names.insert(one.name).second, "effect '" + one.name + "' is asked for twice");
    spoiled.truth.push_back(hide_one(one, unit, commands, seed, spoiled.faults));
  }
  return spoiled;
}

}  // namespace valvetriage::second_stand
