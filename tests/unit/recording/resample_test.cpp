#include "core/recording/resample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/recording/intersample.h"
#include "core/recording/prepare.h"
#include "tests/unit/recording/signals.h"

namespace valvetriage {
namespace {

constexpr double kPeriod_s = 0.005;
constexpr double kReading_a = 0.0005;

/// Stamps that jitter by up to a quarter of a period.
Signal jittering_stamps(std::size_t samples, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> jitter(-0.0012, 0.0012);
  Signal stamps(samples);
  for (std::size_t i = 0; i < samples; ++i) stamps[i] = kPeriod_s * static_cast<double>(i) + jitter(random);
  return stamps;
}

double sine(double t_s) {
  return 1.6 + 0.1 * std::sin(2 * std::numbers::pi * 4 * t_s);
}

/// A command whose row k is the sine at the clock's tick, written and read at a stamp beside it.
Recording of_rows(double noise_a, unsigned seed) {
  constexpr std::size_t kRows = 4000;
  Signal u(kRows);
  for (std::size_t i = 0; i < kRows; ++i) u[i] = sine(kPeriod_s * static_cast<double>(i));
  if (noise_a > 0) add_noise(u, noise_a, seed + 1);
  RawRecording raw = raw_of(u, u);
  raw.time.values = jittering_stamps(kRows, seed);
  return prepared(std::move(raw));
}

/// What goes straight between values at these stamps.
double straight(const Signal& time, const Signal& values, double t) {
  const auto right = std::clamp<std::ptrdiff_t>(std::lower_bound(time.begin(), time.end(), t) - time.begin(), 1,
                                                static_cast<std::ptrdiff_t>(time.size()) - 1);
  const auto i = static_cast<std::size_t>(right);
  const double weight = std::clamp((t - time[i - 1]) / (time[i] - time[i - 1]), 0.0, 1.0);
  return values[i - 1] + weight * (values[i] - values[i - 1]);
}

Signal grid_of(const Recording& recording) {
  Signal grid;
  for (std::size_t k = 0; k < recording.samples(); ++k) {
    grid.push_back(recording.start_s + static_cast<double>(k) * recording.sample_period_s);
  }
  return grid;
}

/// rms of the means over 80 ms of the difference that two paths make behind a lag of 60 ms.
template <typename One, typename Other>
double slow_rms_behind_lag(double from_s, double to_s, const One& one, const Other& other) {
  constexpr double kStep_s = 1e-4, kLag_s = 0.06;
  constexpr int kBlock = 800;
  double state = 0, sum = 0, squares = 0;
  int count = 0, blocks = 0;
  for (double t = from_s; t < to_s; t += kStep_s) {
    state += kStep_s / kLag_s * (one(t) - other(t) - state);
    sum += state;
    if (++count % kBlock > 0) continue;
    squares += std::pow(sum / kBlock, 2);
    sum = 0;
    ++blocks;
  }
  return std::sqrt(squares / blocks);
}

TEST(Resample, AMeasuredCurveKeepsItsShape) {
  const Signal u = swept_sine_of(4000);
  Signal y;
  RawRecording raw = raw_of(u, u);
  raw.time.values = jittering_stamps(u.size(), 3);
  for (const double stamp : raw.time.values) y.push_back(sine(stamp));
  raw.output.values = y;
  const Signal stamps = raw.time.values;
  const Recording recording = prepared(std::move(raw));
  double most = 0, most_straight = 0;
  const Signal grid = grid_of(recording);
  for (std::size_t k = 5; k + 5 < grid.size(); ++k) {
    most = std::max(most, std::abs(recording.output.values[k] - sine(grid[k])));
    most_straight = std::max(most_straight, std::abs(straight(stamps, y, grid[k]) - sine(grid[k])));
  }
  EXPECT_LT(most, 0.1 * most_straight);
}

TEST(Resample, TheInputDoesToALagWhatItDidBetweenItsRows) {
  const Recording recording = of_rows(0, 5);
  const Signal grid = grid_of(recording), stamps = recording.time_s;
  Signal rows(stamps.size()), cut;
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = sine(kPeriod_s * static_cast<double>(i));
  for (const double t : grid) cut.push_back(straight(stamps, rows, t));
  const auto commanded = [&](double t) { return straight(stamps, rows, t); };
  const auto lines_of = [&](const Signal& knots) { return [&](double t) { return straight(grid, knots, t); }; };
  const double from = stamps[10], to = stamps[3000];
  EXPECT_LT(slow_rms_behind_lag(from, to, lines_of(recording.input.values), commanded),
            0.1 * slow_rms_behind_lag(from, to, lines_of(cut), commanded));
}

TEST(Resample, ACommandWrittenByAJitteringClockKeepsItsRoughnessInTime) {
  const Recording noisy = of_rows(kReading_a, 7), clean = of_rows(0, 7);
  const Signal left = noise_free_input(noisy).start, grid = grid_of(clean);
  double squares = 0, roughness = 0;
  for (std::size_t k = 100; k + 100 < left.size(); ++k) {
    squares += std::pow(left[k] - clean.input.values[k], 2);
    roughness += std::pow(clean.input.values[k] - sine(grid[k]), 2);
  }
  EXPECT_LT(squares, static_cast<double>(left.size() - 200) * std::pow(kReading_a, 2));
  EXPECT_GT(roughness, 5 * squares);
}

TEST(Resample, AMeasuredInputThatIsSmoothInTimeIsNotTakenForACommandOfRows) {
  Signal u;
  const Signal stamps = jittering_stamps(4000, 9);
  for (const double stamp : stamps) u.push_back(sine(stamp));
  add_noise(u, kReading_a, 10);
  RawRecording raw = raw_of(u, u);
  raw.time.values = stamps;
  EXPECT_TRUE(prepared(std::move(raw)).input_noise.values.empty());
}

TEST(Resample, AReadingThatIsClippedOrStandsStillIsSoOnTheGrid) {
  const Signal u = swept_sine_of(4000);
  Signal y = response_of(u);
  add_noise(y, 0.35, 13);
  for (double& value : y) value = std::min(value, 130.0);
  for (std::size_t i = 1000; i < 1400; ++i) y[i] = 111.1;
  RawRecording raw = raw_of(u, y);
  raw.time.values = jittering_stamps(u.size(), 13);
  const Recording recording = prepared(std::move(raw));
  EXPECT_NE(find_quality(recording, "clipped"), nullptr);
  EXPECT_NE(find_quality(recording, "stuck"), nullptr);
  EXPECT_EQ(*std::max_element(recording.output.values.begin(), recording.output.values.end()), 130.0);
}

void lose_rows(RawRecording& raw, std::size_t first, std::size_t last) {
  for (Signal* column : {&raw.time.values, &raw.input.values, &raw.output.values}) {
    column->erase(column->begin() + static_cast<std::ptrdiff_t>(first),
                  column->begin() + static_cast<std::ptrdiff_t>(last));
  }
}

TEST(Resample, RowsBesideGapsOfAUniformClockStayAsTheyAre) {
  RawRecording raw = recorded(swept_sine_of(4000), 11);
  const Signal whole = raw.input.values;
  lose_rows(raw, 2000, 2003);
  const Recording recording = prepared(std::move(raw));
  for (std::size_t i = 0; i < whole.size(); ++i) {
    if (!recording.is_valid(i)) continue;
    ASSERT_NEAR(recording.input.values[i], whole[i], 1e-12) << i;
  }
}

/// A command that steps at 200 and a reading that falls by a tenth of its range from sample to sample from then on.
RawRecording steep_fall(double period_s) {
  Signal u(400, 2.0), y(400, 209.0);
  for (std::size_t i = 200; i < u.size(); ++i) {
    u[i] = 1;
    y[i] = 209 * std::exp(-0.1 * static_cast<double>(i - 200));
  }
  add_noise(y, 0.3, 5);
  RawRecording raw = raw_of(u, y);
  for (std::size_t i = 0; i < u.size(); ++i) raw.time.values[i] = 0.3 + period_s * static_cast<double>(i);
  return raw;
}

TEST(Resample, WhatIsReadBehindLostRowsOfASteepFallIsThatRow) {
  for (const double period_s : {0.005, 0.002, 0.001, 1.0 / 300, 1.0 / 4096}) {
    const RawRecording whole = steep_fall(period_s);
    RawRecording raw = whole;
    lose_rows(raw, 215, 218);
    lose_rows(raw, 203, 208);
    const Recording recording = prepared(std::move(raw));
    ASSERT_EQ(recording.samples(), 400u) << period_s;
    for (std::size_t i = 0; i < 400; ++i) {
      EXPECT_EQ(recording.is_valid(i), !(i >= 203 && i < 208) && !(i >= 215 && i < 218)) << period_s << ", " << i;
      if (!recording.is_valid(i)) continue;
      ASSERT_EQ(recording.output.values[i], whole.output.values[i]) << period_s << ", " << i;
      ASSERT_EQ(recording.input.values[i], whole.input.values[i]) << period_s << ", " << i;
    }
    const auto stepped = std::ranges::find(recording.segments, SegmentKind::kStep, &Segment::kind);
    ASSERT_NE(stepped, recording.segments.end()) << period_s;
    EXPECT_EQ(stepped->begin, 200u) << period_s;
  }
}

TEST(Resample, OfAJitteringClockNoSampleInsideAGapIsKnown) {
  constexpr std::size_t kRows = 400;
  for (const unsigned seed : {1u, 2u, 3u}) {
    RawRecording raw = steep_fall(kPeriod_s);
    raw.time.values = jittering_stamps(kRows, seed);
    const double before_s = raw.time.values[202], behind_s = raw.time.values[208];
    lose_rows(raw, 203, 208);
    const Recording recording = prepared(std::move(raw));
    const Signal grid = grid_of(recording);
    for (std::size_t k = 0; k < recording.samples(); ++k) {
      const double inside = 0.05 * recording.sample_period_s;
      const bool is_inside = grid[k] > before_s + inside && grid[k] < behind_s - inside;
      const bool is_outside = grid[k] < before_s || grid[k] > behind_s;
      EXPECT_FALSE(is_inside && recording.is_valid(k)) << seed << ", " << k;
      EXPECT_FALSE(is_outside && !recording.is_valid(k)) << seed << ", " << k;
    }
  }
}

}  // namespace
}  // namespace valvetriage
