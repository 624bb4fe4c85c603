#include "tests/stand/valve.h"

#include <algorithm>
#include <array>
#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <optional>

#include "tests/stand/hysteresis.h"
#include "tests/stand/random.h"
#include "tests/stand/steady_map.h"

namespace valvetriage::stand {
namespace {

namespace odeint = boost::numeric::odeint;

constexpr double kPsi = 100;  // state unit of pressure [psi]
constexpr double kRangePsi = 210;

/// States, scaled so that one absolute tolerance serves all.
enum : std::size_t {
  kCoil,     // coil current [A]
  kTravel,   // spool travel [mm]
  kSpeed,    // spool speed over its natural frequency [mm]
  kBristle,  // LuGre bristle force [N]
  kVolume,   // pressure in the volume [100 psi]
  kLag,      // pressure behind the extra lag [100 psi]
  kWarmth,   // coil warmth, 1 when warm at mean heating
  kSensor,   // sensor output [100 psi]
  kStates
};
using State = std::array<double, kStates>;

/// The right-hand side and its memories (README, equations 1 to 9).
class Valve {
 public:
  Valve(const Unit& unit, const Faults& faults, const Command& command)
      : unit_(unit), faults_(faults), command_(command), next_step_(command.step_after(0)), memory_(unit.loop_width_a) {
    const double mid = force_slope_mid_n_per_a(unit);
    breakaway_n_ = (unit.breakaway_a + faults.breakaway_a) * mid;
    kinetic_n_ = (unit.breakaway_a * unit.kinetic_ratio + faults.kinetic_a) * mid;
    mass_ = unit.mass_kg / 1000;
    natural_rad_s_ = std::sqrt(unit.spring_n_per_mm / mass_);
    damping_ = 2 * unit.damping_ratio * mass_ * natural_rad_s_;
    bristle_stiffness_ = 100 * unit.spring_n_per_mm;
    bristle_damping_ = 0.6 * std::sqrt(bristle_stiffness_ * mass_);
    calibrate_flow();
  }

  void operator()(const State& s, State& rate, double t) const {
    // (1) coil current behind the driver
    rate[kCoil] = (commanded(t) - s[kCoil]) / unit_.driver_time_constant_s;
    // (2) magnetic force with memory, (3) spool, (4) LuGre friction
    const double force = magnetic_force_n(unit_, memory_.effective_a(s[kCoil]));
    const double speed = s[kSpeed] * natural_rad_s_;
    rate[kBristle] = bristle_rate(s[kBristle], speed);
    const double friction = s[kBristle] + bristle_damping_ / bristle_stiffness_ * rate[kBristle];
    rate[kTravel] = speed;
    rate[kSpeed] =
        (force - unit_.spring_n_per_mm * s[kTravel] - damping_ * speed - friction) / (mass_ * natural_rad_s_);
    // (5) metering orifice, (6) volume with outflow and leaks
    const double pressure = s[kVolume] * kPsi;
    const double net = inflow(s, pressure) - outflow(pressure) - leak_ * std::sqrt(std::max(pressure, 0.0));
    rate[kVolume] = net / kPsi;
    // (7) extra lag, (8) warming coil, (9) sensor
    const bool lagged = faults_.extra_lag_s > 0;
    rate[kLag] = lagged ? (s[kVolume] - s[kLag]) / faults_.extra_lag_s : 0.0;
    rate[kWarmth] = (0.5 + 0.5 * s[kCoil] * s[kCoil] / (1.6 * 1.6) - s[kWarmth]) / faults_.warming_time_constant_s;
    rate[kSensor] = ((lagged ? s[kLag] : s[kVolume]) - s[kSensor]) / unit_.sensor_time_constant_s;
  }

