#include "core/residual/findings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "core/recording/segments.h"

namespace valvetriage {
namespace {

constexpr double kPeriod_s = 0.005;
constexpr double kNoise_psi = 0.35;

/// A session of three tests with what a simulation leaves of them.
struct Session {
  std::vector<Recording> recordings;
  std::vector<std::vector<double>> residuals;

  std::vector<Finding> findings(double significance = 0.01) const {
    std::vector<ResidualView> views;
    for (std::size_t r = 0; r < recordings.size(); ++r) views.push_back({&recordings[r], residuals[r], kNoise_psi});
    return find_dependences(views, {.significance = significance});
  }
};

double steady_psi(double current_a) {
  return 210 * (current_a - 1) * (current_a - 1);
}

Recording recording_of(const std::string& name, std::size_t samples, const std::function<double(double)>& current_a) {
  Recording r;
  r.name = name;
  r.sample_period_s = kPeriod_s;
  r.input.unit = "A";
  r.output.unit = "psi";
  double pressure = steady_psi(current_a(0));
  Channel side{.name = "temperature_C", .quantity = "temperature", .unit = "", .file_unit = "", .values = {}};
  for (std::size_t i = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    r.input.values.push_back(current_a(t));
    pressure += 0.1 * (steady_psi(current_a(t)) - pressure);
    r.output.values.push_back(pressure);
    side.values.push_back(40 + std::sin(0.9 * t) + 0.4 * std::sin(2.3 * t));
  }
  r.side.push_back(side);
  r.segments = find_segments(r.input.values, kPeriod_s);
  return r;
}

/// Noise of the first order: e_t = a e_{t−1} + w_t with the same rms whatever a.
std::vector<double> noise(std::size_t samples, double a, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<double> e(samples);
  double state = normal(random);
  for (double& value : e) {
    value = kNoise_psi * state;
    state = a * state + std::sqrt(1 - a * a) * normal(random);
  }
  return e;
}

const std::vector<Recording>& played() {
  static const std::vector<Recording> recordings{
      recording_of("steps.csv", 3200,
                   [](double t) {
                     constexpr double kLevels_a[] = {1.2, 1.0, 1.4, 1.0, 1.6, 1.0, 1.8, 1.0};
                     return kLevels_a[std::min(static_cast<std::size_t>(t / 2), std::size_t{7})];
                   }),
      recording_of("triangle.csv", 2400, [](double t) { return 1 + std::abs(std::fmod(t, 6.0) / 3 - 1); }),
      recording_of("sweep.csv", 2400,
                   [](double t) { return 1.5 + 0.3 * std::sin(2 * std::numbers::pi * (0.3 + 0.2 * t) * t); })};
  return recordings;
}

/// The session with an effect on the measured outputs that the simulation does not know of.
Session session(const std::function<double(const Recording&, std::size_t)>& effect, double colour = 0,
                unsigned seed = 1) {
  std::mt19937 random(seed);
  Session s{.recordings = played(), .residuals = {}};
  for (Recording& recording : s.recordings) {
    std::vector<double> e = noise(recording.samples(), colour, random);
    for (std::size_t i = 0; i < e.size(); ++i) e[i] += effect(recording, i);
    for (std::size_t i = 0; i < e.size(); ++i) recording.output.values[i] += e[i];
    s.residuals.push_back(std::move(e));
  }
  return s;
}

const Finding* find(const std::vector<Finding>& findings, std::string_view what) {
  const auto found = std::find_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.what == what; });
  return found == findings.end() ? nullptr : &*found;
}

double time_s(std::size_t i) {
  return static_cast<double>(i) * kPeriod_s;
}

/// 200 healthy sessions at a promise of 5 %: 10 false alarms are expected at most, 20 are three deviations above that.
class FalseAlarms : public testing::TestWithParam<double> {};
TEST_P(FalseAlarms, AreAsRareAsPromised) {
  int alarms = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    const auto findings = session([](const Recording&, std::size_t) { return 0.0; }, GetParam(), seed).findings(0.05);
    alarms += findings.empty() ? 0 : 1;
  }
  RecordProperty("alarms", alarms);
  EXPECT_LE(alarms, 20);
}
INSTANTIATE_TEST_SUITE_P(Noise, FalseAlarms, testing::Values(0.0, 0.6, 0.9));

TEST(Findings, AShiftedLevelIsFoundAtItsLevel) {
  const auto findings =
      session([](const Recording& r, std::size_t i) { return r.input.values[i] > 1.55 ? 0.5 : 0; }).findings();
  const Finding* f = find(findings, "depends on the input's level");
  ASSERT_NE(f, nullptr);
  EXPECT_LT(f->p_value, 1e-6);
  EXPECT_GT(f->share_of_structured_residual, 0.7);
}

