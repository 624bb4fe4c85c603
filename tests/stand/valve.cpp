#include "tests/stand/valve.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "tests/stand/bristles.h"
#include "tests/stand/hysteresis.h"
#include "tests/stand/random.h"
#include "tests/stand/steady_map.h"

namespace valvetriage::stand {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kPsi = 100;  // state unit of pressure [psi]
constexpr double kRangePsi = 210;
constexpr double kLargestPlayA = 0.12;
constexpr std::array<double, 3> kCreepS = {0.1, 1, 10};

/// States, scaled so that one absolute tolerance serves all.
enum : std::size_t {
  kCoil,      // coil current [A]
  kTravel,    // armature travel [mm]
  kSpeed,     // its speed over the natural frequency [mm]
  kBristle,   // LuGre bristle force [N]
  kVolume,    // pressure in the volume [100 psi]
  kLag,       // pressure behind the extra lag [100 psi]
  kMode,      // pressure behind the lightly damped mode [100 psi]
  kModeRate,  // its rate over the mode's frequency [100 psi]
  kCycleRe,   // hunting, complex amplitude
  kCycleIm,
  kWarmth,               // coil warmth, 1 when warm at mean heating
  kReservoir,            // filling of the stand's accumulator
  kCreep,                // three late currents [A]
  kSensor = kCreep + 3,  // gauge [100 psi]
  kStates
};

/// The static and derived numbers of a unit with its faults: what does not change while a recording is taken.
struct Constants {
  Constants(const Unit& unit, const Faults& faults);

  double outflow(double pressure_psi, double flow_gain, double flow_exponent) const {
    // Laminar below a twentieth of a psi: no orifice is turbulent at rest.
    return flow_gain * pressure_psi * std::pow(pressure_psi * pressure_psi + 0.0025, 0.5 * (flow_exponent - 1));
  }
  /// Opening that holds a pressure on the healthy unit, its leak included.
  double opening_for(double pressure_psi) const {
    const double p = std::clamp(pressure_psi, 0.01, supply_psi - 5);
    return (outflow(p, healthy_gain, healthy_exponent) + healthy_leak * std::sqrt(p)) / std::sqrt(supply_psi - p);
  }

  double spring, mass, natural_rad_s, damping;  ///< N/mm, N s²/mm, rad/s, N s/mm
  double closed_mm, full_mm;                    ///< travel at 1.0 A and from there to 2.0 A
  Bristles bristles;
  double supply_psi, healthy_exponent, healthy_gain, exponent, gain, healthy_leak, leak;
  Curve steady_psi, opening;  ///< over port travel [mm]
};

/// Steady pressure over current with the static faults in it.
double spoiled_steady_psi(const Unit& unit, const Faults& faults, double current_a) {
  const double from_centre = current_a - faults.dead_centre_a;
  const double half = 0.5 * faults.dead_width_a;
  const double through = from_centre > half ? from_centre - half : std::min(from_centre + half, 0.0);
  const double live_a = faults.dead_width_a > 0 ? faults.dead_centre_a + through : current_a;
  const double pressure = steady_pressure_psi(unit, live_a);
  const double q = pressure / kRangePsi;
  return faults.pressure_ratio * (pressure + faults.curvature * kRangePsi * q * (1 - q));
}

Constants::Constants(const Unit& unit, const Faults& faults) {
  spring = unit.spring_n_per_mm;
  mass = unit.mass_kg / 1000;
  natural_rad_s = std::sqrt(spring / mass);
  damping = 2 * unit.damping_ratio * mass * natural_rad_s;
  closed_mm = magnetic_force_n(unit, 1.0) / spring;
  full_mm = magnetic_force_n(unit, 2.0) / spring - closed_mm;

  const double mid = force_slope_mid_n_per_a(unit);
  bristles.breakaway = (unit.breakaway_a + faults.breakaway_a) * mid;
  bristles.kinetic = (unit.breakaway_a * unit.kinetic_ratio + faults.kinetic_a) * mid;
  bristles.stribeck_speed = unit.stribeck_mm_per_s;
  bristles.stiffness = 100 * spring;  // a stuck spool still gives by one hundredth of what a free one would
  bristles.damping = 0.6 * std::sqrt(bristles.stiffness * mass);

  supply_psi = unit.supply_psi;
  healthy_exponent = unit.outflow_exponent;
  exponent = healthy_exponent - faults.exponent_loss;
  const double flow_at_120 = 1 / (unit.time_constant_120psi_s * (0.5 / (supply_psi - 120) + healthy_exponent / 120));
  healthy_gain = flow_at_120 / std::pow(120.0, healthy_exponent);
  gain = flow_at_120 / std::pow(120.0, exponent);
  const double leak_per_fraction = outflow(kRangePsi, healthy_gain, healthy_exponent) / std::sqrt(kRangePsi);
  healthy_leak = unit.leak_fraction * leak_per_fraction;
  leak = (unit.leak_fraction + faults.leak_fraction) * leak_per_fraction;

  const auto steady = [&](double travel_mm) {
    return spoiled_steady_psi(unit, faults, current_of_force_a(unit, spring * travel_mm));
  };
  const double low_mm = magnetic_force_n(unit, 0.5) / spring, high_mm = magnetic_force_n(unit, 2.4) / spring;
  steady_psi = Curve(low_mm, high_mm, 1201, steady);
  opening = Curve(low_mm, high_mm, 1201, [&](double travel_mm) { return opening_for(steady(travel_mm)); });
}

/// The valve in continuous time with its memories (README, equations 1 to 9).
class Valve {
 public:
  using State = std::array<double, kStates>;

