#pragma once

#include "tests/second_stand/faults.h"
#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/lift_table.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// The port as the spool finds it: the unit's holes, with a land left blank or reshaped where that is a fault.
class Port {
 public:
  Port(const Unit& unit, const Faults& faults);

  double area(double lift_mm) const { return area_(lift_mm - blanked(lift_mm)); }
  const Outlet& outlet() const { return outlet_; }
  /// Where an upper stop holds the spool.
  double highest_mm() const { return highest_mm_; }

 private:
  /// How far the edge is behind for the blank land below this lift.
  double blanked(double lift_mm) const;

  Outlet outlet_;
  LiftTable area_;
  double blank_from_mm_ = 0, blank_mm_ = 0, highest_mm_;
};

}  // namespace valvetriage::second_stand
