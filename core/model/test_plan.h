#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/model/static_map.h"
#include "core/result.h"

namespace valvetriage {

/// Kinds of test whose current the stand can play.
enum class PlannedTest : std::uint8_t { kStep, kStaircase, kTriangle, kSweep, kMultisine };

/// What to play. Levels are pressures; the steady map turns them into currents, and the current is drawn between those.
///
/// kStep       rest at the lowest level, one step to each level in turn and back to rest
/// kStaircase  up through the levels and down again, one hold each
/// kTriangle   a constant rate from the lowest to the highest level and back, `duration_s` for both ways together
/// kSweep      one sine between the lowest and the highest level, its frequency rising exponentially
/// kMultisine  odd multiples of 1 / period with random phases, every fourth of them left out (lines that a linear valve
///             leaves empty), scaled to the range between the lowest and the highest level; the period is duration_s /
///             2
struct TestPlan {
  PlannedTest test = PlannedTest::kStep;
  std::vector<double> levels_psi;
  double sample_rate_hz = 200;
  double hold_s = 4;       ///< kStep, kStaircase: time at each level
  double duration_s = 60;  ///< kTriangle, kSweep, kMultisine
  double from_hz = 0.1;    ///< kSweep, kMultisine
  double to_hz = 20;       ///< kSweep, kMultisine; at most a fifth of the sample rate
  std::uint64_t seed = 1;  ///< kMultisine: the phases
};

/// The current of a plan, one value per sample from time 0 [A].
///
/// steady_map  current [A] to steady pressure [psi]
/// Errors      `level_out_of_range` outside the map, `bad_plan` with the option that is wrong, `too_large`
/// Cost        O(n), the multisine O(n · lines)
Result<std::vector<double>> plan_current(const TestPlan& plan, const StaticMap& steady_map);

/// A planned input as the stand takes it: `time_s,current_A` (or `time_s,input` for a machine without units), one row
/// per sample.
std::string plan_csv(std::span<const double> input, double sample_rate_hz, bool is_current = true);

/// The steady map of the paper's Fig 2: 1.2 A to 3.1 psi, 1.4 to 26, 1.6 to 120, 1.8 to 160, 2.0 to 210.
StaticMap paper_steady_map();

}  // namespace valvetriage
