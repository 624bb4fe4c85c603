#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/analysis/analysis.h"
#include "core/model/model.h"
#include "core/model/reference.h"
#include "core/recording/quality.h"
#include "core/recording/recording.h"
#include "core/result.h"
#include "server/report/svg_plot.h"

namespace valvetriage::report {

/// Free run of a model on a recording's input, on the recording's grid.
///
/// As in the analysis, the initial state is estimated rather than assumed; the run itself sees the input alone. A
/// recording that begins at rest hardly determines a fast state: where the steady state at the first input fits better,
/// it is the estimate.
///
/// known   tests on which what good valves leave belongs to the simulation: tests_taken_off
/// Errors  those of simulate_extended
Result<std::vector<double>> free_run(const Model& model, const Recording& recording,
                                     std::span<const KnownTest> known = {});

/// Of the reference that a baseline was compared with, the tests on which what good valves leave in common was taken
/// off of the valve; none where nothing was. `reference` may be null.
std::span<const KnownTest> tests_taken_off(const Baseline& baseline, const Reference* reference);

/// The stamps of the recording's uniform grid, in seconds.
std::vector<double> grid_times(const Recording& recording);

/// The measured output; samples inside gaps are NaN.
std::vector<double> measured_output(const Recording& recording);

/// What a segment does, in two words: "1.40 A", "ramp", "sweep".
std::string segment_name(const Segment& segment, const std::string& unit);

/// Where the items of a recording stand, in time's order: quality_places, and where the input is outside the reference.
///
/// reference  that the recording was compared with; null: none
std::vector<QualityPlace> marked_places(const Recording& recording, const Reference* reference);

/// At most `most` of a recording's segments and at most as many of its marked places, the first ones.
std::vector<Stretch> recording_stretches(const Recording& recording, const Reference* reference, std::size_t most);

/// Output with both simulations, residuals and input, each reduced to `points` points so that every peak stays.
///
/// extended  null: there is no extended model to show
/// known     as in free_run
Result<std::vector<Panel>> recording_panels(const Recording& recording, const Model& baseline, const Model* extended,
                                            std::size_t points, std::span<const KnownTest> known);

}  // namespace valvetriage::report
