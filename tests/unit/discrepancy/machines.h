#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <ostream>
#include <string>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage::machines {

/// Machines to try the engine on: physics of their own in small steps, nothing of the engine's.

using Signal = std::vector<double>;

/// Random numbers that are the same everywhere.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ULL + 1) {}
  double uniform() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state_ >> 11U) / 9007199254740992.0;
  }
  double normal() {
    const double r = std::sqrt(-2 * std::log(uniform() + 1e-300));
    return r * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

/// A command of random holds, rounded by a lag: broad band, with rests.
inline Signal random_command(std::size_t samples, std::size_t hold, std::uint64_t seed) {
  Noise noise(seed);
  Signal u(samples);
  double level = 0, value = 0;
  for (std::size_t t = 0; t < samples; ++t) {
    if (t % hold == 0) level = 4 * noise.uniform() - 2;
    value += 0.4 * (level - value);
    u[t] = value;
  }
  return u;
}

/// Two levels, changing at random after whole numbers of holds.
inline Signal two_levels(std::size_t samples, std::size_t hold, std::uint64_t seed) {
  Noise noise(seed);
  Signal u(samples);
  double level = 1;
  for (std::size_t t = 0; t < samples; ++t) {
    if (t % hold == 0 && noise.uniform() < 0.5) level = -level;
    u[t] = level;
  }
  return u;
}

/// Noise through a lag of so many samples, of unit power.
inline Signal coloured(std::size_t samples, double memory_samples, std::uint64_t seed) {
  Noise noise(seed);
  const double keep = std::exp(-1 / memory_samples);
  Signal x(samples);
  double state = noise.normal();
  for (double& value : x) {
    value = state;
    state = keep * state + std::sqrt(1 - keep * keep) * noise.normal();
  }
  return x;
}

/// A sum of sines of rising frequency and equal amplitude about zero, three periods of the lowest.
inline Signal multisine(std::size_t samples, int lines, std::uint64_t seed) {
  Noise noise(seed);
  Signal u(samples);
  for (int k = 1; k <= lines; ++k) {
    const double phase = 2 * std::numbers::pi * noise.uniform();
    for (std::size_t t = 0; t < samples; ++t) {
      u[t] += std::sin(2 * std::numbers::pi * k * 3 * static_cast<double>(t) / static_cast<double>(samples) + phase);
    }
  }
  for (double& value : u) value *= std::sqrt(2.0 / lines);
  return u;
}

/// A sine whose frequency rises from a few periods in the record to `highest_hz`.
inline Signal sweep(std::size_t samples, double period_s, double highest_hz) {
  Signal u(samples);
  double phase = 0;
  for (std::size_t t = 0; t < samples; ++t) {
    u[t] = 1.5 * std::sin(phase);
    const double share = static_cast<double>(t) / static_cast<double>(samples);
    phase += 2 * std::numbers::pi * period_s * (0.02 + share) * highest_hz;
  }
  return u;
}

inline Recording recording(Signal u, Signal y, double period_s, double noise_rms, std::uint64_t seed) {
  Noise noise(seed);
  for (double& value : y) value += noise_rms * noise.normal();
  Recording r;
  r.name = "machine.csv";
  r.sample_period_s = period_s;
  r.input.name = "u";
  r.output.name = "y";
  r.time_s.resize(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) r.time_s[t] = static_cast<double>(t) * period_s;
  r.input.values = std::move(u);
  r.output.values = std::move(y);
  return r;
}

inline Signal each(Signal values, const std::function<double(double)>& law) {
  for (double& value : values) value = law(value);
  return values;
}

inline Signal plus(Signal a, const Signal& b, double factor = 1) {
  for (std::size_t t = 0; t < a.size(); ++t) a[t] += factor * b[t];
  return a;
}

inline Signal later(const Signal& y, std::size_t samples) {
  Signal out(y.size(), y.front());
  std::copy(y.begin(), y.end() - static_cast<std::ptrdiff_t>(samples),
            out.begin() + static_cast<std::ptrdiff_t>(samples));
  return out;
}

/// A mass on a spring: ÿ = ω² (u − force(y, ẏ)) − 2 ζ ω ẏ, twenty Euler steps per sample.
struct Oscillator {
  double omega = 6, zeta = 0.3;
  std::function<double(double, double)> force = [](double y, double) { return y; };
  double coulomb = 0;  ///< friction in units of the input

  Signal run(const Signal& u, double period_s) const {
    constexpr int kSteps = 20;
    const double h = period_s / kSteps;
    double y = coulomb > 0 ? 0 : u[0], v = 0;
    Signal out(u.size());
    for (std::size_t t = 0; t < u.size(); ++t) {
      out[t] = y;
      const double next = t + 1 < u.size() ? u[t + 1] : u[t];
      for (int s = 0; s < kSteps; ++s) {
        const double now = u[t] + (next - u[t]) * s / kSteps;
        const double push = omega * omega * (now - force(y, v)) - 2 * zeta * omega * v;
        const double free = v + h * push;
        const double hold = h * omega * omega * coulomb;
        v = std::abs(free) <= hold ? 0 : free - std::copysign(hold, free);
        y += h * v;
      }
    }
    return out;
  }
};

/// Bouc's and Wen's mass of 2 kg whose spring remembers: 2 ÿ = u − 5e4 y − 10 ẏ − z, with a loop z(y) that is stiffer
/// on the way back; 20 Euler steps per sample, symplectic in y.
inline Signal mass_on_a_loop(const Signal& u, double loop_stiffness, double period_s) {
  constexpr int kSteps = 20;
  const double h = period_s / kSteps;
  double y = 0, v = 0, z = 0;
  Signal out(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) {
    out[t] = y;
    const double next = t + 1 < u.size() ? u[t + 1] : u[t];
    for (int s = 0; s < kSteps; ++s) {
      const double now = u[t] + (next - u[t]) * s / kSteps;
      v += h * (now - 5e4 * y - 10 * v - z) / 2;
      y += h * v;
      z += h * (loop_stiffness * v - 1e3 * (0.8 * std::abs(v) * z - 1.1 * v * std::abs(z)));
    }
  }
  return out;
}

/// First-order lag of static gain 1, the input held between samples; other time constants where it falls.
inline Signal lag(const Signal& u, double tau_s, double period_s, double falling_s = 0) {
  Signal y(u.size());
  double state = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) {
    y[t] = state;
    const double tau = falling_s > 0 && u[t] < state ? falling_s : tau_s;
    state += (1 - std::exp(-period_s / tau)) * (u[t] - state);
  }
  return y;
}

