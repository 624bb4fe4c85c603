#pragma once

#include <cmath>

namespace valvetriage::second_stand {

/// τ ẏ = u − y, exact over a step during which u is constant.
class Lag {
 public:
  Lag() = default;
  Lag(double time_constant_s, double step_s)
      : forgotten_(time_constant_s > 0 ? -std::expm1(-step_s / time_constant_s) : 1) {}
  double advance(double input) { return value_ += forgotten_ * (input - value_); }
  void settle(double value) { value_ = value; }
  double value() const { return value_; }

 private:
  double forgotten_ = 1, value_ = 0;
};

/// Motion of ẍ = ω² (u − x) − 2 ζ ω ẋ, exact for a constant u; 0 < ζ < 1.
class Oscillator {
 public:
  struct State {
    double position = 0, speed = 0;
  };

  Oscillator() = default;
  Oscillator(double rad_s, double damping_ratio, double step_s)
      : decay_(damping_ratio * rad_s),
        ringing_(rad_s * std::sqrt(1 - damping_ratio * damping_ratio)),
        stiffness_(rad_s * rad_s),
        whole_(over(step_s)) {}

  /// Over the step that the oscillator was made for.
  State advanced(State from, double input) const { return moved(from, input, whole_); }
  /// Over any other time.
  State advanced(State from, double input, double seconds) const { return moved(from, input, over(seconds)); }

 private:
  struct Motion {
    double position_of_position = 1, position_of_speed = 0, speed_of_position = 0, speed_of_speed = 1;
  };
  Motion over(double seconds) const {
    const double fade = std::exp(-decay_ * seconds);
    const double c = std::cos(ringing_ * seconds), s = std::sin(ringing_ * seconds) / ringing_;
    return {fade * (c + decay_ * s), fade * s, -fade * stiffness_ * s, fade * (c - decay_ * s)};
  }
  static State moved(State from, double input, const Motion& by) {
    const double away = from.position - input;
    return {input + by.position_of_position * away + by.position_of_speed * from.speed,
            by.speed_of_position * away + by.speed_of_speed * from.speed};
  }

  double decay_ = 0, ringing_ = 1, stiffness_ = 1;
  Motion whole_;
};

/// An oscillator as a filter of a signal.
class Resonator {
 public:
  Resonator() = default;
  Resonator(double rad_s, double damping_ratio, double step_s) : law_(rad_s, damping_ratio, step_s) {}
  double advance(double input) {
    state_ = law_.advanced(state_, input);
    return state_.position;
  }
  void settle(double value) { state_ = {value, 0}; }

 private:
  Oscillator law_;
  Oscillator::State state_;
};

}  // namespace valvetriage::second_stand
