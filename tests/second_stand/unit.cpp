#include "tests/second_stand/unit.h"

#include <algorithm>
#include <cmath>

#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/magnet.h"
#include "tests/second_stand/random.h"

namespace valvetriage::second_stand {
namespace {

/// Causes that several tolerances have in common.
enum class Common { kNone, kFit, kWinding, kWire, kDrill };
constexpr int kCommons = 4;

/// A number that spreads log-normally: value · e^(spread z), z = loading · common + √(1 - loading²) · own.
struct Spread {
  const char* name;
  double& (*of)(Unit&);
  double spread;
  Common common = Common::kNone;
  double loading = 0;
};

const std::vector<Spread>& spreads() {
  static const std::vector<Spread> table = {
      {"latency", [](Unit& u) -> double& { return u.latency_s; }, 0.10},
      {"driver speed", [](Unit& u) -> double& { return u.driver_rad_s; }, 0.06},
      {"eddy share", [](Unit& u) -> double& { return u.eddy_share; }, 0.10, Common::kWinding, 0.5},
      {"eddy time", [](Unit& u) -> double& { return u.eddy_time_s; }, 0.08, Common::kWinding, 0.5},
      {"coil force", [](Unit& u) -> double& { return u.force_n_per_a2; }, 0.008, Common::kWinding, 0.7},
      {"coil saturation", [](Unit& u) -> double& { return u.saturation_a; }, 0.006, Common::kWinding, -0.4},
      {"loop width", [](Unit& u) -> double& { return u.loop_width_a; }, 0.2},
      {"mass", [](Unit& u) -> double& { return u.mass_kg; }, 0.03},
      {"spring", [](Unit& u) -> double& { return u.spring_n_per_mm; }, 0.01, Common::kWire, 0.8},
      {"damping", [](Unit& u) -> double& { return u.damping_ratio; }, 0.08, Common::kFit, -0.6},
      {"breakaway", [](Unit& u) -> double& { return u.breakaway_a; }, 0.25, Common::kFit, -0.7},
      {"kinetic ratio", [](Unit& u) -> double& { return u.kinetic_ratio; }, 0.04},
      {"Stribeck speed", [](Unit& u) -> double& { return u.stribeck_mm_per_s; }, 0.2},
      {"clearance", [](Unit& u) -> double& { return u.clearance_area; }, 0.15, Common::kFit, 0.8},
      {"leak", [](Unit& u) -> double& { return u.leak_fraction; }, 0.25, Common::kFit, 0.8},
      {"notch", [](Unit& u) -> double& { return u.notch_area_per_mm; }, 0.02},
      {"low row area", [](Unit& u) -> double& { return u.low.area; }, 0.006, Common::kDrill, 0.8},
      {"low row diameter", [](Unit& u) -> double& { return u.low.diameter_mm; }, 0.003, Common::kDrill, 0.8},
      {"high row area", [](Unit& u) -> double& { return u.high.area; }, 0.006, Common::kDrill, 0.8},
      {"high row diameter", [](Unit& u) -> double& { return u.high.diameter_mm; }, 0.003, Common::kDrill, 0.8},
      {"outlet", [](Unit& u) -> double& { return u.outlet_size; }, 0.005, Common::kDrill, 0.5},
      {"laminar share", [](Unit& u) -> double& { return u.laminar_share; }, 0.12},
      {"volume", [](Unit& u) -> double& { return u.volume; }, 0.05},
      {"air", [](Unit& u) -> double& { return u.air; }, 0.2},
      {"gauge speed", [](Unit& u) -> double& { return u.gauge_rad_s; }, 0.05},
  };
  return table;
}

/// A number that spreads evenly about its nominal value.
struct Offset {
  const char* name;
  double& (*of)(Unit&);
  double spread;
};

const std::vector<Offset>& offsets() {
  static const std::vector<Offset> table = {
      {"gauge offset", [](Unit& u) -> double& { return u.gauge_offset_psi; }, 0.15},
      {"trim", [](Unit& u) -> double& { return u.trim_psi; }, 1.2},
      {"low row place", [](Unit& u) -> double& { return u.low.first_mm; }, 0.0025},
      {"high row place", [](Unit& u) -> double& { return u.high.first_mm; }, 0.0025},
  };
  return table;
}

constexpr double kHoleMm = 0.004;  // each hole about its place in the row

/// The preload is turned until the valve delivers what the bench asks for at 1.6 A.
void trim(Unit& unit) {
  const LiftTable area = port_area(unit);
  const double lift_mm = area.lift_of(area_for(unit.trim_psi, Outlet(unit)));
  const double force_n = coil_force_n(unit, 1.6);
  unit.preload_n = force_n * (1 - unit.stroke_loss_per_mm * lift_mm) - unit.spring_n_per_mm * lift_mm;
}

}  // namespace

const std::vector<std::string>& latent_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all = {"fit", "winding", "wire", "drill"};
    for (const Spread& spread : spreads()) all.emplace_back(spread.name);
    for (const Offset& offset : offsets()) all.emplace_back(offset.name);
    for (const char* row : {"low", "high"})
      for (int i = 0; i < kHolesPerRow; ++i) all.push_back(std::string(row) + " hole " + std::to_string(i));
    return all;
  }();
  return names;
}

Unit unit_of(const Latents& latents) {
  Unit unit;
  std::size_t next = kCommons;
  for (const Spread& spread : spreads()) {
    const double own = std::sqrt(1 - spread.loading * spread.loading) * latents[next++];
    const double shared =
        spread.common == Common::kNone ? 0 : spread.loading * latents[static_cast<std::size_t>(spread.common) - 1];
    spread.of(unit) *= std::exp(spread.spread * (own + shared));
  }
  for (const Offset& offset : offsets()) offset.of(unit) += offset.spread * latents[next++];
  for (Row* row : {&unit.low, &unit.high})
    for (double& off_mm : row->off_mm) off_mm = kHoleMm * latents[next++];
  unit.damping_ratio = std::min(unit.damping_ratio, 0.95);  // its motion is integrated as that of an oscillator
  trim(unit);
  return unit;
}

Latents draw_latents(std::uint64_t seed) {
  Random random(seed, "unit");
  Latents latents;
  for (std::size_t i = 0; i < latent_names().size(); ++i) latents.push_back(random.inspected());
  return latents;
}

}  // namespace valvetriage::second_stand