  /// Steady state at the first command after a random past.
  State start(Random& past) {
    const double current = command_.value_a.front();
    for (int i = 0; i < 3; ++i) memory_.remember(past.uniform(0.7, 2.2));
    State s{};
    s[kCoil] = current;
    remember(s);
    s[kBristle] = breakaway_n_ * past.uniform(-0.9, 0.9);
    s[kTravel] = (magnetic_force_n(unit_, memory_.effective_a(current)) - s[kBristle]) / unit_.spring_n_per_mm;
    const double pressure = steady_pressure_psi(unit_, current) / kPsi;
    s[kVolume] = s[kLag] = s[kSensor] = pressure;
    return s;
  }

  double delay_s() const { return unit_.delay_s; }
  /// Time at which the next step of the command reaches the coil.
  double next_step_s() const { return static_cast<double>(next_step_) * command_.period_s + delay_s(); }
  void pass_step() { next_step_ = command_.step_after(next_step_); }
  void remember(const State& s) { memory_.remember(s[kCoil]); }
  /// Positive while the coil current rises: its sign change is a switch of the magnetic memory.
  double coil_direction(const State& s, double t) const { return commanded(t) - s[kCoil]; }

  double output_psi(const State& s, double t) const {
    return s[kSensor] * kPsi + unit_.sensor_offset_psi + faults_.offset_psi + faults_.drift_psi_per_s * t;
  }

 private:
  double commanded(double t) const { return command_.at(t - delay_s(), next_step_); }

  double bristle_rate(double force, double speed) const {
    if (breakaway_n_ <= 0) return 0;
    const double z = speed / unit_.stribeck_mm_per_s;
    const double sliding = kinetic_n_ + (breakaway_n_ - kinetic_n_) * std::exp(-z * z);
    // The bristles settle within 0.2 ms at most speeds; faster is invisible at 200 Hz and needlessly stiff.
    constexpr double kFastestPerS = 5000;
    const double fastest = kFastestPerS * sliding / bristle_stiffness_;
    const double bounded = speed / std::sqrt(1 + speed * speed / (fastest * fastest));
    return bristle_stiffness_ * (bounded - std::abs(bounded) * force / sliding);
  }

  double outflow(double pressure) const {
    // Laminar below a twentieth of a psi: no orifice is turbulent at rest.
    return outflow_gain_ * pressure * std::pow(pressure * pressure + 0.0025, 0.5 * (unit_.outflow_exponent - 1));
  }

  double inflow(const State& s, double pressure) const {
    const double drop = std::sqrt(std::max(unit_.supply_psi - pressure, 0.0));
    if (faults_.warming_gain_change == 0) return area_(s[kTravel]) * drop;
    return area_for(steady_psi_(s[kTravel]) * (1 + faults_.warming_gain_change * s[kWarmth])) * drop;
  }

  /// Opening that holds a pressure on the healthy unit, leak included.
  double area_for(double pressure) const {
    return (outflow(pressure) + healthy_leak_ * std::sqrt(pressure)) / std::sqrt(unit_.supply_psi - pressure);
  }

  void calibrate_flow() {
    const double n = unit_.outflow_exponent;
    const double flow = 1 / (unit_.time_constant_120psi_s * (0.5 / (unit_.supply_psi - 120) + n / 120));
    outflow_gain_ = flow / std::pow(120.0, n);
    const double per_fraction = outflow(kRangePsi) / std::sqrt(kRangePsi);
    healthy_leak_ = unit_.leak_fraction * per_fraction;
    leak_ = (unit_.leak_fraction + faults_.leak_fraction) * per_fraction;
    const double low = magnetic_force_n(unit_, 0.5) / unit_.spring_n_per_mm;
    const double high = magnetic_force_n(unit_, 2.4) / unit_.spring_n_per_mm;
    const auto steady = [this](double travel) {
      return steady_pressure_psi(unit_, current_of_force_a(unit_, unit_.spring_n_per_mm * travel));
    };
    steady_psi_ = Curve(low, high, 1201, steady);
    area_ = Curve(low, high, 1201, [&](double travel) { return area_for(steady(travel)); });
  }

