#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace valvetriage::second_stand {

constexpr int kHolesPerRow = 5;

/// A row of round holes that the spool's edge uncovers, each drilled a little off its place.
struct Row {
  double first_mm = 0, diameter_mm = 1, area = 0;  ///< where it begins to open; area [psi/s/√psi] when fully open
  std::array<double, kHolesPerRow> off_mm{};
};

/// A healthy valve. Nominal values here; spread and correlation in unit.cpp; README.
struct Unit {
  // driver and coil
  double latency_s = 0.003;
  double driver_rad_s = 430, driver_damping = 0.85;
  double eddy_share = 0.3, eddy_time_s = 0.008;
  double force_n_per_a2 = 9, saturation_a = 2.2, stroke_loss_per_mm = 0.03;
  double loop_width_a = 0.0045;
  // armature and spool
  double mass_kg = 0.05, spring_n_per_mm = 8, damping_ratio = 0.7;
  double preload_n = 0;  ///< set when the valve is trimmed
  double breakaway_a = 0.0012, kinetic_ratio = 0.75, fresh_ratio = 0.8, stribeck_mm_per_s = 0.6;
  // ports and volume
  double clearance_area = 2.6, notch_area_per_mm = 34;
  Row low{0.578, 0.918, 242, {}}, high{1.423, 0.9515, 570, {}};
  double laminar_share = 0.12, outlet_size = 1;
  double leak_fraction = 0.012;
  double volume = 1, air = 0.08;
  // gauge
  double gauge_rad_s = 280, gauge_damping = 0.7, gauge_offset_psi = 0;
  double trim_psi = 112;  ///< what the trimming bench aims at at 1.6 A, and misses a little
};

/// Independent standard normals that make a unit: its own tolerances and a few causes common to several of them.
using Latents = std::vector<double>;

/// How many there are, and what each is called.
const std::vector<std::string>& latent_names();

/// The unit that these make, trimmed. All zero: the nominal unit.
Unit unit_of(const Latents& latents);

Latents draw_latents(std::uint64_t seed);

}  // namespace valvetriage::second_stand
