#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"

namespace valvetriage {

/// Kind of test-stand recording. Inferred from the input where the metadata do not say.
enum class TestKind : std::uint8_t { kStep, kStaircase, kTriangle, kSweep, kOther };

std::string to_string(TestKind kind);
std::optional<TestKind> test_kind_from(const std::string& name);

/// The `# key: value` lines of a recording. `condition` is a label and never an input to a verdict.
struct Metadata {
  std::optional<std::string> serial, lot, valve_type, condition, test, stand, tested_at, operator_name, claim,
      complaint, hours;
  std::map<std::string, std::string> others;  ///< keys the contract does not name, kept as they came
};

/// Something about the samples that a reader must know. Codes: gap jitter clipped stuck outliers quantised feedback
/// outside_reference. Nothing is dropped silently: `detail` says where.
struct QualityItem {
  std::string code;
  std::string detail;
  std::size_t count = 0;
};

/// One measured column. Times are seconds, currents A, pressures psi; any other unit is "" and keeps its numbers.
struct Channel {
  std::string name;            ///< as in the file, `current_A`
  std::string quantity;        ///< without the unit suffix, `current`
  std::string unit;            ///< unit of `values` after conversion: "A", "psi", "s" or ""
  std::string file_unit;       ///< unit in the file, "mA", "bar"; "" where unitless
  double file_unit_scale = 1;  ///< values = number in the file * file_unit_scale
  std::vector<double> values;
};

/// A stretch of the input that does one thing.
///
/// kHold   input constant within its noise; `level` is its mean
/// kStep   a hold entered by a jump of the input at `begin`; `level` the level after, `from_level` before
/// kRamp   input monotone at a nearly constant rate
/// kSweep  oscillating input (swept sine, multisine, noise)
enum class SegmentKind : std::uint8_t { kHold, kStep, kRamp, kSweep };

struct Segment {
  SegmentKind kind = SegmentKind::kHold;
  std::size_t begin = 0;   ///< first sample
  std::size_t end = 0;     ///< one past the last sample
  double level = 0;        ///< input level (mean over the segment for kSweep), unit of the input
  double from_level = 0;   ///< input level before a step, or at the start of a ramp
  double rate_per_s = 0;   ///< slope of a ramp
  bool from_jump = false;  ///< of a ramp or a sweep: the input jumps at `begin` and moves on from there

  /// A command that is held until its sample, however it goes on.
  bool begins_with_jump() const { return kind == SegmentKind::kStep || from_jump; }
};

/// Where a step of the input lies inside an interval of a grid that is not the file's own stamps.
struct InputJump {
  std::size_t interval = 0;  ///< from this sample to the next
  double fraction = 1;       ///< of the interval that passes before it, above 0 to 1
  bool in_gap = false;       ///< rows are missing just there: the instant is the latest possible
};

/// Noise of the log of an input that is smooth from row to row but, by a clock that jitters, not in time: one loop
/// writes the command and reads the gauges. In time the roughness of such an input is as real as its shape.
struct InputNoise {
  std::vector<double> values;  ///< on the grid, as much as can be told
  double left = 0;             ///< standard deviation of what the input still has without them
};

/// One time series from the test stand, as everything above this floor sees it: uniformly sampled, converted.
///
/// `time_s` are the file's own stamps, n of them, strictly increasing. Where the stamps are uniform the grid is the
/// stamps; where they jitter or have gaps the grid is `start_s + i * sample_period_s` and the channels are resampled on
/// it, with `valid[i] == 0` on grid samples that lie inside a gap (they take no part in any sum).
struct Recording {
  std::string name;  ///< file name or title; never a path
  Metadata metadata;
  TestKind test = TestKind::kOther;
  bool test_inferred = false;

  std::vector<double> time_s;       ///< stamps of the file's rows [s]
  double start_s = 0;               ///< first grid stamp [s]
  double sample_period_s = 0;       ///< grid period [s]
  Channel input;                    ///< n_grid values
  Channel output;                   ///< n_grid values
  std::vector<Channel> side;        ///< named side inputs, n_grid values each
  std::vector<std::uint8_t> valid;  ///< n_grid flags; empty means all valid
  std::vector<InputJump> jumps;     ///< of a resampled recording's input, in their order
  InputNoise input_noise;           ///< where the input is smooth from row to row only; else empty

  std::vector<QualityItem> quality;
  std::vector<Segment> segments;

  std::size_t samples() const { return input.values.size(); }
  double sample_rate_hz() const { return 1.0 / sample_period_s; }
  bool is_valid(std::size_t i) const { return valid.empty() || valid[i] != 0; }
  std::size_t valid_samples() const;  ///< those that take part in sums
  /// Currents in A and pressures in psi: the valve's own units. Otherwise figures carry unit "".
  bool has_valve_units() const { return input.unit == "A" && output.unit == "psi"; }
};

/// How a caller maps columns that do not carry the contract's names.
struct ColumnMapping {
  std::string time, input, output;         ///< column names; empty: `time_*`, `current_*`, `pressure_*`
  std::vector<std::string> side;           ///< side inputs by column name
  std::optional<double> sample_rate_hz{};  ///< where there is no time column [Hz]
  bool output_optional = false;            ///< an input alone will do (`simulate`): the output channel may be empty
};

/// What the parsers hand over: columns as they stood, converted, nothing resampled or judged yet.
struct RawRecording {
  std::string name;
  Metadata metadata;
  Channel time, input, output;  ///< time.values empty where `sample_rate_hz` of the mapping rules
  std::vector<Channel> side;
};

}  // namespace valvetriage
