#pragma once

#include <vector>

#include "tests/second_stand/day.h"
#include "tests/second_stand/faults.h"
#include "tests/second_stand/linear_parts.h"
#include "tests/second_stand/random.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// What lies between the volume and the log: stage, line, gauge, cable (README, 8 to 10).
class OutputStage {
 public:
  /// `begins_s`: the time of the first step.
  OutputStage(const Unit& unit, const Faults& faults, const Day& day, double begins_s, double step_s);

  /// As if it had stood at this pressure for long.
  void settle(double pressure_psi);

  /// One step: pressure and through-flow (over that at 120 psi) at its end, driver current and its change.
  void advance(double pressure_psi, double flow_ratio, double current_a, double change_a);

  /// What the gauge says at a time.
  double reading_psi(double t_s) const;

 private:
  double staged_psi(double pressure_psi, double current_a);
  double hunting_psi(double pressure_psi);
  double stand_psi() const;
  double turbulence_psi(double flow_ratio);
  double echoed_psi(double pressure_psi);

  const Unit& unit_;
  const Faults& faults_;
  const Day& day_;
  double begins_s_, step_s_, now_s_;
  Lag warmth_;
  Resonator gauge_;
  double before_psi_ = 0;
  double cycle_ = 0, cycle_rate_ = 0;
  Random turbulence_;
  Lag eddies_;
  std::vector<double> line_psi_, gauge_psi_;
};

}  // namespace valvetriage::second_stand
