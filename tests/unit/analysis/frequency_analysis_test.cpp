#include "core/analysis/frequency_analysis.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/identify/responses.h"

namespace valvetriage {
namespace {

using test::plant_s;
using test::recording_of;
using test::swept_sine;

double feature(const FrequencyResult& result, const std::string& name) {
  const auto found = std::find_if(result.features.begin(), result.features.end(),
                                  [&](const ResponseFeature& f) { return f.name == name; });
  return found == result.features.end() ? std::nan("") : found->value;
}

Recording sweep_of(const TransferFunction& g, double amplitude, std::uint32_t seed) {
  return recording_of(g, swept_sine(4000, 200, 0.2, 20, amplitude), 200, 0.35, seed);
}

/// Steps about 1.6 A, each held two seconds.
Recording steps_of(const TransferFunction& g, double noise_sd) {
  std::vector<double> u;
  for (const double level : {1.55, 1.65, 1.6, 1.7, 1.55}) u.insert(u.end(), 400, level);
  Recording recording;
  recording.sample_period_s = 1.0 / 200;
  recording.segments = find_segments(u, recording.sample_period_s);
  recording.input.values = std::move(u);
  recording.output.values.assign(recording.samples(), 0.0);
  Model model{.kind = "linear", .dynamics = g};
  model.input_offset = 1.6;
  model.output_offset = 100;
  recording.output.values = simulate(model, recording, InitialState{}).value();
  test::Normal normal(9);
  for (double& y : recording.output.values) y += noise_sd * normal();
  return recording;
}

TEST(FrequencyAnalysis, FindsTheFeaturesOfALag) {
  const std::vector<Recording> one{sweep_of(plant_s(470, {2.4}, {}, {}, 0.005), 0.1, 1)};
  const auto results = analyze_frequency(one);
  ASSERT_EQ(results.size(), 1u);
  const FrequencyResult& result = results[0];
  ASSERT_TRUE(result.model) << result.refused;
  // A lag of 2.4 Hz seen from 0.2 Hz on: −3 dB relative to there a little later than its corner.
  EXPECT_NEAR(feature(result, "bandwidth_hz"), 2.4, 0.1);
  EXPECT_NEAR(feature(result, "corner_hz"), 2.4, 0.2);
  EXPECT_NEAR(feature(result, "rolloff_db_per_decade"), -20, 2);
  EXPECT_NEAR(feature(result, "delay_s"), 0.005, 0.001);
  EXPECT_LT(feature(result, "resonance_peak_db"), 0.2);
  EXPECT_GT(*result.fit_percent, 95);
}

TEST(FrequencyAnalysis, FindsTheResonanceOfALightlyDampedMode) {
  const std::vector<Recording> one{sweep_of(plant_s(470, {}, {{5, 0.2}}), 0.1, 1)};
  const auto results = analyze_frequency(one);
  ASSERT_EQ(results.size(), 1u);
  // 1 / (2 ζ √(1 − ζ²)) = 2.55, 8.1 dB, at 5 √(1 − 2 ζ²) Hz.
  EXPECT_NEAR(feature(results[0], "resonance_peak_db"), 8.14, 0.3);
  EXPECT_NEAR(feature(results[0], "resonance_hz"), 4.80, 0.1);
  EXPECT_TRUE(std::isnan(feature(results[0], "corner_hz")));
}

TEST(FrequencyAnalysis, ASlowerSecondLagNeverMovesACornerUp) {
  double last_corner = 100, last_bandwidth = 100;
  for (const double second_hz : {30.0, 12.0, 7.0, 5.0, 4.0, 3.0, 2.5}) {
    const std::vector<Recording> one{sweep_of(plant_s(470, {2.4, second_hz}, {}), 0.1, 1)};
    const auto results = analyze_frequency(one);
    ASSERT_EQ(results.size(), 1u);
    EXPECT_LT(feature(results[0], "corner_hz"), last_corner) << second_hz;
    EXPECT_LT(feature(results[0], "bandwidth_hz"), last_bandwidth) << second_hz;
    last_corner = feature(results[0], "corner_hz");
    last_bandwidth = feature(results[0], "bandwidth_hz");
  }
}

TEST(FrequencyAnalysis, GivesTheBandwidthOfTheSmallestSweepThatCoversALevel) {
  const auto slow = plant_s(470, {1.5}, {}), fast = plant_s(470, {3}, {});
  const std::vector<Recording> session{sweep_of(slow, 0.3, 1), sweep_of(fast, 0.1, 2)};
  const auto results = analyze_frequency(session);
  const double mean = session[0].input.values.front();
  EXPECT_NEAR(*bandwidth_at(results, mean + 0.05), 3, 0.2);
  EXPECT_NEAR(*bandwidth_at(results, mean + 0.2), 1.5, 0.1);
  EXPECT_FALSE(bandwidth_at(results, mean + 0.4));
}

TEST(FrequencyAnalysis, AveragesRepeatsAndKeepsAmplitudesApart) {
  const auto g = plant_s(470, {2.4}, {});
  const std::vector<Recording> session{sweep_of(g, 0.3, 1), sweep_of(g, 0.1, 2), sweep_of(g, 0.1, 3)};
  const auto results = analyze_frequency(session);
  ASSERT_EQ(results.size(), 2u);
  EXPECT_EQ(results[0].recordings, (std::vector<std::size_t>{1, 2}));
  EXPECT_EQ(results[0].response.repeats, 2);
  EXPECT_EQ(results[1].recordings, (std::vector<std::size_t>{0}));
  ASSERT_TRUE(results[1].amplitude_dependence);
  EXPECT_GT(results[1].amplitude_dependence->p_value, 0.001);
}

TEST(FrequencyAnalysis, OfALinearValveAgreesWithItsStepsToTheNoise) {
  const auto g = plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004);
  const std::vector<Recording> session{sweep_of(g, 0.1, 1), steps_of(g, 0.35)};
  const auto results = analyze_frequency(session);
  ASSERT_EQ(results.size(), 1u);
  const auto apart = cross_domain_rmse(session, results);
  ASSERT_TRUE(apart);
  EXPECT_LT(*apart, 0.6);  // 0.35 psi of noise; steps of up to 70 psi

  const std::vector<Recording> slower{session[0], steps_of(plant_s(470, {1.2}, {{25, 0.75}}, {}, 0.004), 0.35)};
  EXPECT_GT(*cross_domain_rmse(slower, results), 2);
}

TEST(FrequencyAnalysis, SaysWhyThereIsNoResponse) {
  auto short_one = sweep_of(plant_s(470, {2.4}, {}), 0.1, 1);
  short_one.input.values.resize(40);
  short_one.output.values.resize(40);
  short_one.segments = {{SegmentKind::kSweep, 0, 40}};
  const std::vector<Recording> session{short_one};
  const auto results = analyze_frequency(session);
  ASSERT_EQ(results.size(), 1u);
  EXPECT_FALSE(results[0].refused.empty());
  EXPECT_FALSE(cross_domain_rmse(session, results));
}

}  // namespace
}  // namespace valvetriage
