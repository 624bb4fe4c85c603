#include "core/analysis/part_to_fit.h"

#include <algorithm>
#include <cmath>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/segments.h"

namespace valvetriage {
namespace {

// A valve's modes and what a reference tells of them end below 100 Hz.
constexpr double kLongestPeriod_s = 0.005;

/// Whole samples in a period; 1 at least.
std::size_t samples_in(double period_s, const Recording& recording) {
  return static_cast<std::size_t>(std::max(1.0, std::floor(period_s / recording.sample_period_s + 1e-6)));
}

double samples_left(std::span<const Recording> recordings, const std::vector<std::size_t>& stride) {
  double samples = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    samples += static_cast<double>(recordings[r].samples()) / static_cast<double>(stride[r]);
  }
  return samples;
}

/// Every how many samples of each recording one is kept.
std::vector<std::size_t> strides(std::span<const Recording> recordings, double period_s, std::size_t most) {
  std::vector<std::size_t> stride;
  for (const Recording& recording : recordings) stride.push_back(samples_in(period_s, recording));
  const double too_many = samples_left(recordings, stride) / static_cast<double>(most);
  if (too_many <= 1) return stride;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const auto wanted = static_cast<std::size_t>(std::ceil(static_cast<double>(stride[r]) * too_many));
    stride[r] = std::max(stride[r], std::min(wanted, samples_in(kLongestPeriod_s, recordings[r])));
  }
  return stride;
}

/// Samples that a recording may have where all of them together may have `most`: what short ones do not need is left
/// for long ones.
std::size_t longest_of(std::span<const Recording> recordings, const std::vector<std::size_t>& stride,
                       std::size_t most) {
  std::vector<std::size_t> samples;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    samples.push_back((recordings[r].samples() + stride[r] - 1) / stride[r]);
  }
  std::ranges::sort(samples);
  std::size_t left = most;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const std::size_t share = left / (samples.size() - i);
    if (samples[i] > share) return share;
    left -= samples[i];
  }
  return samples.empty() ? 0 : samples.back();
}

std::vector<double> every(const std::vector<double>& values, std::size_t stride, std::size_t covered) {
  std::vector<double> kept;
  kept.reserve((covered + stride - 1) / stride);
  for (std::size_t i = 0; i < std::min(covered, values.size()); i += stride) kept.push_back(values[i]);
  return kept;
}

Channel every(const Channel& channel, std::size_t stride, std::size_t covered) {
  return {.name = channel.name,
          .quantity = channel.quantity,
          .unit = channel.unit,
          .file_unit = channel.file_unit,
          .file_unit_scale = channel.file_unit_scale,
          .values = every(channel.values, stride, covered)};
}

/// Where the input jumps, from one kept sample to the next: the steps at a sample, and those between two already.
std::vector<InputJump> jumps_of(const Recording& recording, std::size_t stride, std::size_t kept) {
  std::vector<InputJump> jumps = recording.jumps;
  for (const Segment& segment : recording.segments) {
    if (!segment.begins_with_jump() || segment.begin == 0) continue;
    const std::size_t interval = segment.begin - 1;
    const bool is_known = std::ranges::any_of(jumps, [&](const InputJump& jump) { return jump.interval == interval; });
    if (!is_known) jumps.push_back({.interval = interval, .fraction = 1});
  }
  std::ranges::sort(jumps, {}, &InputJump::interval);
  std::vector<InputJump> thinned;
  for (const InputJump& jump : jumps) {
    const std::size_t interval = jump.interval / stride;
    if (interval + 1 >= kept) break;
    const double before = static_cast<double>(jump.interval % stride) + jump.fraction;
    if (!thinned.empty() && thinned.back().interval == interval) thinned.pop_back();
    thinned.push_back({.interval = interval, .fraction = before / static_cast<double>(stride), .in_gap = jump.in_gap});
  }
  return thinned;
}

Recording reduced(const Recording& recording, std::size_t stride, std::size_t covered) {
  Recording part{.name = recording.name,
                 .metadata = recording.metadata,
                 .test = recording.test,
                 .test_inferred = recording.test_inferred,
                 .start_s = recording.start_s,
                 .sample_period_s = recording.sample_period_s * static_cast<double>(stride),
                 .input = every(recording.input, stride, covered),
                 .output = every(recording.output, stride, covered),
                 .input_noise = {.values = every(recording.input_noise.values, stride, covered),
                                 .left = recording.input_noise.left},
                 .quality = recording.quality};
  for (const Channel& side : recording.side) part.side.push_back(every(side, stride, covered));
  for (std::size_t i = 0; i < part.samples(); ++i) {
    part.time_s.push_back(part.start_s + static_cast<double>(i) * part.sample_period_s);
  }
  if (!recording.valid.empty()) {
    for (std::size_t i = 0; i < covered; i += stride) part.valid.push_back(recording.valid[i]);
  }
  part.jumps = jumps_of(recording, stride, part.samples());
  part.segments = find_segments(part.input.values, part.sample_period_s);
  return part;
}

std::vector<double> spread(const std::vector<double>& kept, std::size_t stride, std::size_t covered) {
  std::vector<double> all(covered);
  for (std::size_t i = 0; i < covered; ++i) {
    const std::size_t at = i / stride, next = std::min(at + 1, kept.size() - 1);
    const double share = static_cast<double>(i % stride) / static_cast<double>(stride);
    all[i] = kept[at] + share * (kept[next] - kept[at]);
  }
  return all;
}

/// A law on a side channel knows it by its place: the same channels in the same places, empty where a recording has
/// none of that name.
void line_up_side_channels(std::vector<Recording>& recordings) {
  std::vector<std::string> names;
  for (const Recording& recording : recordings) {
    for (const Channel& channel : recording.side) {
      if (std::find(names.begin(), names.end(), channel.name) == names.end()) names.push_back(channel.name);
    }
  }
  for (Recording& recording : recordings) {
    std::vector<Channel> side;
    for (const std::string& name : names) {
      const auto own = std::find_if(recording.side.begin(), recording.side.end(),
                                    [&](const Channel& channel) { return channel.name == name; });
      side.push_back(own == recording.side.end() ? Channel{.name = name} : std::move(*own));
    }
    recording.side = std::move(side);
  }
}

}  // namespace

PartToFit part_to_fit(std::span<const Recording> recordings, double period_s, std::size_t most) {
  PartToFit part{.recordings = {}, .stride = strides(recordings, period_s, most), .covered = {}};
  const std::size_t longest = longest_of(recordings, part.stride, most);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Recording& recording = recordings[r];
    part.covered.push_back(std::min(recording.samples(), longest * part.stride[r]));
    const bool is_whole = part.stride[r] == 1 && part.covered[r] == recording.samples();
    part.recordings.push_back(is_whole ? recording : reduced(recording, part.stride[r], part.covered[r]));
    part.is_whole = part.is_whole && is_whole;
  }
  line_up_side_channels(part.recordings);
  return part;
}

Result<std::vector<std::vector<double>>> on_all_samples(const PartToFit& part, std::vector<std::vector<double>> runs,
                                                        const Model& model, std::span<const Recording> recordings) {
  if (part.is_whole) return runs;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    runs[r] = spread(runs[r], part.stride[r], part.covered[r]);
    if (runs[r].size() == recordings[r].samples()) continue;
    const auto whole = simulate_extended(model, recordings[r], InitialState{});
    if (!whole) return tl::unexpected(whole.error());
    runs[r].insert(runs[r].end(), whole->begin() + static_cast<std::ptrdiff_t>(runs[r].size()), whole->end());
  }
  return runs;
}

}  // namespace valvetriage