inline Signal integral(const Signal& u, double period_s) {
  Signal y(u.size());
  for (std::size_t t = 1; t < y.size(); ++t) y[t] = y[t - 1] + period_s * u[t - 1];
  return y;
}

inline Signal play(const Signal& u, double width) {
  Signal y(u.size());
  double held = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) {
    held = std::max(u[t] - width / 2, std::min(u[t] + width / 2, held));
    y[t] = held;
  }
  return y;
}

/// Prandtl's and Ishlinskii's loop: the input less a part of what twelve plays of rising width keep back.
inline Signal smooth_loop(const Signal& u, double reach, double depth) {
  Signal y = u;
  constexpr int kPlays = 12;
  for (int j = 1; j <= kPlays; ++j) {
    const Signal held = play(u, 2 * reach * j / kPlays);
    for (std::size_t t = 0; t < u.size(); ++t) y[t] += depth / kPlays * (held[t] - u[t]);
  }
  return y;
}

/// Sticks until the force passes `breakaway`, then jumps to within `kinetic` of it.
inline Signal stick_slip(const Signal& u, double breakaway, double kinetic) {
  Signal y(u.size());
  double held = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) {
    const double gap = u[t] - held;
    if (std::abs(gap) > breakaway) held = u[t] - std::copysign(kinetic, gap);
    y[t] = held;
  }
  return y;
}

inline Signal rate_limited(const Signal& u, double per_sample) {
  Signal y(u.size());
  double state = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) y[t] = state += std::clamp(u[t] - state, -per_sample, per_sample);
  return y;
}

/// A mass that a force pushes against damping and Coulomb friction, held by no spring: its position.
inline Signal pushed(const Signal& force, double period_s, double damping, double coulomb) {
  constexpr int kSteps = 20;
  const double h = period_s / kSteps;
  double y = 0, v = 0;
  Signal shown(force.size());
  for (std::size_t t = 0; t < force.size(); ++t) {
    shown[t] = y;
    for (int s = 0; s < kSteps; ++s) {
      const double free = v + h * (force[t] - damping * v);
      v = std::abs(free) <= h * coulomb ? 0 : free - std::copysign(h * coulomb, free);
      y += h * v;
    }
  }
  return shown;
}

