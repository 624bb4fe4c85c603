#include "core/recording/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/recording/columns.h"
#include "core/recording/limits.h"
#include "core/recording/quality.h"
#include "core/recording/segments.h"
#include "core/recording/time_base.h"

namespace valvetriage {
namespace {

constexpr double kConstantOfMagnitude = 0.01;  ///< noise about a constant current is far below this part of it
constexpr double kWhiteRatio = 0.8;            ///< of the input's spread that is white noise: nothing else moves it

tl::unexpected<Error> channel_error(std::string code, const Channel& channel, std::string found, std::string expected) {
  Error error{.code = std::move(code)};
  error.field = channel.name;
  error.message = fmt::format("{}: {}, expected {}", channel.name, found, expected);
  error.found = std::move(found);
  error.expected = std::move(expected);
  return tl::unexpected(error);
}

Result<void> check_channel(const Channel& channel, std::size_t samples) {
  if (channel.values.size() != samples) {
    return channel_error("ragged_columns", channel, fmt::format("{} values", channel.values.size()),
                         fmt::format("{}, as many as the input has", samples));
  }
  const auto is_in_range = [](double value) { return std::abs(value) <= kMostMagnitude; };
  const auto bad = std::ranges::find_if_not(channel.values, is_in_range);
  if (bad == channel.values.end()) return {};
  const std::string found = fmt::format("{} at sample {}", *bad, bad - channel.values.begin() + 1);
  if (!std::isfinite(*bad)) return channel_error("not_finite", channel, found, "finite numbers");
  return channel_error("out_of_range", channel, found, fmt::format("at most {:g}", kMostMagnitude));
}

Result<void> check_samples(const RawRecording& raw, bool output_optional) {
  const std::size_t samples = raw.input.values.size();
  if (samples == 0) return fail("no_samples", "no samples");
  if (samples < kMinSamples) {
    return fail("too_few_samples", fmt::format("{} samples, at least {} are needed", samples, kMinSamples));
  }
  if (samples > kMaxRows) return fail("too_large", fmt::format("{} samples, at most {} are taken", samples, kMaxRows));
  std::vector<const Channel*> channels{&raw.input};
  if (!output_optional || !raw.output.values.empty()) channels.push_back(&raw.output);
  if (!raw.time.values.empty()) channels.push_back(&raw.time);
  for (const Channel& side : raw.side) channels.push_back(&side);
  for (const Channel* channel : channels) {
    if (auto checked = check_channel(*channel, samples); !checked) return checked;
  }
  return {};
}

/// A constant, or nothing but small white noise about one: neither excites anything.
bool is_constant(const std::vector<double>& input) {
  const auto [low, high] = std::ranges::minmax(input);
  if (low == high) return true;
  if (high - low > kConstantOfMagnitude * std::max(std::abs(low), std::abs(high))) return false;
  double mean = 0;
  for (const double value : input) mean += value / static_cast<double>(input.size());
  double variance = 0;
  for (const double value : input) variance += (value - mean) * (value - mean) / static_cast<double>(input.size());
  return noise_of(input) > kWhiteRatio * std::sqrt(variance);
}

Result<void> take_test(Recording& recording) {
  if (!recording.metadata.test) {
    recording.test = infer_test(recording.segments);
    recording.test_inferred = true;
    return {};
  }
  const auto kind = test_kind_from(*recording.metadata.test);
  if (!kind) {
    return fail("bad_metadata",
                fmt::format("metadata test: found '{}', expected step, staircase, triangle, sweep or other",
                            *recording.metadata.test));
  }
  recording.test = *kind;
  return {};
}

Result<Recording> prepare(RawRecording raw, const ColumnMapping& mapping) {
  if (auto checked = check_samples(raw, mapping.output_optional); !checked) return tl::unexpected(checked.error());
  if (raw.time.values.empty()) {
    if (!mapping.sample_rate_hz) return fail("missing_column", "neither a time column nor a sampling rate");
    if (auto checked = check_sample_rate(*mapping.sample_rate_hz); !checked) return tl::unexpected(checked.error());
  }
  if (is_constant(raw.input.values)) {
    return channel_error("constant_input", raw.input, fmt::format("a constant {:.6g}", raw.input.values.front()),
                         "an input that changes");
  }
  auto recording = to_uniform_time(std::move(raw), mapping.sample_rate_hz);
  if (!recording) return recording;
  recording->segments = find_segments(recording->input.values, recording->sample_period_s);
  if (!recording->output.values.empty()) judge_quality(*recording);
  if (auto test = take_test(*recording); !test) return tl::unexpected(test.error());
  return recording;
}

}  // namespace

Result<Recording> prepare_recording(RawRecording raw, const ColumnMapping& mapping) {
  const std::string name = raw.name;
  auto recording = prepare(std::move(raw), mapping);
  if (recording) return recording;
  Error error = recording.error();
  error.file = name;
  return tl::unexpected(std::move(error));
}

}  // namespace valvetriage
