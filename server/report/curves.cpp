#include "server/report/curves.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/analysis/known_tests.h"
#include "core/analysis/outside_reference.h"
#include "core/mechanisms/simulate_extended.h"
#include "server/report/downsample.h"
#include "server/report/sentence.h"

namespace valvetriage::report {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double squared_error(const Recording& recording, const std::vector<double>& simulated) {
  double sum = 0;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    const double error = recording.output.values[i] - simulated[i];
    if (recording.is_valid(i) && std::isfinite(error)) sum += error * error;
  }
  return sum;
}

std::string with_unit(const char* name, const std::string& unit) {
  return unit.empty() ? name : std::string(name) + " [" + unit + "]";
}

/// Draws values on a recording's grid.
struct Pen {
  std::vector<double> time_s;
  std::size_t points = 0;

  Curve draw(std::string name, Ink ink, const std::vector<double>& values) const {
    Points shown = downsample(time_s, values, -kInfinity, kInfinity, points);
    return {.name = std::move(name), .ink = ink, .x = std::move(shown.time_s), .y = std::move(shown.value)};
  }
};

std::vector<double> difference(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

}  // namespace

std::span<const KnownTest> tests_taken_off(const Baseline& baseline, const Reference* reference) {
  if (!baseline.on_known_tests || !reference || reference->on_known_tests.empty()) return {};
  return reference->on_known_tests.front().tests;
}

Result<std::vector<double>> free_run(const Model& model, const Recording& recording, std::span<const KnownTest> known) {
  if (const std::vector<double> common = left_in_common(recording, known); !common.empty()) {
    Recording without = recording;
    take_off(common, without);
    auto run = free_run(model, without);
    if (run) put_back(common, *run);
    return run;
  }
  const InitialState estimated{.kind = InitialState::Kind::kMeasured, .samples = recording.samples()};
  auto fitted = simulate_extended(model, recording, estimated);
  auto steady = simulate_extended(model, recording, InitialState{});
  if (!fitted || !steady) return fitted ? fitted : steady;
  return squared_error(recording, *steady) < squared_error(recording, *fitted) ? steady : fitted;
}

std::vector<double> grid_times(const Recording& recording) {
  std::vector<double> time_s(recording.samples());
  for (std::size_t i = 0; i < time_s.size(); ++i) {
    time_s[i] = recording.start_s + static_cast<double>(i) * recording.sample_period_s;
  }
  return time_s;
}

std::vector<double> measured_output(const Recording& recording) {
  std::vector<double> values = recording.output.values;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!recording.is_valid(i)) values[i] = std::nan("");
  }
  return values;
}

std::string segment_name(const Segment& segment, const std::string& unit) {
  if (segment.kind == SegmentKind::kRamp) return "ramp";
  if (segment.kind == SegmentKind::kSweep) return "sweep";
  return fmt::format("{:.2f}{}{}", segment.level, unit.empty() ? "" : " ", unit);
}

std::vector<QualityPlace> marked_places(const Recording& recording, const Reference* reference) {
  std::vector<QualityPlace> places = quality_places(recording);
  if (!reference) return places;
  const std::vector<QualityPlace> outside = outside_reference_places(recording, *reference);
  const auto middle = places.insert(places.end(), outside.begin(), outside.end());
  std::inplace_merge(places.begin(), middle, places.end(),
                     [](const QualityPlace& a, const QualityPlace& b) { return a.begin < b.begin; });
  return places;
}

std::vector<Stretch> recording_stretches(const Recording& recording, const Reference* reference, std::size_t most) {
  const auto time = [&](std::size_t i) {
    return recording.start_s + static_cast<double>(i) * recording.sample_period_s;
  };
  std::vector<Stretch> stretches;
  for (const Segment& segment : recording.segments) {
    if (stretches.size() == most) break;
    stretches.push_back({.from = time(segment.begin),
                         .to = time(segment.end),
                         .name = segment_name(segment, recording.input.unit),
                         .odd = false});
  }
  const std::vector<QualityPlace> places = marked_places(recording, reference);
  for (std::size_t i = 0; i < std::min(places.size(), most); ++i) {
    const QualityPlace& place = places[i];
    stretches.push_back(
        {.from = time(place.begin), .to = time(place.end), .name = spoken(std::string(place.code)), .odd = true});
  }
  return stretches;
}

Result<std::vector<Panel>> recording_panels(const Recording& recording, const Model& baseline, const Model* extended,
                                            std::size_t points, std::span<const KnownTest> known) {
  const Pen pen{.time_s = grid_times(recording), .points = points};
  const std::vector<double> measured = measured_output(recording);
  const auto simulated = free_run(baseline, recording, known);
  if (!simulated) return tl::unexpected(simulated.error());
  Panel output{.title = with_unit("Output", recording.output.unit), .height = 200, .curves = {}};
  Panel residual{.title = with_unit("Residual", recording.output.unit), .height = 130, .curves = {}};
  output.curves = {pen.draw("measured", Ink::kMeasured, measured), pen.draw("simulated", Ink::kSimulated, *simulated)};
  residual.curves = {pen.draw("of the simulation", Ink::kSimulated, difference(measured, *simulated))};
  if (extended) {
    const auto run = free_run(*extended, recording, known);
    if (!run) return tl::unexpected(run.error());
    output.curves.push_back(pen.draw("extended simulation", Ink::kExtended, *run));
    residual.curves.push_back(pen.draw("of the extended simulation", Ink::kExtended, difference(measured, *run)));
  }
  Panel input{.title = with_unit("Input", recording.input.unit), .height = 90, .curves = {}};
  input.curves = {pen.draw("input", Ink::kInput, recording.input.values)};
  return std::vector<Panel>{std::move(output), std::move(residual), std::move(input)};
}

}  // namespace valvetriage::report
