#pragma once

#include "tests/second_stand/lift_table.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

constexpr double kSupplyPsi = 290;
constexpr double kAtmospherePsi = 14.7;
/// The range of the contract's laws that are relative to one.
constexpr double kRangePsi = 210;

/// Flow through a port of an area that changes from laminar to turbulent with its Reynolds number (README, 7).
double port_flow(double area, double drop_psi);

/// The restrictor behind the volume and the clearance past the spool: laminar and turbulent losses in series.
/// Flows are in psi/s: over the nominal volume's capacity without air.
class Outlet {
 public:
  /// `exponent_added`: to the slope of log flow over log pressure at 120 psi, where the flow stays what it was.
  explicit Outlet(const Unit& unit, double exponent_added = 0, double leak_added = 0);

  double flow(double pressure_psi) const { return through(pressure_psi) + leak(pressure_psi); }
  double through(double pressure_psi) const;
  double leak(double pressure_psi) const;
  double exponent_at_120() const;

 private:
  double laminar_, turbulent_, leak_size_;
};

/// Uncovered area over the spool's lift, by the unit's holes.
LiftTable port_area(const Unit& unit);

/// Pressure at which a port of this area and an outlet are in balance.
double balanced_psi(double area, const Outlet& outlet);

/// The area that holds this pressure.
double area_for(double pressure_psi, const Outlet& outlet);

/// How much more the volume takes in per psi than without air, at this pressure.
double air_capacity(double air, double pressure_psi);

}  // namespace valvetriage::second_stand