/// A motor's position held at a moving set-point: what is recorded is its force and its position (or speed).
struct Servo {
  double mass = 1, damping = 2, coulomb = 0, stiffness = 60, rate_gain = 8;
  bool shows_speed = false;

  Recording run(const Signal& set_point, double period_s, double noise_rms, std::uint64_t seed) const {
    constexpr int kSteps = 20;
    const double h = period_s / kSteps;
    Noise noise(seed);
    double y = 0, v = 0;
    Signal u(set_point.size()), shown(set_point.size());
    for (std::size_t t = 0; t < u.size(); ++t) {
      const double measured = y + noise_rms * noise.normal();
      shown[t] = shows_speed ? v + noise_rms * noise.normal() : measured;
      u[t] = stiffness * (set_point[t] - measured) - rate_gain * v;
      for (int s = 0; s < kSteps; ++s) {
        const double free = v + h * (u[t] - damping * v) / mass;
        const double hold = h * coulomb / mass;
        v = std::abs(free) <= hold ? 0 : free - std::copysign(hold, free);
        y += h * v;
      }
    }
    return recording(u, shown, period_s, 0, 0);
  }
};

/// A process regulated at a constant set-point by a PI controller whose valve may stick; a slow disturbance acts.
inline Recording regulated(std::size_t samples, double period_s, double breakaway, double disturbance,
                           std::uint64_t seed) {
  Noise noise(seed);
  const Signal load = coloured(samples, 60, seed + 1);
  Signal u(samples), y(samples);
  double sum = 0, state = 0, held = 0;
  for (std::size_t t = 0; t < samples; ++t) {
    y[t] = state + disturbance * load[t] + 0.005 * noise.normal();
    const double error = (breakaway > 0 ? 0.5 : 0) - y[t];
    sum += 0.04 * error;
    u[t] = sum + 0.5 * error;
    if (breakaway <= 0) held = u[t];
    if (breakaway > 0 && std::abs(u[t] - held) > breakaway) held = u[t];
    state += 0.08 * (held - state);
  }
  return recording(u, y, period_s, 0, 0);
}

/// Two tanks above each other, outflow by the square root, the upper one spilling over its rim.
struct Tanks {
  double rim_upper = 1e9, rim_lower = 1e9;
  bool linear = false;
  double exponent_upper = 0.5;

  Signal run(const Signal& pump, double period_s) const {
    constexpr int kSteps = 20;
    const double h = period_s / kSteps;
    double upper = 4, lower = 4;
    Signal y(pump.size());
    // The same at a level of 4, whatever the law.
    const auto outflow = [&](double level, double exponent) {
      return std::pow(std::max(level, 0.0) / 4, linear ? 1 : exponent);
    };
    for (std::size_t t = 0; t < pump.size(); ++t) {
      y[t] = lower;
      for (int s = 0; s < kSteps; ++s) {
        double spilt = 0;
        const double through = outflow(upper, exponent_upper);
        upper += h * (0.5 * pump[t] - through);
        if (upper > rim_upper) {
          spilt = (upper - rim_upper) / h;
          upper = rim_upper;
        }
        lower = std::min(lower + h * (through - outflow(lower, 0.5) + 0.3 * spilt), rim_lower);
      }
    }
    return y;
  }
};

inline Signal rounded(Signal y, double step) {
  return each(std::move(y), [step](double x) { return step * std::round(x / step); });
}

/// One machine, one recording of it per seed. `truth` is the cause, "none", or "outside" for what has no name.
struct Case {
  std::string name;
  std::string truth;
  std::function<Recording(std::uint64_t)> record;

  friend void PrintTo(const Case& machine, std::ostream* out) { *out << machine.name; }
};

inline constexpr double kStep_s = 0.02;