  Valve(const Unit& unit, const Faults& faults, const Command& command, const Environment& environment)
      : unit_(unit),
        faults_(faults),
        command_(command),
        environment_(environment),
        fixed_(unit, faults),
        delay_s_(unit.delay_s + faults.delay_s),
        next_step_(command.step_after(0)),
        magnetism_(unit.loop_width_a + faults.loop_a, kLargestPlayA),
        linkage_(faults.backlash_a * force_slope_mid_n_per_a(unit) / fixed_.spring) {}

  void rate(const State& s, State& r, double t) const {
    r = {};
    move_armature(s, r, t);
    fill_volume(s, r);
    if (faults_.warming_gain_change != 0 && t > 0) warm_coil(s, r);
    if (faults_.hunting_psi > 0) hunt(s, r);
    read_gauge(s, r, t);
  }

  /// Steady state at the first command after a random past.
  State start() {
    Random past(environment_.history_seed, "past");
    const double current = command_.value_a.front();
    for (int i = 0; i < 3; ++i) {
      const double visited = past.uniform(0.7, 2.2);
      magnetism_.remember(visited);
      linkage_.remember(magnetic_force_n(unit_, visited) / fixed_.spring);
    }
    State s{};
    s[kCoil] = current;
    magnetism_.remember(current);
    const double effective = magnetism_.at(current);
    s[kCreep] = s[kCreep + 1] = s[kCreep + 2] = effective;
    s[kBristle] = fixed_.bristles.breakaway * past.uniform(-0.9, 0.9);
    s[kTravel] = (magnetic_force_n(unit_, effective) - s[kBristle]) / fixed_.spring;
    s[kVolume] = s[kLag] = s[kMode] = s[kSensor] = fixed_.steady_psi(linkage_.at(s[kTravel])) / kPsi;
    s[kReservoir] = past.uniform(0.5, 0.9);
    return s;
  }

  double next_step_s() const { return command_.step_time_s(next_step_) + delay_s_; }
  void pass_step() { next_step_ = command_.step_after(next_step_); }

  int switch_count() const { return 3; }
  /// 0 the coil current turns, 1 the armature turns in its lost motion, 2 the accumulator's pump switches.
  double switch_value(int index, const State& s, double t) const {
    if (index == 0) return commanded(t) - s[kCoil];
    if (index == 1) return faults_.backlash_a > 0 ? s[kSpeed] : 0;
    return faults_.surge_share > 0 ? s[kReservoir] - (pumping_ ? kPumpOff : kPumpOn) : 0;
  }
  void remember(const State& s, double) {
    magnetism_.remember(s[kCoil]);
    linkage_.remember(s[kTravel]);
    if (pumping_ ? s[kReservoir] >= kPumpOff : s[kReservoir] <= kPumpOn) pumping_ = !pumping_;
  }

