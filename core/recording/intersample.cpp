#include "core/recording/intersample.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/recording/white_noise.h"

namespace valvetriage {
namespace {

// A straight line through a gap is trusted where the slopes on both sides bend it by less than this part of the range.
constexpr double kBend = 0.002;
constexpr std::size_t kBeside = 5;

/// How far a cubic through the samples beside [first, last) lies from the straight line, at its middle.
double bend_across(const std::vector<double>& u, std::size_t first, std::size_t last) {
  if (first < kBeside || last + kBeside > u.size()) return 0;
  const auto slope = [&](std::size_t from) {
    return (u[from + kBeside - 1] - u[from]) / static_cast<double>(kBeside - 1);
  };
  return static_cast<double>(last - first + 1) / 8 * std::abs(slope(last) - slope(first - kBeside));
}

/// Samples that begin a new stretch: no window reaches across them.
std::vector<std::size_t> stretches(const Recording& recording) {
  std::vector<std::size_t> begins{0, recording.samples()};
  for (const Segment& segment : recording.segments) {
    if (segment.begins_with_jump()) begins.push_back(segment.begin);
  }
  for (const InputJump& jump : recording.jumps) begins.push_back(jump.interval + 1);
  std::sort(begins.begin(), begins.end());
  begins.erase(std::unique(begins.begin(), begins.end()), begins.end());
  return begins;
}

/// Samples of a segment at which the input has just moved and moves on: a quick change between held levels does not.
std::size_t moving_on(const Recording& recording, const Segment& segment) {
  const auto& u = recording.input.values;
  std::size_t moving = 0;
  for (std::size_t t = std::max<std::size_t>(segment.begin, 1); t + 1 < std::min(segment.end, u.size()); ++t) {
    moving += u[t] != u[t - 1] && u[t + 1] != u[t] ? 1 : 0;
  }
  return moving;
}

IntervalSignal between_samples(const Recording& recording, const std::vector<double>& u, InputBetween between) {
  IntervalSignal signal{.start = u, .end = u};
  for (std::size_t i = 0; between == InputBetween::kStraight && i + 1 < u.size(); ++i) signal.end[i] = u[i + 1];
  for (const Segment& segment : recording.segments) {
    if (segment.begins_with_jump() && segment.begin > 0) {
      signal.end[segment.begin - 1] = signal.start[segment.begin - 1];
    }
  }
  // A jump between two samples of the grid: held at the value that gives the interval its mean.
  for (const InputJump& jump : recording.jumps) {
    const double before = u[jump.interval], after = u[jump.interval + 1];
    signal.start[jump.interval] = signal.end[jump.interval] = before + (1 - jump.fraction) * (after - before);
  }
  return signal;
}

}  // namespace

bool holds_and_moves(std::span<const Recording> recordings) {
  std::size_t steps = 0, moving = 0;
  for (const Recording& recording : recordings) {
    for (const Segment& segment : recording.segments) {
      if (segment.kind == SegmentKind::kStep) ++steps;
      if (segment.kind == SegmentKind::kRamp || segment.kind == SegmentKind::kSweep) {
        moving += moving_on(recording, segment);
      }
    }
  }
  return steps > 0 && moving > 0;
}

IntervalSignal input_between_samples(const Recording& recording, InputBetween between) {
  return between_samples(recording, recording.input.values, between);
}

IntervalSignal halved(const IntervalSignal& signal) {
  const std::size_t n = signal.start.size();
  IntervalSignal halves{.start = std::vector<double>(2 * n),
                        .end = std::vector<double>(2 * n),
                        .noise = signal.noise ? *signal.noise : white_noise(signal.start)};
  for (std::size_t i = 0; i < n; ++i) {
    const double middle = signal.start[i] + 0.5 * (signal.end[i] - signal.start[i]);
    halves.start[2 * i] = signal.start[i];
    halves.end[2 * i] = halves.start[2 * i + 1] = middle;
    halves.end[2 * i + 1] = signal.end[i];
  }
  return halves;
}

std::vector<bool> held_intervals(const IntervalSignal& signal) {
  std::vector<bool> held(signal.start.size());
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = signal.start[i] == signal.end[i];
  return held;
}

IntervalSignal held_or_straight(std::vector<double> samples, const std::vector<bool>& held) {
  IntervalSignal signal{.start = std::move(samples), .end = {}};
  signal.end = signal.start;
  for (std::size_t i = 0; i + 1 < signal.start.size(); ++i) {
    if (!held[i]) signal.end[i] = signal.start[i + 1];
  }
  return signal;
}

std::vector<double> at_samples(const std::vector<double>& halves) {
  std::vector<double> samples(halves.size() / 2);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = halves[2 * i];
  return samples;
}

IntervalSignal noise_free_input(const Recording& recording, InputBetween between) {
  const std::vector<double>& noise = recording.input_noise.values;
  if (noise.empty()) {
    return between_samples(recording, without_white_noise(recording.input.values, stretches(recording)), between);
  }
  std::vector<double> u = recording.input.values;
  for (std::size_t i = 0; i < u.size(); ++i) u[i] -= noise[i];
  IntervalSignal signal = between_samples(recording, u, between);
  signal.noise = recording.input_noise.left;
  return signal;
}

std::size_t leave_out_lost_input(Recording& recording, double settling_s) {
  const std::vector<double>& u = recording.input.values;
  if (recording.valid.empty() || u.empty()) return 0;
  const auto [low, high] = std::minmax_element(u.begin(), u.end());
  const auto settling = static_cast<std::size_t>(std::ceil(settling_s / recording.sample_period_s));
  std::vector<std::size_t> until(u.size(), 0);  // of a gap that starts here
  for (std::size_t first = 0, last = 0; first < u.size(); first = last + 1) {
    while (first < u.size() && recording.valid[first] != 0) ++first;
    for (last = first; last < u.size() && recording.valid[last] == 0;) ++last;
    if (last < u.size() && bend_across(u, first, last) > kBend * (*high - *low)) until[first] = last + settling;
  }
  for (const InputJump& jump : recording.jumps) {
    if (jump.in_gap) until[jump.interval] = jump.interval + settling;
  }
  std::size_t left_out = 0;
  for (std::size_t i = 0, end = 0; i < u.size(); ++i) {
    end = std::max(end, until[i]);
    if (i >= end) continue;
    left_out += recording.valid[i];
    recording.valid[i] = 0;
  }
  return left_out;
}

}  // namespace valvetriage