  const Unit& unit_;
  const Faults& faults_;
  const Command& command_;
  std::size_t next_step_;
  MagneticMemory memory_;
  double breakaway_n_, kinetic_n_, mass_, natural_rad_s_, damping_, bristle_stiffness_, bristle_damping_;
  double outflow_gain_ = 0, healthy_leak_ = 0, leak_ = 0;
  Curve steady_psi_, area_;
};

/// Adaptive Dormand-Prince steps; switches are located on the dense output and the integration starts anew there.
class Integration {
 public:
  Integration(Valve& valve, const State& start, double start_s, const Tolerance& tolerance)
      : valve_(valve),
        stepper_(
            odeint::make_dense_output(tolerance.absolute, tolerance.relative, odeint::runge_kutta_dopri5<State>())) {
    stepper_.initialize(start, start_s, kFirstStepS);
  }

  /// Goes on to `end_s` and calls `take(state, t)` at every sample time on the way.
  template <class Take>
  void run_to(double end_s, const std::vector<double>& times_s, std::size_t& next, Take take) {
    while (stepper_.current_time() < end_s) {
      const auto [begin_s, reached_s] =
          stepper_.do_step([this](const State& s, State& r, double t) { valve_(s, r, t); });
      const double step_s = valve_.next_step_s();
      double stop_s = std::min(reached_s, step_s);
      if (const auto reversal = reversal_in(begin_s, stop_s)) stop_s = *reversal;
      State state;
      for (; next < times_s.size() && times_s[next] <= stop_s; ++next) {
        stepper_.calc_state(times_s[next], state);
        take(state, times_s[next]);
      }
      stepper_.calc_state(stop_s, state);
      valve_.remember(state);
      if (stop_s < reached_s) {
        if (stop_s == step_s) valve_.pass_step();
        stepper_.initialize(state, stop_s, kFirstStepS);
      }
    }
  }

 private:
  static constexpr double kFirstStepS = 2e-4;

  /// Where in the last step the coil current turns, by bisection on the dense output.
  std::optional<double> reversal_in(double begin_s, double end_s) {
    constexpr double kNegligibleA = 1e-7;
    State state;
    const auto direction = [&](double t) {
      stepper_.calc_state(t, state);
      return valve_.coil_direction(state, t);
    };
    double low = direction(begin_s);
    const double high = direction(end_s);
    if (low * high >= 0 || std::abs(low) < kNegligibleA || std::abs(high) < kNegligibleA) return std::nullopt;
    for (int i = 0; i < 30; ++i) {
      const double middle_s = 0.5 * (begin_s + end_s);
      const double middle = direction(middle_s);
      if (middle * low > 0) {
        begin_s = middle_s;
        low = middle;
      } else {
        end_s = middle_s;
      }
    }
    return end_s;
  }

  using Stepper = decltype(odeint::make_dense_output(1.0, 1.0, odeint::runge_kutta_dopri5<State>()));
  Valve& valve_;
  Stepper stepper_;
};

}  // namespace

std::vector<double> run_valve(const Unit& unit, const Faults& faults, const Command& command,
                              std::uint64_t history_seed, const std::vector<double>& sample_times_s,
                              const Tolerance& tolerance) {
  constexpr double kSettlingS = 1.5;  // at the first command, before the record begins
  Valve valve(unit, faults, command);
  Random past(history_seed, "history " + command.name);
  Integration integration(valve, valve.start(past), -kSettlingS, tolerance);
  std::vector<double> pressure_psi;
  pressure_psi.reserve(sample_times_s.size());
  std::size_t next = 0;
  integration.run_to(sample_times_s.back() + 1e-9, sample_times_s, next,
                     [&](const State& state, double t) { pressure_psi.push_back(valve.output_psi(state, t)); });
  return pressure_psi;
}

}  // namespace valvetriage::stand