  double gauge_psi(const State& s, double t) const {
    double pressure = s[kSensor] * kPsi + unit_.sensor_offset_psi;
    if (faults_.telegraph_gain != 0) pressure *= 1 + faults_.telegraph_gain * environment_.telegraph(t);
    if (t >= faults_.contact_s) pressure *= 1 + faults_.contact_gain_change;
    if (faults_.rectified) pressure = std::abs(pressure);
    return pressure + faults_.offset_psi + faults_.drift_psi_per_s * t;
  }

 private:
  static constexpr double kPumpOn = 0.4, kPumpOff = 0.95;

  double commanded(double t) const { return command_.at(t - delay_s_, next_step_) + command_.dither_at(t); }

  // (1) coil behind its driver, (2) magnetic force with memory, (3) armature and spool, (4) friction
  void move_armature(const State& s, State& r, double t) const {
    const double drive = (commanded(t) - s[kCoil]) / unit_.driver_time_constant_s;
    r[kCoil] = std::clamp(drive, -faults_.slew_a_per_s, faults_.slew_a_per_s);
    double effective = magnetism_.at(s[kCoil]);
    if (faults_.creep > 0) effective = crept(effective, s, r);
    const double speed = s[kSpeed] * fixed_.natural_rad_s;
    r[kBristle] = fixed_.bristles.rate(s[kBristle], speed);
    r[kTravel] = speed;
    const double force = magnetic_force_n(unit_, effective) - spring_force(s[kTravel]) - fixed_.damping * speed -
                         fixed_.bristles.friction(s[kBristle], r[kBristle]);
    r[kSpeed] = force / (fixed_.mass * fixed_.natural_rad_s);
  }

  double spring_force(double travel_mm) const {
    const double z = (travel_mm - fixed_.closed_mm) / fixed_.full_mm;
    return fixed_.spring * (travel_mm + faults_.spring_cubic * fixed_.full_mm * z * z * z);
  }

  double crept(double effective, const State& s, State& r) const {
    double late = 0;
    for (std::size_t i = 0; i < kCreepS.size(); ++i) {
      late += s[kCreep + i] - effective;
      r[kCreep + i] = (effective - s[kCreep + i]) / kCreepS[i];
    }
    return effective + faults_.creep * late / static_cast<double>(kCreepS.size());
  }

  // (5) metering orifice, (6) volume with outflow, leaks and relief
  void fill_volume(const State& s, State& r) const {
    const double pressure = s[kVolume] * kPsi;
    const double out = fixed_.outflow(pressure, fixed_.gain, fixed_.exponent);
    double net = inflow(s, pressure) - out - fixed_.leak * std::sqrt(std::max(pressure, 0.0));
    constexpr double kReliefPerS = 5000;  // passes half the through-flow for a quarter of a psi
    if (pressure > faults_.ceiling_psi) net -= kReliefPerS * (pressure - faults_.ceiling_psi);
    if (net < 0) net /= faults_.fall_to_rise;
    if (faults_.entrained_air > 0) {
      constexpr double kAtmospherePsi = 14.7;
      const double squeezed = (26 + kAtmospherePsi) / (std::max(pressure, 0.0) + kAtmospherePsi);
      net /= 1 + faults_.entrained_air * squeezed * squeezed;
    }
    r[kVolume] = net / kPsi;
    if (faults_.surge_share > 0) r[kReservoir] = (pumping_ ? 0.5 : 0.0) - 0.06 - 0.24 * out / full_outflow();
  }

  double full_outflow() const { return fixed_.outflow(kRangePsi, fixed_.healthy_gain, fixed_.healthy_exponent); }

  double inflow(const State& s, double pressure) const {
    const double supply = fixed_.supply_psi * (1 - faults_.surge_share * (1 - s[kReservoir]));
    const double drop = std::sqrt(std::max(supply - pressure, 0.0));
    const double travel = linkage_.at(s[kTravel]);
    if (faults_.warming_gain_change == 0) return fixed_.opening(travel) * drop;
    return fixed_.opening_for(fixed_.steady_psi(travel) * (1 + faults_.warming_gain_change * s[kWarmth])) * drop;
  }

  // (8) the coil warms with its own losses
  void warm_coil(const State& s, State& r) const {
    const double heating = 0.5 + 0.5 * s[kCoil] * s[kCoil] / (1.6 * 1.6);
    r[kWarmth] = (heating - s[kWarmth]) / faults_.warming_time_constant_s;
  }