/// Machines in which nothing is missing but a linear machine, its offset and its noise.
inline std::vector<Case> healthy_machines() {
  constexpr double h = kStep_s;
  const auto cascade = [](const Signal& u) { return lag(lag(u, 0.15, kStep_s), 0.06, kStep_s); };
  return {{"lag_white", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, lag(u, 0.2, h), h, 0.02, s + 1);
           }},
          {"lag_coloured", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             return recording(u, plus(lag(u, 0.2, h), coloured(1200, 20, s + 2), 0.1), h, 0.01, s + 1);
           }},
          {"lag_slow_noise", "none",
           [=](std::uint64_t s) {
             const auto u = two_levels(1000, 12, s);
             return recording(u, plus(lag(u, 0.3, h), coloured(1000, 200, s + 2), 0.15), h, 0.01, s + 1);
           }},
          {"lag_loud", "none",
           [=](std::uint64_t s) {
             const auto u = coloured(1500, 10, s);
             return recording(u, lag(u, 0.2, h), h, 0.8, s + 1);
           }},
          {"oscillator_white", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, Oscillator{}.run(u, h), h, 0.01, s + 1);
           }},
          {"oscillator_rounded", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             const auto y = plus(Oscillator{.omega = 9, .zeta = 0.1}.run(u, h), coloured(1200, 0.2, s + 1), 0.005);
             return recording(u, rounded(y, 0.05), h, 0, s);
           }},
          {"oscillator_sweep_offset", "none",
           [=](std::uint64_t s) {
             const auto u = sweep(2000, h, 5);
             return recording(u, each(Oscillator{.zeta = 0.15}.run(u, h), [](double y) { return 3 * y + 20; }), h, 0.1,
                              s + 1);
           }},
          {"oscillator_fast_input", "none",
           [=](std::uint64_t s) {
             const auto u = coloured(2500, 3, s);
             return recording(u, plus(Oscillator{.omega = 20, .zeta = 0.05}.run(u, h), coloured(2500, 8, s + 2), 0.05),
                              h, 0.01, s + 1);
           }},
          {"integrator_white", "none",
           [=](std::uint64_t s) {
             const auto u = multisine(900, 8, s);
             return recording(u, integral(u, h), h, 0.01, s + 1);
           }},
          {"integrator_lag_walk", "none",
           [=](std::uint64_t s) {
             const auto u = multisine(1500, 15, s);
             return recording(u, plus(integral(lag(u, 0.1, h), h), integral(coloured(1500, 3, s + 2), h), 0.05), h,
                              0.005, s + 1);
           }},
          {"integrator_holds", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 20, s);
             return recording(u, each(integral(u, h), [](double y) { return y - 7; }), h, 0.02, s + 1);
           }},
          {"tanks_linear", "none",
           [=](std::uint64_t s) {
             const auto u = each(coloured(1000, 8, s), [](double x) { return 2 + x; });
             return recording(u, plus(Tanks{.linear = true}.run(u, 1.0), coloured(1000, 10, s + 2), 0.05), 1.0, 0.02,
                              s + 1);
           }},
          {"two_lags_delay", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 30, s);
             return recording(u, later(cascade(u), 4), h, 0.03, s + 1);
           }},
          {"long_delay", "none",
           [=](std::uint64_t s) {
             const auto u = two_levels(1200, 20, s);
             return recording(u, later(lag(u, 0.12, h), 25), h, 0.03, s + 1);
           }},
          {"linear_static_linear", "none",
           [=](std::uint64_t s) {
             const auto u = multisine(1500, 40, s);
             const auto middle =
                 each(Oscillator{.omega = 15, .zeta = 0.2}.run(u, h), [](double x) { return 4 * x + 1; });
             return recording(u, Oscillator{.omega = 5, .zeta = 0.5}.run(middle, h), h, 0.05, s + 1);
           }},
          {"wrong_way_first", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1000, 25, s);
             return recording(u, plus(each(lag(u, 0.3, h), [](double y) { return 2 * y; }), lag(u, 0.1, h), -1), h,
                              0.02, s + 1);
           }},
          {"noisy_input", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             return recording(plus(u, coloured(1200, 0.2, s + 2), 0.05), lag(u, 0.2, h), h, 0.02, s + 1);
           }},
          {"noise_that_grows", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             auto y = cascade(u);
             Noise noise(s + 1);
             for (std::size_t t = 0; t < y.size(); ++t) y[t] += (t < 600 ? 0.01 : 0.06) * noise.normal();
             return recording(u, y, h, 0, s);
           }},
          {"short", "none",
           [=](std::uint64_t s) {
             const auto u = random_command(150, 15, s);
             return recording(u, cascade(u), h, 0.05, s + 1);
           }},
          {"five_steps", "none",
           [=](std::uint64_t s) {
             Signal u(1000);
             for (std::size_t t = 0; t < 1000; ++t) u[t] = static_cast<double>(t / 200);
             return recording(u, plus(cascade(u), coloured(1000, 30, s + 2), 0.02), h, 0.02, s + 1);
           }},
          {"servo_position", "none",
           [=](std::uint64_t s) { return Servo{}.run(random_command(1200, 40, s), h, 0.003, s + 1); }},
          {"servo_speed", "none",
           [=](std::uint64_t s) { return Servo{.shows_speed = true}.run(multisine(1500, 20, s), h, 0.01, s + 1); }},
          {"regulated", "none", [=](std::uint64_t s) { return regulated(1500, h, 0, 0.3, s); }}};
}

