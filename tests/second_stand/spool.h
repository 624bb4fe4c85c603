#pragma once

#include "tests/second_stand/faults.h"
#include "tests/second_stand/linear_parts.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// Armature and spool on their spring: a machine of three states, moved exactly from event to event.
///
///   sliding  m ẍ = F (1 - λ x) - preload - k x (+ cubic) - d ẋ - dir · friction
///   stuck    held by its asperities, which give elastically: k_t (x - anchor) = force
///   stopped  at its lower or upper stop
///
/// Friction is Armstrong's seven-parameter law (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994): presliding
/// stiffness, Coulomb and viscous friction, a Stribeck curve 1 / (1 + (v / v_s)²) that follows the speed with a memory,
/// and a breakaway that grows with the time at rest.
class Spool {
 public:
  Spool(const Unit& unit, const Faults& faults, double highest_mm, double step_s);

  /// Stuck at balance under this current but for `share` (-1 to 1) of what friction holds, `rested_s` long.
  void place(double effective_a, double share, double rested_s);

  /// One step under a constant effective current. Returns the lift [mm].
  double advance(double effective_a);

  double lift_mm() const { return motion_.position; }
  double speed_mm_per_s() const { return phase_ == Phase::kSliding ? motion_.speed : 0; }

 private:
  enum class Phase { kStuck, kSliding, kStopped };

  /// All forces but friction and viscous damping.
  double force_n(double coil_n, double lift_mm) const;
  double breakaway_n(double rested_s) const;
  double sliding_friction_n() const;
  void hold(double coil_n, double seconds);
  /// Slides until the time is over or something happens; returns the time left.
  double slide(double coil_n, double seconds);
  void come_to_rest(double coil_n);
  void stop_at(double lift_mm);
  void leave_stop(double coil_n);

  double step_s_;
  double spring_, stroke_loss_, preload_, cubic_, full_mm_, closed_mm_, highest_mm_;
  double coulomb_n_, static_n_, fresh_ratio_, stribeck_mm_per_s_, asperity_n_per_mm_;
  double fastest_mm_per_s_;
  const Unit& unit_;
  Oscillator free_;
  Oscillator::State motion_;
  Phase phase_ = Phase::kStuck;
  double anchor_mm_ = 0, rested_s_ = 0, direction_ = 1, static_now_n_ = 0;
  Lag remembered_speed_;
};

}  // namespace valvetriage::second_stand