TEST(Findings, WhatDependsOnTheWayIsTheSignOfTheChange) {
  const auto findings = session([](const Recording& r, std::size_t i) {
                          const std::size_t before = i > 10 ? i - 10 : 0;
                          const double way = r.input.values[i] - r.input.values[before];
                          return way > 0 ? -0.4 : way < 0 ? 0.4 : 0;
                        }).findings();
  const Finding* f = find(findings, "depends on the sign of the input's change");
  ASSERT_NE(f, nullptr);
  EXPECT_EQ(f->where, "higher after a fall");
}

TEST(Findings, ALateOutputIsBehindByItsDelay) {
  const auto findings = session([](const Recording& r, std::size_t i) {
                          return i > 0 ? -0.6 * (r.output.values[i] - r.output.values[i - 1]) : 0;
                        }).findings();
  const Finding* f = find(findings, "depends on the rate of the output");
  ASSERT_NE(f, nullptr);
  EXPECT_NE(f->where.find("behind by"), std::string::npos) << f->where;
  EXPECT_GT(f->share_of_structured_residual, 0.3);
}

TEST(Findings, AToneIsALineAtItsFrequencyEvenUnderColouredNoise) {
  const auto findings =
      session([](const Recording&, std::size_t i) { return 0.3 * std::sin(2 * std::numbers::pi * 7.25 * time_s(i)); },
              0.8)
          .findings();
  const Finding* f = find(findings, "has a line");
  ASSERT_NE(f, nullptr);
  EXPECT_NEAR(std::stod(f->where), 7.25, 0.1);
}

TEST(Findings, ALineThatTheSimulationHasAsWellIsTheInputs) {
  const auto line_at = [](double frequency_hz) {
    std::mt19937 random(5);
    Session session;
    session.recordings.push_back(recording_of("tones", 4000, [](double t) {
      return 1.5 + 0.05 * std::sin(2 * std::numbers::pi * 7.25 * t) + 0.05 * std::sin(2 * std::numbers::pi * 9 * t);
    }));
    session.residuals.push_back(noise(4000, 0, random));
    for (std::size_t i = 0; i < 4000; ++i) {
      session.residuals[0][i] +=
          0.3 * std::sin(2 * std::numbers::pi * frequency_hz * static_cast<double>(i) * kPeriod_s);
    }
    for (std::size_t i = 0; i < 4000; ++i) session.recordings[0].output.values[i] += session.residuals[0][i];
    return find(session.findings(), "has a line") != nullptr;
  };
  EXPECT_TRUE(line_at(8));
  EXPECT_FALSE(line_at(7.25));
}

TEST(Findings, ADriftIsADependenceOnTime) {
  const auto findings = session([](const Recording&, std::size_t i) { return 0.08 * time_s(i); }, 0.6).findings();
  ASSERT_NE(find(findings, "depends on time"), nullptr);
}

TEST(Findings, ASideChannelIsNamed) {
  const auto findings =
      session([](const Recording& r, std::size_t i) { return 0.5 * (r.side[0].values[i] - 40); }).findings();
  const Finding* f = find(findings, "depends on a side channel");
  ASSERT_NE(f, nullptr);
  EXPECT_EQ(f->where.substr(0, 13), "temperature_C");
}

TEST(Findings, OneSpoiledRecordingIsPointedOut) {
  const auto findings = session([](const Recording& r, std::size_t i) {
                          return r.name == "triangle.csv" ? 1.5 * std::sin(3.0 * time_s(i)) : 0;
                        }).findings();
  const Finding* f = find(findings, "is larger in one recording");
  ASSERT_NE(f, nullptr);
  EXPECT_EQ(f->where.substr(0, 12), "triangle.csv");
}

TEST(Findings, NoiseThatGrowsWithTheLevelIsNoDependenceOfTheMean) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto findings = session([&](const Recording& r, std::size_t i) {
                          return r.input.values[i] > 1.5 ? 0.5 * normal(random) : 0;
                        }).findings();
  ASSERT_NE(find(findings, "its noise depends on the input's level"), nullptr);
  EXPECT_EQ(find(findings, "depends on the input's level"), nullptr);
}

TEST(Findings, ComeLargestShareFirstAndSignificant) {
  const auto findings = session([](const Recording& r, std::size_t i) {
                          return (r.input.values[i] > 1.55 ? 0.8 : 0) + 0.1 * std::sin(40 * time_s(i));
                        }).findings();
  ASSERT_GE(findings.size(), 2u);
  for (std::size_t i = 0; i < findings.size(); ++i) {
    EXPECT_LT(findings[i].p_value, 0.01);
    if (i == 0 || std::isnan(findings[i].share_of_structured_residual)) continue;
    EXPECT_GE(findings[i - 1].share_of_structured_residual, findings[i].share_of_structured_residual);
  }
}

TEST(Findings, NothingIsFoundInNothing) {
  EXPECT_TRUE(find_dependences({}).empty());
  Recording r = recording_of("short.csv", 5, [](double) { return 1.2; });
  const std::vector<double> e(5, 0.1);
  const ResidualView view{&r, e, kNoise_psi};
  EXPECT_TRUE(find_dependences(std::span(&view, 1)).empty());
}

}  // namespace
}  // namespace valvetriage