/// Machines with one thing wrong.
inline std::vector<Case> faulty_machines() {
  constexpr double h = kStep_s;
  return {{"servo_friction_position", "friction",
           [=](std::uint64_t s) { return Servo{.coulomb = 4}.run(random_command(1200, 40, s), h, 0.002, s + 1); }},
          {"servo_friction_speed", "friction",
           [=](std::uint64_t s) {
             return Servo{.coulomb = 4, .shows_speed = true}.run(multisine(1500, 20, s), h, 0.005, s + 1);
           }},
          {"friction_in_motion", "friction",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, Oscillator{.coulomb = 0.25}.run(u, h), h, 0.01, s + 1);
           }},
          {"stick_slip_lag", "friction",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, lag(stick_slip(u, 0.4, 0.1), 0.15, h), h, 0.01, s + 1);
           }},
          {"hardening_spring", "stiffening_spring",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             const Oscillator spring{.force = [](double y, double) { return y + 0.3 * y * y * y; }};
             return recording(u, spring.run(u, h), h, 0.01, s + 1);
           }},
          {"duffing_multisine", "stiffening_spring",
           [=](std::uint64_t s) {
             const auto u = multisine(2500, 60, s);
             const Oscillator spring{
                 .omega = 12, .zeta = 0.05, .force = [](double y, double) { return y + 0.4 * y * y * y; }};
             return recording(u, spring.run(u, h), h, 0.01, s + 1);
           }},
          {"magnitude_lag", "rectified_sensor",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, each(lag(u, 0.2, h), [](double x) { return std::abs(x); }), h, 0.005, s + 1);
           }},
          {"magnitude_oscillator", "rectified_sensor",
           [=](std::uint64_t s) {
             const auto u = multisine(1500, 30, s);
             return recording(u, each(Oscillator{}.run(u, h), [](double x) { return std::abs(x); }), h, 0.01, s + 1);
           }},
          {"play_lag", "backlash",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 20, s);
             return recording(u, lag(play(u, 0.6), 0.1, h), h, 0.01, s + 1);
           }},
          {"play_oscillator", "backlash",
           [=](std::uint64_t s) {
             const auto u = multisine(1500, 20, s);
             return recording(u, Oscillator{}.run(play(u, 0.3), h), h, 0.01, s + 1);
           }},
          {"loop_lag", "hysteresis",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             return recording(u, lag(smooth_loop(u, 1.2, 0.5), 0.1, h), h, 0.01, s + 1);
           }},
          {"loop_multisine", "hysteresis",
           [=](std::uint64_t s) {
             const auto u = multisine(1500, 10, s);
             return recording(u, lag(smooth_loop(u, 1.5, 0.4), 0.06, h), h, 0.01, s + 1);
           }},
          {"limit_between_lags", "saturation",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 20, s);
             return recording(u, lag(each(lag(u, 0.1, h), [](double x) { return std::min(x, 0.5); }), 0.08, h), h, 0.01,
                              s + 1);
           }},
          {"limit_between_oscillators", "saturation",
           [=](std::uint64_t s) {
             const auto u = coloured(2500, 6, s);
             const auto middle = each(Oscillator{.omega = 12, .zeta = 0.3}.run(u, h),
                                      [](double x) { return x > 0.4 ? 0.4 + 0.1 * (x - 0.4) : x; });
             return recording(u, Oscillator{.omega = 7, .zeta = 0.5}.run(middle, h), h, 0.01, s + 1);
           }},
          {"limits_of_reading", "saturation",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, each(lag(u, 0.15, h), [](double x) { return std::clamp(x, -1.0, 0.8); }), h, 0.01,
                              s + 1);
           }},
          {"dead_band_lag", "dead_band",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             const auto dead = each(u, [](double x) { return std::abs(x) < 0.5 ? 0 : x - std::copysign(0.5, x); });
             return recording(u, lag(dead, 0.1, h), h, 0.01, s + 1);
           }},
          {"curve_lag", "static_curve",
           [=](std::uint64_t s) {
             const auto u = random_command(900, 25, s);
             return recording(u, lag(each(u, [](double x) { return x + 0.2 * x * x; }), 0.15, h), h, 0.02, s + 1);
           }},
          {"rate_limit_lag", "rate_limit",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 30, s);
             return recording(u, lag(rate_limited(u, 0.08), 0.08, h), h, 0.01, s + 1);
           }},
          {"slower_down", "asymmetric_response",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 30, s);
             return recording(u, lag(u, 0.1, h, 0.25), h, 0.01, s + 1);
           }},
          {"tone", "periodic_disturbance",
           [=](std::uint64_t s) {
             const auto u = random_command(1500, 25, s);
             auto y = lag(u, 0.15, h);
             for (std::size_t t = 0; t < y.size(); ++t)
               y[t] += 0.15 * std::sin(2 * std::numbers::pi * 7.3 * h * static_cast<double>(t));
             return recording(u, y, h, 0.03, s + 1);
           }},
          {"drift", "sensor_drift",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             auto y = lag(u, 0.15, h);
             for (std::size_t t = 0; t < y.size(); ++t) y[t] += 0.02 * h * static_cast<double>(t);
             return recording(u, y, h, 0.03, s + 1);
           }},
          {"gain_drops", "intermittent",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             auto y = lag(u, 0.15, h);
             for (std::size_t t = 700; t < y.size(); ++t) y[t] *= 0.7;
             return recording(u, y, h, 0.03, s + 1);
           }},
          {"delay", "none",
           [=](std::uint64_t s) {
             const auto u = coloured(1500, 8, s);
             return recording(u, later(Oscillator{}.run(u, h), 10), h, 0.02, s + 1);
           }},
          {"tanks_square_root", "orifice_flow",
           [=](std::uint64_t s) {
             const auto u = each(random_command(900, 20, s), [](double x) { return 2.2 + x; });
             return recording(u, Tanks{}.run(u, 1.0), 1.0, 0.03, s + 1);
           }},
          {"tanks_overflow", "orifice_flow+saturation",
           [=](std::uint64_t s) {
             const auto u = each(random_command(1200, 20, s), [](double x) { return 2.6 + 1.2 * x; });
             return recording(u, Tanks{.rim_upper = 9, .rim_lower = 8}.run(u, 1.0), 1.0, 0.03, s + 1);
           }},
          {"sticking_valve_in_loop", "friction", [=](std::uint64_t s) { return regulated(1500, h, 0.15, 0.05, s); }}};
}