  // (9) hunting: a limit cycle that lives around one level (Stuart-Landau normal form of a Hopf bifurcation)
  void hunt(const State& s, State& r) const {
    constexpr double kGrowthPerS = 10, kWidthPsi = 60, kAway = 0.5, kStir = 0.02;
    const double from = s[kVolume] * kPsi - faults_.hunting_level_psi;
    const double z = from / kWidthPsi;
    const double drive = (std::exp(-0.5 * z * z) - kAway) / (1 - kAway);  // 1 where strongest, -1 far away
    const double growth = kGrowthPerS * (drive - s[kCycleRe] * s[kCycleRe] - s[kCycleIm] * s[kCycleIm]);
    const double rad_s = kTwoPi * faults_.hunting_hz * (1 + 0.25 * from / kRangePsi);
    r[kCycleRe] = growth * s[kCycleRe] - rad_s * s[kCycleIm] + kStir;
    r[kCycleIm] = growth * s[kCycleIm] + rad_s * s[kCycleRe];
  }

  // (7) what lies between the volume and the gauge, and the gauge
  void read_gauge(const State& s, State& r, double t) const {
    double pressure = s[kVolume];
    if (faults_.extra_lag_s > 0) {
      r[kLag] = (pressure - s[kLag]) / faults_.extra_lag_s;
      pressure = s[kLag];
    }
    if (faults_.mode_period_s > 0) {
      const double rad_s = kTwoPi / faults_.mode_period_s;
      r[kMode] = rad_s * s[kModeRate];
      r[kModeRate] = rad_s * (pressure - s[kMode] - 2 * faults_.mode_damping * s[kModeRate]);
      pressure = s[kMode];
    }
    pressure += (faults_.hunting_psi * s[kCycleRe] + disturbance_psi(t)) / kPsi;
    r[kSensor] = (pressure - s[kSensor]) / unit_.sensor_time_constant_s;
  }

  double disturbance_psi(double t) const {
    double sum = 0;
    if (faults_.tone_psi > 0)
      sum += faults_.tone_psi * std::sin(kTwoPi * faults_.tone_hz * t + environment_.tone_phase);
    if (faults_.psi_per_c != 0)
      sum += faults_.psi_per_c * (environment_.temperature_c.at(t) - environment_.day_temperature_c);
    if (faults_.psi_per_supply_psi != 0)
      sum += faults_.psi_per_supply_psi * (environment_.supply_psi.at(t) - environment_.day_supply_psi);
    return sum;
  }

  const Unit& unit_;
  const Faults& faults_;
  const Command& command_;
  const Environment& environment_;
  Constants fixed_;
  double delay_s_;
  std::size_t next_step_;
  MagneticMemory magnetism_;
  Play linkage_;
  bool pumping_ = false;
};

/// A gauge whose tube sticks: it holds until the pressure is `stick_psi` away, then slips most of the way.
class StickyTube {
 public:
  explicit StickyTube(double stick_psi) : stick_psi_(stick_psi) {}
  double read(double pressure_psi) {
    if (stick_psi_ <= 0) return pressure_psi;
    const double away = pressure_psi - shown_psi_;
    if (!started_ || std::abs(away) > stick_psi_)
      shown_psi_ = pressure_psi - (started_ ? std::copysign(0.3 * stick_psi_, away) : 0);
    started_ = true;
    return shown_psi_;
  }

 private:
  double stick_psi_, shown_psi_ = 0;
  bool started_ = false;
};

}  // namespace

std::vector<double> run_valve(const Unit& unit, const Faults& faults, const Command& command,
                              const Environment& environment, const std::vector<double>& sample_times_s,
                              const Tolerance& tolerance) {
  constexpr double kSettlingS = 1.5;  // at the first command, before the record begins
  std::vector<double> times_s = sample_times_s;
  for (double& t : times_s) t *= 1 + faults.clock_error;
  Valve valve(unit, faults, command, environment);
  Integration<Valve> integration(valve, valve.start(), -kSettlingS, tolerance);
  StickyTube tube(faults.tube_stick_psi);
  std::vector<double> pressure_psi;
  pressure_psi.reserve(times_s.size());
  integration.run(times_s, [&](const Valve::State& state, double t) {
    pressure_psi.push_back(tube.read(valve.gauge_psi(state, t)));
  });
  return pressure_psi;
}

}  // namespace valvetriage::stand
