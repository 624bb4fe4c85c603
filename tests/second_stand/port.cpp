#include "tests/second_stand/port.h"

#include <algorithm>
#include <vector>

#include "tests/second_stand/magnet.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kLastMm = 2.5;

/// Holes filed so that the steady pressure is y + c R q (1 - q), q = y / R.
LiftTable reshaped(const LiftTable& area, const Outlet& outlet, double curvature) {
  std::vector<double> filed;
  for (std::size_t k = 0; k < area.size(); ++k) {
    const double pressure = balanced_psi(area(area.lift_mm(k)), outlet), q = pressure / kRangePsi;
    filed.push_back(area_for(pressure + curvature * kRangePsi * q * (1 - q), outlet));
  }
  return {0, area.lift_mm(area.size() - 1), std::move(filed)};
}

}  // namespace

Port::Port(const Unit& unit, const Faults& faults)
    : outlet_(unit, faults.exponent_added, faults.leak_fraction), area_(port_area(unit)), highest_mm_(kLastMm) {
  if (faults.curvature != 0) area_ = reshaped(area_, outlet_, faults.curvature);
  if (faults.blank_a > 0) {
    blank_from_mm_ = balanced_lift_mm(unit, faults.blank_from_a);
    blank_mm_ = balanced_lift_mm(unit, faults.blank_from_a + faults.blank_a) - blank_from_mm_;
  }
  if (faults.stop_psi == Faults::kNever) return;
  const double edge_mm = area_.lift_of(area_for(faults.stop_psi, outlet_));
  highest_mm_ = edge_mm > blank_from_mm_ ? edge_mm + blank_mm_ : edge_mm;
}

double Port::blanked(double lift_mm) const {
  return std::clamp(lift_mm - blank_from_mm_, 0.0, blank_mm_);
}

}  // namespace valvetriage::second_stand
