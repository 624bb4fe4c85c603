#include "tests/second_stand/hydraulics.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace valvetriage::second_stand {
namespace {

constexpr double kFlowAt120 = 2464;  // psi/s: with the ports, 55 ms of time constant at 120 psi
constexpr double kTransition = 0.02;
constexpr double kLeakTransitionPsi = 2;

/// Uncovered share of a round hole: a segment of a circle.
double uncovered(double share_of_diameter) {
  const double s = std::clamp(share_of_diameter, 0.0, 1.0);
  return (std::acos(1 - 2 * s) - 2 * (1 - 2 * s) * std::sqrt(s - s * s)) / std::numbers::pi;
}

double row_area(const Row& row, double lift_mm) {
  constexpr double kStaggerMm = 0.03;  // holes of a row begin one after the other, so that the map has no corner
  double sum = 0;
  for (int i = 0; i < kHolesPerRow; ++i) {
    const double edge_mm = row.first_mm + kStaggerMm * (i - 0.5 * (kHolesPerRow - 1)) + row.off_mm[i];
    sum += uncovered((lift_mm - edge_mm) / row.diameter_mm);
  }
  return row.area * sum / kHolesPerRow;
}

double leak_law(double pressure_psi) {
  const double p = std::max(pressure_psi, 0.0);
  return std::sqrt(p) * std::tanh(std::sqrt(p / kLeakTransitionPsi));
}

/// The root of a falling function.
template <class Function>
double root(double low, double high, Function falling) {
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    (falling(middle) > 0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

double port_flow(double area, double drop_psi) {
  if (drop_psi <= 0) return 0;
  return area * std::sqrt(drop_psi) * std::tanh(kTransition * std::sqrt(area * drop_psi));
}

Outlet::Outlet(const Unit& unit, double exponent_added, double leak_added) {
  // The exponent at 120 psi is 1 / (2 - s) with s the laminar share of the drop there.
  const double exponent = 1 / (2 - unit.laminar_share) + exponent_added;
  const double share = 2 - 1 / exponent;
  const double flow_at_120 = kFlowAt120 * unit.outlet_size;
  laminar_ = share * 120 / flow_at_120;
  turbulent_ = (1 - share) * 120 / (flow_at_120 * flow_at_120);
  // Over the through-flow of the unit without what is added to it.
  const double full_flow = exponent_added == 0 ? through(kRangePsi) : Outlet(unit).through(kRangePsi);
  leak_size_ = (unit.leak_fraction + leak_added) * full_flow / leak_law(kRangePsi);
}

double Outlet::through(double pressure_psi) const {
  const double p = std::max(pressure_psi, 0.0);
  return 2 * p / (laminar_ + std::sqrt(laminar_ * laminar_ + 4 * turbulent_ * p));
}

double Outlet::leak(double pressure_psi) const {
  return leak_size_ * leak_law(pressure_psi);
}

double Outlet::exponent_at_120() const {
  const double flow = through(120);
  return (laminar_ + turbulent_ * flow) / (laminar_ + 2 * turbulent_ * flow);
}

LiftTable port_area(const Unit& unit) {
  constexpr double kLastMm = 2.6;
  constexpr int kNodes = 521;
  std::vector<double> area;
  for (int k = 0; k < kNodes; ++k) {
    const double lift_mm = kLastMm * k / (kNodes - 1);
    area.push_back(unit.clearance_area + unit.notch_area_per_mm * lift_mm + row_area(unit.low, lift_mm) +
                   row_area(unit.high, lift_mm));
  }
  return {0, kLastMm, std::move(area)};
}

double balanced_psi(double area, const Outlet& outlet) {
  return root(0, kSupplyPsi, [&](double p) { return port_flow(area, kSupplyPsi - p) - outlet.flow(p); });
}

double area_for(double pressure_psi, const Outlet& outlet) {
  return root(0, 1e5,
              [&](double area) { return outlet.flow(pressure_psi) - port_flow(area, kSupplyPsi - pressure_psi); });
}

double air_capacity(double air, double pressure_psi) {
  // Polytropic bubbles (n = 1.2): compressibility goes with p^-(1 + 1/n); `air` is their share at 26 psi.
  constexpr double kPower = 1 + 1 / 1.2;
  return 1 + air * std::pow((26 + kAtmospherePsi) / (std::max(pressure_psi, 0.0) + kAtmospherePsi), kPower);
}

}  // namespace valvetriage::second_stand