/// Machines with something wrong that has no name in the vocabulary: unexplained or none, at most ambiguous.
inline std::vector<Case> strange_machines() {
  constexpr double h = kStep_s;
  return {{"drag", "outside",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             const Oscillator drag{.force = [](double y, double v) { return y + 0.05 * v * std::abs(v); }};
             return recording(u, drag.run(u, h), h, 0.01, s + 1);
           }},
          {"gain_by_product", "outside",
           [=](std::uint64_t s) {
             const auto u = random_command(1200, 25, s);
             const auto fast = lag(u, 0.05, h), slow = lag(u, 0.6, h);
             auto y = fast;
             for (std::size_t t = 0; t < y.size(); ++t) y[t] *= 1 + 0.4 * slow[t];
             return recording(u, y, h, 0.01, s + 1);
           }},
          {"stiffness_that_swings", "outside",
           [=](std::uint64_t s) {
             const auto u = random_command(1500, 25, s);
             auto y = u;
             double state = 0;
             for (std::size_t t = 0; t < y.size(); ++t) {
               y[t] = state;
               const double rate = 0.1 * (1 + 0.6 * std::sin(0.031 * static_cast<double>(t)));
               state += rate * (u[t] - state);
             }
             return recording(u, y, h, 0.01, s + 1);
           }},
          {"random_telegraph", "outside", [=](std::uint64_t s) {
             const auto u = random_command(1500, 25, s);
             auto y = lag(u, 0.15, h);
             Noise noise(s + 5);
             double level = 0.2;
             for (double& value : y) {
               if (noise.uniform() < 0.02) level = -level;
               value += level;
             }
             return recording(u, y, h, 0.02, s + 1);
           }}};
}

}  // namespace valvetriage::machines
