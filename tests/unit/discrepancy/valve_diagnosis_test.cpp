#include "core/discrepancy/valve_diagnosis.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <ostream>
#include <random>
#include <span>

#include "core/discrepancy/heldout.h"
#include "core/discrepancy/instants.h"
#include "core/discrepancy/joint_fits.h"
#include "core/discrepancy/own_parameters.h"
#include "core/discrepancy/slip_search.h"
#include "core/discrepancy/valve_catalogue.h"
#include "core/discrepancy/valve_contest.h"
#include "core/mechanisms/mechanism.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/recording/limits.h"
#include "tests/unit/identify/valves.h"

namespace valvetriage {

inline void PrintTo(const MechanismUse& use, std::ostream* out) {
  *out << use.cause;
}

namespace {

using test::kNoise_psi;

/// A population around the made-up valve: what eight good ones of the stand differ by, and no bias of the simulation.
struct Population {
  ValveFitOptions options;
  std::vector<CauseOnGoodValves> causes;

  explicit Population(const std::vector<Recording>& healthy, const test::MadeValve& valve) {
    options.knots = *map_knots(healthy);
    options.reference_psi = 105;
    const auto count = static_cast<Eigen::Index>(options.knots.size());
    Eigen::VectorXd mean(8 + count), sd(8 + count);
    mean.head(8) = to_vector(valve.parameters);
    sd.head(8) << 0.05, 0.05, 0.0004, 0.0005, 0.05, 0.01, 0.05, 0.0002;
    for (Eigen::Index k = 0; k < count; ++k) mean(8 + k) = valve.map(options.knots[static_cast<std::size_t>(k)]);
    sd.tail(count).setConstant(1.0);
    options.prior = population_prior(mean, sd.array().square().matrix().asDiagonal().toDenseMatrix(), 8);
    for (const Mechanism* law : all_mechanisms()) {
      causes.push_back({.cause = std::string(law->cause), .size_mean = std::isfinite(law->neutral) ? law->neutral : 0});
    }
  }

  Model model(const test::MadeValve& valve) const {
    StaticMap map{options.knots, {}};
    for (const double u : options.knots) map.output.push_back(valve.map(u));
    return to_model(valve.parameters, map);
  }
};

/// The session again with a cause in it: its effect on the model added to what was measured.
std::vector<Recording> with_cause(std::vector<Recording> recordings, Model model, const MechanismUse& use) {
  for (Recording& recording : recordings) {
    const auto before = simulate_extended(model, recording, {});
    Model spoiled = model;
    spoiled.mechanisms.push_back(use);
    const auto after = simulate_extended(spoiled, recording, {});
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      recording.output.values[i] += (*after)[i] - (*before)[i];
    }
  }
  return recordings;
}

ValveDiagnosis diagnosed(const std::vector<Recording>& recordings, const Population& population) {
  const auto fit = fit_valve(recordings, population.options);
  return diagnose_valve(recordings, *fit,
                        {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = {}});
}

TEST(ValveDiagnosis, AGoodValveHasNoCause) {
  const test::MadeValve valve;
  for (const unsigned seed : {3u, 33u, 333u}) {
    const auto healthy = test::session(valve, kNoise_psi, seed);
    const Discrepancy found = diagnosed(healthy, Population(healthy, valve)).discrepancy;
    EXPECT_EQ(found.conclusion, Conclusion::kNone) << seed;
    EXPECT_TRUE(found.causes.empty());
    EXPECT_EQ(found.gain.reduction, 0);
  }
}

/// The session with every pressure so many times what it was.
std::vector<Recording> with_pressures(std::vector<Recording> recordings, double factor) {
  for (Recording& recording : recordings) {
    for (double& pressure : recording.output.values) pressure *= factor;
  }
  return recordings;
}

TEST(ValveDiagnosis, APressureOfTheOtherSignIsNoCauseInAValve) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const ValveDiagnosis found = diagnosed(with_pressures(healthy, -1), Population(healthy, valve));
  EXPECT_EQ(found.discrepancy.conclusion, Conclusion::kUnexplained);
  EXPECT_TRUE(found.discrepancy.causes.empty());
  // What is handed out is the baseline's, with nothing that was only simulated.
  EXPECT_TRUE(found.extended.empty());
  EXPECT_TRUE(std::isnan(found.discrepancy.gain.rmse_extended));
  ASSERT_EQ(found.discrepancy.findings.size(), 1u);
  const Finding& finding = found.discrepancy.findings.front();
  EXPECT_EQ(finding.where, kStaticMap);
  EXPECT_NE(finding.what.find("check the sign of the pressure"), std::string::npos) << finding.what;
  for (const Candidate& candidate : found.discrepancy.candidates) {
    EXPECT_EQ(candidate.probability, candidate.cause == "unknown" ? 1 : 0) << candidate.cause;
  }
}

TEST(ValveDiagnosis, APressureInAnotherUnitIsNoLossOfGainAndALossOfGainNoUnit) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  for (const auto& [factor, unit] : {std::pair(0.0689, "bar"), {6.895, "kPa"}}) {
    const Discrepancy found = diagnosed(with_pressures(healthy, factor), population).discrepancy;
    EXPECT_EQ(found.conclusion, Conclusion::kUnexplained) << unit;
    ASSERT_EQ(found.findings.size(), 1u) << unit;
    EXPECT_NE(found.findings.front().what.find(unit), std::string::npos) << found.findings.front().what;
    // Of one recording the prior holds the map, so that other laws account for much of the unit.
    const auto one = with_pressures({healthy.front()}, factor);
    const Discrepancy of_one = diagnosed(one, population).discrepancy;
    ASSERT_EQ(of_one.findings.size(), 1u) << unit;
    EXPECT_NE(of_one.findings.front().what.find(unit), std::string::npos) << of_one.findings.front().what;
  }
  const MechanismUse loss{.cause = "gain_loss", .parameters = {0.3}};
  const Discrepancy found = diagnosed(with_cause(healthy, population.model(valve), loss), population).discrepancy;
  ASSERT_FALSE(found.causes.empty());
  for (const Finding& finding : found.findings) EXPECT_NE(finding.where, kStaticMap) << finding.what;
}

/// The logged input with 0.5 mA of noise and a line on it: what 201.7 Hz of dither leaves in a log of 200 Hz.
std::vector<Recording> with_line_in_log(std::vector<Recording> recordings, double amplitude_a) {
  double phase = 0.3;
  std::mt19937_64 random(8);
  std::normal_distribution<double> noise(0, 0.0005);
  for (Recording& recording : recordings) {
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      const double t = static_cast<double>(i) * recording.sample_period_s;
      recording.input.values[i] += amplitude_a * std::sin(2 * std::numbers::pi * 1.7 * t + phase) + noise(random);
    }
    phase += 1.1;
  }
  return recordings;
}

TEST(ValveDiagnosis, ALineThatOnlyTheLogOfTheInputHasIsNoDisturbance) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Discrepancy found = diagnosed(with_line_in_log(healthy, 0.002), Population(healthy, valve)).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kNone) << (found.causes.empty() ? "" : found.causes.front().cause);
  ASSERT_FALSE(found.findings.empty());
  EXPECT_EQ(found.findings.front().where, "input");
  const std::string& what = found.findings.front().what;
  const std::string before = "a line of 1.7 Hz and ";
  ASSERT_EQ(what.find(before), 0u) << what;
  EXPECT_NEAR(std::stod(what.substr(before.size())), 0.002, 0.0004) << what;
}

TEST(ValveDiagnosis, ALineInTheLogOfARampIsSeenAsOneOfARestIs) {
  const test::MadeValve valve;
  const std::vector<Recording> healthy{test::step_to(valve, 1.8, kNoise_psi, 5), test::triangle(valve, kNoise_psi, 6)};
  const Discrepancy found = diagnosed(with_line_in_log(healthy, 0.002), Population(healthy, valve)).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kNone) << (found.causes.empty() ? "" : found.causes.front().cause);
  ASSERT_FALSE(found.findings.empty());
  EXPECT_EQ(found.findings.front().where, "input");
}

TEST(ValveDiagnosis, ALineInTheLogOfASweepIsSeenWhereTheSweepIsSlowerOrFaster) {
  const test::MadeValve valve;
  const std::vector<Recording> healthy{test::sweep(valve, kNoise_psi, 5)};
  const Discrepancy found = diagnosed(with_line_in_log(healthy, 0.001), Population(healthy, valve)).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kNone) << (found.causes.empty() ? "" : found.causes.front().cause);
  ASSERT_FALSE(found.findings.empty());
  EXPECT_EQ(found.findings.front().where, "input");
  EXPECT_TRUE(found.findings.front().what.starts_with("a line of 1.7 Hz")) << found.findings.front().what;
}

TEST(ValveDiagnosis, AToneInASweepOverFewLevelsMayBeHuntingAsWellAsADisturbance) {
  const test::MadeValve valve;
  std::vector<Recording> recordings{test::sweep(valve, kNoise_psi, 5)};
  const Population population(recordings, valve);
  for (std::size_t i = 0; i < recordings.front().samples(); ++i) {
    recordings.front().output.values[i] += 0.4 * std::sin(2 * std::numbers::pi * 1.7 * 0.005 * static_cast<double>(i));
  }
  const Discrepancy found = diagnosed(recordings, population).discrepancy;
  ASSERT_EQ(found.conclusion, Conclusion::kAmbiguous);
  std::vector<std::string> causes = found.causes.front().alternatives;
  causes.push_back(found.causes.front().cause);
  for (const char* cause : {"periodic_disturbance", "self_oscillation"}) {
    EXPECT_NE(std::find(causes.begin(), causes.end(), cause), causes.end()) << cause;
  }
  // The log has no such line: it is the output's.
  for (const Finding& finding : found.findings) EXPECT_NE(finding.where, "input") << finding.what;
}

TEST(ValveDiagnosis, AWeakLineInTheLogIsTakenOffThoughTheOutputHasStrongerOnesOfItsOwn) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  auto recordings = with_line_in_log(healthy, 0.001);
  for (Recording& recording : recordings) {
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      const double t = static_cast<double>(i) * recording.sample_period_s;
      for (const double hz : {5.13, 8.31, 12.7}) {
        recording.output.values[i] += 0.3 * std::sin(2 * std::numbers::pi * hz * t);
      }
    }
  }
  const Discrepancy found = diagnosed(recordings, Population(healthy, valve)).discrepancy;
  EXPECT_TRUE(std::ranges::any_of(found.findings, [](const Finding& finding) {
    return finding.where == "input" && finding.what.starts_with("a line of 1.7 Hz");
  }));
}

TEST(ValveDiagnosis, AToneThatHalfOfTheRecordingsHaveIsNotTheStands) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const auto with_tone = [&](std::size_t first, double amplitude_psi) {
    auto recordings = healthy;
    for (std::size_t r = first; r < recordings.size(); ++r) {
      for (std::size_t i = 0; i < recordings[r].samples(); ++i) {
        recordings[r].output.values[i] +=
            amplitude_psi * std::sin(2 * std::numbers::pi * 7.3 * 0.005 * static_cast<double>(i));
      }
    }
    return diagnosed(recordings, Population(healthy, valve)).discrepancy;
  };
  const Discrepancy everywhere = with_tone(0, 0.2);
  EXPECT_EQ(everywhere.conclusion, Conclusion::kNamed);
  EXPECT_EQ(everywhere.causes.front().cause, "periodic_disturbance");
  EXPECT_EQ(with_tone(2, 0.2).conclusion, Conclusion::kUnexplained);
}

TEST(ValveDiagnosis, ADriftThatFollowsTheLoadIsNotTheReadings) {
  const test::MadeValve valve;
  auto healthy = test::session(valve, kNoise_psi, 5);
  std::vector<double> staircase;
  for (int step = 0; step < 24; ++step) staircase.insert(staircase.end(), 200, 1.0 + 0.1 * std::min(step, 23 - step));
  healthy.push_back(test::played(valve, TestKind::kStaircase, staircase, {}, kNoise_psi, 9));
  const Population population(healthy, valve);
  // Creep by three hundredths of the load, not settled in half a minute; or the same rate at every level.
  const auto with_drift = [&](double of_load, double psi_per_s) {
    auto recordings = healthy;
    for (Recording& recording : recordings) {
      double crept = 0;
      for (std::size_t i = 0; i < recording.samples(); ++i) {
        double& output = recording.output.values[i];
        crept += (of_load * output - crept) * recording.sample_period_s / 30;
        output += crept + psi_per_s * static_cast<double>(i) * recording.sample_period_s;
      }
    }
    return diagnosed(recordings, population).discrepancy;
  };
  const Discrepancy drift = with_drift(0, 0.03);
  EXPECT_EQ(drift.conclusion, Conclusion::kNamed);
  EXPECT_EQ(drift.causes.front().cause, "sensor_drift");
  EXPECT_EQ(with_drift(0.03, 0).conclusion, Conclusion::kUnexplained);
}

TEST(ValveDiagnosis, HuntingIsNamedWhosePhaseDriftsAndNotAToneThatDriftsAtAllLevels) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  // Around 150 psi or everywhere; no phase is foretold for longer than a few seconds.
  const auto with_drifting = [&](double half_width_psi) {
    std::mt19937_64 random(8);
    std::normal_distribution<double> step(0, 0.03);
    std::vector<Recording> recordings = healthy;
    for (Recording& recording : recordings) {
      double phase = 100 * step(random);
      const std::vector<double> level = recording.output.values;
      for (std::size_t i = 0; i < recording.samples(); ++i) {
        const double far = (level[i] - 150) / half_width_psi;
        recording.output.values[i] += 0.4 * std::sqrt(std::max(0.0, 1 - far * far)) * std::sin(phase);
        phase += 2 * std::numbers::pi * 9 * 0.005 + step(random);
      }
    }
    return diagnosed(recordings, population).discrepancy;
  };
  const Discrepancy hunting = with_drifting(50);
  EXPECT_EQ(hunting.conclusion, Conclusion::kNamed);
  ASSERT_EQ(hunting.causes.size(), 1u);
  EXPECT_EQ(hunting.causes.front().cause, "self_oscillation");
  EXPECT_NEAR(hunting.causes.front().parameters.at(0).second.value, 9, 0.2);
  EXPECT_NEAR(hunting.causes.front().parameters.at(2).second.value, 150, 10);
  EXPECT_GT(hunting.gain.reduction_ci95[0], 0);
  for (const NamedCause& cause : with_drifting(1e6).causes) EXPECT_NE(cause.cause, "self_oscillation");
}

TEST(ValveDiagnosis, AReadingThatHoldsAnotherLevelAtEveryRestIsNoSlowNoise) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  // One noise that forgets within a second, one reading that sticks until the next half second.
  const auto with_slow = [&](double rms_psi, bool sticks) {
    auto recordings = healthy;
    for (Recording& recording : recordings) {
      double slow = normal(random);
      for (std::size_t i = 0; i < recording.samples(); ++i) {
        if (!sticks) slow = 0.995 * slow + std::sqrt(1 - 0.995 * 0.995) * normal(random);
        if (sticks && i % 100 == 0) slow = normal(random);
        recording.output.values[i] += rms_psi * slow;
      }
    }
    return diagnosed(recordings, population).discrepancy.conclusion;
  };
  EXPECT_EQ(with_slow(1.5 * kNoise_psi, false), Conclusion::kNone);
  EXPECT_EQ(with_slow(6 * kNoise_psi, true), Conclusion::kUnexplained);
}

TEST(ValveDiagnosis, AReadingThatHoldsAnotherLevelAtEachRestIsNotNothing) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const std::vector<LeftoverOnGoodValves> leftovers{{"from rest to rest", -2.1, 0.3}};
  const auto conclusion = [&](const std::vector<Recording>& recordings) {
    const auto fit = fit_valve(recordings, population.options);
    return diagnose_valve(
               recordings, *fit,
               {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = leftovers})
        .discrepancy.conclusion;
  };
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  // A gauge that comes free where the input moves, and one whose noise forgets within a second.
  auto sticks = healthy, wanders = healthy, coarse = healthy;
  for (std::size_t r = 0; r < healthy.size(); ++r) {
    double held = 0, slow = normal(random);
    for (std::size_t i = 0; i < healthy[r].samples(); ++i) {
      const bool moves = i == 0 || healthy[r].input.values[i] != healthy[r].input.values[i - 1];
      if (moves) held = normal(random);
      slow = 0.98 * slow + std::sqrt(1 - 0.98 * 0.98) * normal(random);
      sticks[r].output.values[i] += 2 * kNoise_psi * held;
      wanders[r].output.values[i] += 1.5 * kNoise_psi * slow;
      // Five times as coarse as the noise.
      const double step = 5 * kNoise_psi;
      coarse[r].output.values[i] = step * std::round(healthy[r].output.values[i] / step);
    }
  }
  EXPECT_EQ(conclusion(healthy), Conclusion::kNone);
  EXPECT_EQ(conclusion(sticks), Conclusion::kUnexplained);
  EXPECT_EQ(conclusion(wanders), Conclusion::kNone);
  EXPECT_EQ(conclusion(coarse), Conclusion::kNone);
}

/// What eight good valves show along the directions: noise.
Discrepancy beside_directions(const std::vector<Recording>& recordings, const Population& population) {
  const std::vector<LeftoverOnGoodValves> leftovers{{"a delay that grows", 0.55, 0.5},
                                                    {"following for seconds", 0.55, 0.5}};
  const auto fit = fit_valve(recordings, population.options);
  return diagnose_valve(
             recordings, *fit,
             {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = leftovers})
      .discrepancy;
}

void add_noise(std::vector<Recording>& recordings) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  for (Recording& recording : recordings) {
    for (double& pressure : recording.output.values) pressure += kNoise_psi * normal(random);
  }
}

TEST(ValveDiagnosis, ClocksThatRunApartHaveNoNameAndAreSeen) {
  const test::MadeValve valve;
  const Population population(test::session(valve, kNoise_psi, 5), valve);
  for (const double apart : {0.0, 0.0008, -0.0008}) {
    auto recordings = test::session(valve, 0, 5);
    for (Recording& recording : recordings) {
      const std::vector<double> at_input = recording.output.values;
      for (std::size_t i = 0; i < at_input.size(); ++i) {
        // The clock of the output counts so many more seconds.
        const double at = static_cast<double>(i) / (1 + apart);
        const auto before = std::min(static_cast<std::size_t>(at), at_input.size() - 2);
        recording.output.values[i] =
            std::lerp(at_input[before], at_input[before + 1], at - static_cast<double>(before));
      }
    }
    add_noise(recordings);
    const Discrepancy found = beside_directions(recordings, population);
    if (apart == 0) {
      EXPECT_EQ(found.conclusion, Conclusion::kNone);
      EXPECT_EQ(found.unnamed_change(), nullptr);
      continue;
    }
    EXPECT_EQ(found.conclusion, Conclusion::kUnexplained) << apart;
    ASSERT_NE(found.unnamed_change(), nullptr) << apart;
    const std::string& what = found.unnamed_change()->what;
    const std::string before =
        apart > 0 ? "the output comes later and later by " : "the output comes sooner and sooner by ";
    ASSERT_TRUE(what.starts_with(before)) << what;
    EXPECT_NEAR(std::stod(what.substr(before.size())), 800, 100) << what;
    EXPECT_NE(what.find(apart > 0 ? "ppm faster than" : "ppm slower than"), std::string::npos) << what;
  }
}

TEST(ValveDiagnosis, AnOutputThatGoesOnMovingForSecondsHasNoNameAndIsSeen) {
  const test::MadeValve valve;
  const Population population(test::session(valve, kNoise_psi, 5), valve);
  auto recordings = test::session(valve, 0, 5);
  for (Recording& recording : recordings) {
    double late = recording.output.values.front();
    for (double& pressure : recording.output.values) {
      late += (pressure - late) * recording.sample_period_s / 4;
      pressure += 0.01 * (late - pressure);
    }
  }
  add_noise(recordings);
  const Discrepancy found = beside_directions(recordings, population);
  EXPECT_EQ(found.conclusion, Conclusion::kUnexplained);
  ASSERT_NE(found.unnamed_change(), nullptr);
  EXPECT_NE(found.unnamed_change()->what.find("% of the output follows some 5 s late"), std::string::npos)
      << found.unnamed_change()->what;
}

TEST(ValveDiagnosis, ALawThatAccountsForWhatNoGoodValveLeavesNeedNotStandOutOnceMore) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  Population population(healthy, valve);
  const auto spoiled =
      with_cause(healthy, population.model(valve),
                 {.cause = "intermittent", .parameters = {9.0, -0.012, 0}, .channel = healthy.back().name});
  std::vector<LeftoverOnGoodValves> leftovers;
  for (const char* group :
       {"at rest, low", "at rest, middle", "at rest, high", "moving, low", "moving, middle", "moving, high"}) {
    leftovers.push_back({group, 0.0, 0.12});
  }
  const auto conclusion = [&](double evidence_in_good_valves) {
    for (CauseOnGoodValves& good : population.causes) {
      if (good.cause != "intermittent") continue;
      good.evidence_mean = evidence_in_good_valves;
      good.evidence_sd = evidence_in_good_valves;
    }
    const auto fit = fit_valve(spoiled, population.options);
    return diagnose_valve(
               spoiled, *fit,
               {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = leftovers})
        .discrepancy;
  };
  // Its evidence is some 30 times what eight good valves show: one of them in a few hundred would, by that alone.
  const Discrepancy rare = conclusion(110);
  EXPECT_EQ(rare.conclusion, Conclusion::kNamed);
  ASSERT_EQ(rare.causes.size(), 1u);
  EXPECT_EQ(rare.causes.front().cause, "intermittent");
  // What good valves show as much of is no explanation, whatever else is odd about the valve.
  const Discrepancy usual = conclusion(1200);
  EXPECT_EQ(usual.conclusion, Conclusion::kUnexplained);
  EXPECT_TRUE(usual.causes.empty());
}

TEST(ValveDiagnosis, ALawThatAccountsForParametersThatNoGoodValveHasNeedNotStandOutOnceMore) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  Population population(healthy, valve);
  const auto spoiled = with_cause(healthy, population.model(valve), {.cause = "sensor_offset", .parameters = {-14.0}});
  const auto found = [&](double evidence_in_good_valves) {
    for (CauseOnGoodValves& good : population.causes) {
      if (good.cause != "sensor_offset") continue;
      good.evidence_mean = good.evidence_sd = evidence_in_good_valves;
    }
    return diagnosed(spoiled, population).discrepancy;
  };
  // By its evidence alone one good valve in a few hundred would show it.
  const Discrepancy rare = found(500);
  EXPECT_EQ(rare.conclusion, Conclusion::kNamed);
  ASSERT_EQ(rare.causes.size(), 1u);
  EXPECT_EQ(rare.causes.front().cause, "sensor_offset");
  // What good valves show as much of is no explanation, whatever else is odd about the valve.
  EXPECT_EQ(found(1200).conclusion, Conclusion::kUnexplained);
}

class ValveDiagnosisOf : public testing::TestWithParam<MechanismUse> {};

TEST_P(ValveDiagnosisOf, NamesTheCauseThatWasPutIn) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 7);
  const Population population(healthy, valve);
  const auto spoiled = with_cause(healthy, population.model(valve), GetParam());
  const ValveDiagnosis diagnosis = diagnosed(spoiled, population);
  ASSERT_EQ(diagnosis.discrepancy.causes.size(), 1u);
  const NamedCause& named = diagnosis.discrepancy.causes.front();
  const bool among = named.cause == GetParam().cause || std::find(named.alternatives.begin(), named.alternatives.end(),
                                                                  GetParam().cause) != named.alternatives.end();
  EXPECT_TRUE(among) << named.cause;
  EXPECT_GT(diagnosis.discrepancy.gain.reduction, 0);
  ASSERT_EQ(diagnosis.extended_model.mechanisms.size(), 1u);
  EXPECT_EQ(diagnosis.extended_model.mechanisms.front().cause, named.cause);
  const DiscrepancyGain& gain = diagnosis.discrepancy.gain;
  EXPECT_LT(named.rmse_after, named.rmse_before);
  for (const auto& [name, estimate] : named.parameters) {
    // The interval ends where the law does, and else says what the standard error says.
    EXPECT_LE(estimate.ci95[1] - estimate.ci95[0], 1.001 * 2 * 1.96 * estimate.std_error) << name;
  }
  EXPECT_GE(gain.rmse_black_box, 0.9 * gain.noise_floor);  // no regression explains noise that it has not seen
  if (diagnosis.discrepancy.conclusion == Conclusion::kAmbiguous) {
    EXPECT_TRUE(diagnosis.discrepancy.next_test);
  }
}

INSTANTIATE_TEST_SUITE_P(Causes, ValveDiagnosisOf,
                         testing::Values(MechanismUse{.cause = "hysteresis", .parameters = {0.03, 0.1, 0}},
                                         MechanismUse{.cause = "sensor_offset", .parameters = {6}},
                                         MechanismUse{.cause = "gain_loss", .parameters = {0.85}},
                                         MechanismUse{.cause = "saturation", .parameters = {120, -INFINITY, 0}},
                                         MechanismUse{.cause = "self_oscillation",
                                                      .parameters = {12.3, 1.5, 150, 50, 0.2, 10, 0.5}},
                                         MechanismUse{.cause = "extra_lag", .parameters = {0.03, 0}},
                                         MechanismUse{.cause = "transport_delay", .parameters = {0.009}},
                                         MechanismUse{.cause = "leakage", .parameters = {0.14}}),
                         [](const auto& tried) { return tried.param.cause; });

/// What is said of a valve with one cause in it, its session played with a seed.
Discrepancy found_in(const MechanismUse& hidden, int seed) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, seed);
  const Population population(healthy, valve);
  return diagnosed(with_cause(healthy, population.model(valve), hidden), population).discrepancy;
}

TEST(ValveDiagnosis, ALagOfCoilOrSpoolIsNamedAheadOfTheMap) {
  const Discrepancy found = found_in({.cause = "extra_lag", .parameters = {0.03, 1}}, 3);
  ASSERT_EQ(found.causes.size(), 1u);
  EXPECT_EQ(found.causes.front().cause, "extra_lag");
  EXPECT_NEAR(found.causes.front().parameters.at(0).second.value, 0.03, 0.004);
  EXPECT_EQ(found.causes.front().parameters.at(1).second.value, 1);
}

TEST(ValveDiagnosis, AGainThatRisesFromTheStartOfARecordingOnIsNoCoilThatWarms) {
  for (const int seed : {3, 4}) {
    const Discrepancy rising = found_in({.cause = "thermal_drift", .parameters = {0.02, 3, 0}}, seed);
    EXPECT_NE(rising.conclusion, Conclusion::kNamed) << seed;
    for (const NamedCause& cause : rising.causes) EXPECT_LT(cause.probability, 0.95) << cause.cause;
    const Discrepancy falling = found_in({.cause = "thermal_drift", .parameters = {-0.02, 3, 0}}, seed);
    ASSERT_EQ(falling.causes.size(), 1u) << seed;
    EXPECT_EQ(falling.causes.front().cause, "thermal_drift") << seed;
  }
}

/// The rising edge of one step and 1.8 s after it, of a valve whose population was learned from whole sessions.
Discrepancy found_on_one_edge(const MechanismUse& hidden, int seed) {
  constexpr std::size_t kSamples = 560;
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, seed);
  const Population population(healthy, valve);
  Recording step = test::step_to(valve, 1.8, kNoise_psi, static_cast<unsigned>(seed));
  step.segments.pop_back();
  step.segments.back().end = kSamples;
  for (std::vector<double>* values : {&step.time_s, &step.input.values, &step.output.values}) values->resize(kSamples);
  return diagnosed(with_cause({step}, population.model(valve), hidden), population).discrepancy;
}

TEST(ValveDiagnosis, ADelayOnTheOnlyEdgeThereIsIsNotUnexplainedForWantOfAnotherEdge) {
  for (const int seed : {3, 4}) {
    const Discrepancy found = found_on_one_edge({.cause = "transport_delay", .parameters = {0.012}}, seed);
    ASSERT_EQ(found.causes.size(), 1u) << seed;
    EXPECT_NE(found.conclusion, Conclusion::kUnexplained) << seed;
    EXPECT_EQ(found.causes.front().cause, "transport_delay") << seed;
    // Where the edge is held out nothing tells of the delay: it is not used there, and neither helps nor harms.
    EXPECT_GT(found.gain.reduction, -0.01) << seed;
  }
}

TEST(ValveDiagnosis, AGainThatIsThereFromTheFirstSecondOnIsNoCoilThatWarms) {
  for (const int seed : {3, 4}) {
    const Discrepancy found = found_in({.cause = "gain_loss", .parameters = {0.85}}, seed);
    ASSERT_EQ(found.causes.size(), 1u) << seed;
    EXPECT_EQ(found.causes.front().cause, "gain_loss") << seed;
    EXPECT_EQ(std::ranges::count(found.causes.front().alternatives, "thermal_drift"), 0) << seed;
  }
}

TEST(JointFits, PutALagAheadOfTheMapThoughTheSurveyHasItBehind) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 3);
  const Population population(healthy, valve);
  for (const double lag_s : {0.012, 0.02, 0.04}) {
    const MechanismUse lag{.cause = "extra_lag", .parameters = {lag_s, 1}};
    const auto slow = with_cause(healthy, population.model(valve), lag);
    const Explanation beside = explain_nothing(slow, population.options, *fit_valve(slow, population.options));
    const Survey survey = survey_laws(LinearisedValve(*beside.problem, beside.v), *beside.options);
    const auto surveyed = std::find_if(survey.tested.begin(), survey.tested.end(),
                                       [](const Tested& tested) { return tested.cause() == "extra_lag"; });
    ASSERT_NE(surveyed, survey.tested.end());
    Tested behind = *surveyed;
    LawFit& fit = behind.fit;
    fit.law.lower.back() = fit.law.upper.back() = fit.law.start.back() = 0;
    fit.parameters.back() = fit.shape.back() = 0;
    for (auto& start : behind.starts) start.back() = 0;
    JointFits joint{.lowest = beside.cost};
    fit_jointly({&behind}, beside, true, joint);
    const std::vector<double> found = joint.fitted.at(0).parameters_of_last();
    EXPECT_EQ(found.at(1), 1) << lag_s;
    EXPECT_NEAR(found.at(0), lag_s, 0.1 * lag_s);
    EXPECT_EQ(joint.racing.at(0)->fit.law.lower.back(), 1) << lag_s;
    EXPECT_TRUE(joint.has("extra_lag"));
  }
}

/// The search for one cause beside the valve alone.
Tested surveyed(const Explanation& beside, std::string_view cause) {
  const Survey survey = survey_laws(LinearisedValve(*beside.problem, beside.v), *beside.options);
  return *std::find_if(survey.tested.begin(), survey.tested.end(),
                       [&](const Tested& tested) { return tested.cause() == cause; });
}

TEST(JointFits, AreLedOnWhereWhatTheyWereGivenUpForHasNotWon) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 3);
  const Population population(healthy, valve);
  const auto slow = with_cause(healthy, population.model(valve), {.cause = "transport_delay", .parameters = {0.004}});
  const Explanation beside = explain_nothing(slow, population.options, *fit_valve(slow, population.options));
  const Tested lag = surveyed(beside, "extra_lag");
  const std::vector<JointStart> starts{{at_population_mean(beside), lag.starts.front()}};
  const Explanation whole = extend_from(starts, beside, lag.fit, kJointSteps, {.lead = beside.cost});
  ASSERT_LT(whole.cost, beside.cost - kLeastEvidence) << "a lag does some of what a delay does";

  JointFits joint{.racing = {&lag}, .lowest = whole.cost};
  joint.fitted.push_back(extend_from(starts, beside, lag.fit, kJointSteps, {.matters = -1e9}));
  ASSERT_TRUE(joint.fitted.front().given_up);
  ASSERT_GT(joint.fitted.front().cost, whole.cost + kLeastEvidence);
  EXPECT_FALSE(lead_on(beside, 1e10, joint)) << "what matters is lower still";
  EXPECT_TRUE(lead_on(beside, 0, joint));
  EXPECT_NEAR(joint.fitted.front().cost, whole.cost, 1);
  EXPECT_FALSE(lead_on(beside, 0, joint)) << "there is nothing left to lead on";
}

TEST(SlipSearch, HasNoStartsWhereNoSlipsAreShownThatLeaveAsLittle) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 21);
  const Population population(healthy, valve);
  const auto starts_for = [&](const MechanismUse& hidden) {
    const auto spoiled = with_cause(healthy, population.model(valve), hidden);
    const Explanation beside = explain_nothing(spoiled, population.options, *fit_valve(spoiled, population.options));
    const Tested found = surveyed(beside, hidden.cause);
    const std::vector<JointStart> good{{at_population_mean(beside), found.starts.front()}};
    const Explanation closest = extend(beside, found.fit, kJointSteps, {.lead = beside.cost}, good);
    return slip_starts(beside, surveyed(beside, "friction").fit.law, at_population_mean(beside), closest).size();
  };
  EXPECT_EQ(starts_for({.cause = "leakage", .parameters = {0.3}}), 0u);
  EXPECT_GT(starts_for({.cause = "friction", .parameters = {0.083, 0.051, 0.2, 0}}), 0u);
}

TEST(ValveDiagnosis, ASpoolThatStopsIsASaturationAndNoDeadBand) {
  const Discrepancy found = found_in({.cause = "saturation", .parameters = {165, -INFINITY, 1}}, 3);
  ASSERT_EQ(found.causes.size(), 1u);
  EXPECT_EQ(found.causes.front().cause, "saturation");
  EXPECT_NEAR(found.causes.front().parameters.at(0).second.value, 165, 0.5);
  EXPECT_EQ(found.causes.front().parameters.back().second.value, 1);
}

bool holds(const ParameterEstimate& estimate, double value) {
  return value >= estimate.ci95[0] && value <= estimate.ci95[1];
}

TEST(ValveDiagnosis, AnExponentIsGivenWholeAndNotAsWhatItHasBeyondTheValves) {
  const test::MadeValve valve;
  const Discrepancy found = found_in({.cause = "orifice_flow", .parameters = {-0.12}}, 7);
  ASSERT_EQ(found.causes.size(), 1u);
  EXPECT_EQ(found.causes.front().cause, "orifice_flow");
  const ParameterEstimate& exponent = found.causes.front().parameters.at(0).second;
  EXPECT_TRUE(holds(exponent, valve.parameters.volume.exponent - 0.12)) << exponent.value;
  EXPECT_NEAR(exponent.population_mean, valve.parameters.volume.exponent, 0.02);
}

TEST(ValveDiagnosis, AnIntervalOfAnInstantReachesAsFarAsTheDataAllow) {
  // A hold near zero pressure says little of when the gain has changed, the edge of a step much.
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 7);
  const Population population(healthy, valve);
  for (const double instant_s : {6.5, 7.7, 9.1, 12.1}) {
    const auto spoiled =
        with_cause(healthy, population.model(valve),
                   {.cause = "intermittent", .parameters = {instant_s, -0.05, 0}, .channel = healthy.back().name});
    const Discrepancy found = diagnosed(spoiled, population).discrepancy;
    ASSERT_EQ(found.causes.size(), 1u) << instant_s;
    EXPECT_EQ(found.causes.front().cause, "intermittent") << instant_s;
    const auto& parameters = found.causes.front().parameters;
    EXPECT_TRUE(holds(parameters.at(0).second, instant_s)) << instant_s << " but " << parameters.at(0).second.value;
    EXPECT_TRUE(holds(parameters.at(1).second, -0.05)) << instant_s << " but " << parameters.at(1).second.value;
  }
}

TEST(Instants, MayBeginWithTheInputWhereTheDataDoNotTellThemFromAMove) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 7);
  const Population population(healthy, valve);
  // The second recording steps at 1 s and back at 4 s, the fourth moves throughout.
  const auto may_begin = [&](std::size_t recording, double instant_s, double change) {
    const std::vector<double> parameters{instant_s, change, static_cast<double>(recording)};
    const auto spoiled =
        with_cause(healthy, population.model(valve),
                   {.cause = "intermittent", .parameters = parameters, .channel = healthy[recording].name});
    const Explanation beside = explain_nothing(spoiled, population.options, *fit_valve(spoiled, population.options));
    const auto catalogue = valve_catalogue(LinearisedValve(*beside.problem, beside.v), population.options);
    const auto variant = std::find_if(catalogue.variants.begin(), catalogue.variants.end(), [&](const LawVariant& v) {
      return v.law.law->cause == "intermittent" && v.law.recording == recording;
    });
    const LawFit law{.law = variant->law, .parameters = parameters, .baseline = beside.v};
    return may_begin_with_input(extend(beside, law, 10, {.lead = INFINITY}), 0, 1);
  };
  EXPECT_TRUE(may_begin(1, 1.02, -0.05)) << "while the valve answers a step";
  EXPECT_FALSE(may_begin(1, 2.5, -0.05)) << "in a hold";
  EXPECT_FALSE(may_begin(1, 3.96, -0.05)) << "clearly ahead of a step";
  EXPECT_TRUE(may_begin(1, 3.96, -0.002)) << "as far as the noise tells, with the step";
  EXPECT_FALSE(may_begin(3, 5, -0.05)) << "where the input always moves";
}

TEST(ValveDiagnosis, ASizeIsWhatGoodValvesDoNotHave) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 7);
  Population population(healthy, valve);
  const auto spoiled = with_cause(healthy, population.model(valve), {.cause = "sensor_offset", .parameters = {6}});
  const ParameterEstimate alone = diagnosed(spoiled, population).discrepancy.causes.at(0).parameters.at(0).second;
  for (CauseOnGoodValves& good : population.causes) {
    if (good.cause == "sensor_offset") good.size_mean = 0.5, good.size_sd = 0.2;
  }
  const ParameterEstimate beyond = diagnosed(spoiled, population).discrepancy.causes.at(0).parameters.at(0).second;
  EXPECT_NEAR(beyond.value, alone.value - 0.5, 1e-9);
  EXPECT_EQ(beyond.population_mean, 0);
  EXPECT_EQ(beyond.population_sd, 0.2);
  // Student's t of seven freedoms, one more valve drawn.
  EXPECT_GT(beyond.ci95[1] - beyond.value, 2.365 * 0.2 * std::sqrt(1 + 1.0 / 8));
  EXPECT_LT(alone.ci95[1] - alone.value, beyond.ci95[1] - beyond.value);
}

TEST(ValveDiagnosis, ARivalThatLeavesClearlyMoreIsNoRival) {
  // Gain loss and a stiffer spring remove most of what a leak does, backlash most of what dry friction does.
  for (const MechanismUse& hidden : {MechanismUse{.cause = "leakage", .parameters = {0.14}},
                                     MechanismUse{.cause = "friction", .parameters = {0.02, 0.01, 0.3, 0}}}) {
    const Discrepancy found = found_in(hidden, 7);
    EXPECT_EQ(found.conclusion, Conclusion::kNamed) << hidden.cause;
    ASSERT_EQ(found.causes.size(), 1u);
    EXPECT_EQ(found.causes.front().cause, hidden.cause);
  }
}

TEST(ValveDiagnosis, StickSlipStaysARivalOfPlayForItHoldsPlayInIt) {
  const Discrepancy found = found_in({.cause = "backlash", .parameters = {0.02, 0, 0}}, 7);
  EXPECT_EQ(found.conclusion, Conclusion::kAmbiguous);
  ASSERT_EQ(found.causes.size(), 1u);
  std::vector<std::string> open = found.causes.front().alternatives;
  open.push_back(found.causes.front().cause);
  std::sort(open.begin(), open.end());
  EXPECT_EQ(open, (std::vector<std::string>{"backlash", "friction"}));
}

TEST(ValveDiagnosis, AKindOfMemoryIsNotSettledWhileTheValveKeepsSomeOfAnother) {
  const test::MadeValve valve;
  const Population population(test::session(valve, kNoise_psi, 7), valve);
  const ValveDiagnosisOptions options{.fit = population.options, .good_valves = 8, .causes = {}, .leftovers = {}};
  constexpr Eigen::Index kWide = ValveFitProblem::kLoop, kNarrow = ValveFitProblem::kNarrowLoop;
  const auto leaves = [&](const char* cause, Eigen::Index loop, double deviations) {
    Eigen::VectorXd v = population.options.prior->mean;
    v(loop) += deviations * std::sqrt(population.options.prior->covariance(loop, loop));
    return leaves_memory(*find_mechanism(cause), v, options);
  };
  // Student's t of seven freedoms at one in three hundred: 3.8.
  EXPECT_TRUE(leaves("hysteresis", kNarrow, 4));
  EXPECT_FALSE(leaves("hysteresis", kNarrow, 3.5));
  EXPECT_FALSE(leaves("hysteresis", kNarrow, -9));
  EXPECT_FALSE(leaves("hysteresis", kWide, 9));
  for (const char* cause : {"backlash", "friction"}) {
    EXPECT_TRUE(leaves(cause, kWide, 4)) << cause;
    EXPECT_FALSE(leaves(cause, kNarrow, 9)) << cause;
  }
  EXPECT_FALSE(leaves("gain_loss", kWide, 9));
}

/// The session with a spike wherever the input jumps, each of its own size and sign: no law of ours, and too fast to
/// look slow.
std::vector<Recording> with_spikes(std::vector<Recording> recordings, double psi_per_a) {
  std::size_t jumps = 0;
  for (Recording& recording : recordings) {
    for (std::size_t i = 1; i < recording.samples(); ++i) {
      const double step = recording.input.values[i] - recording.input.values[i - 1];
      recording.output.values[i] += psi_per_a * step * std::sin(1.7 * static_cast<double>(++jumps));
    }
  }
  return recordings;
}

TEST(ValveDiagnosis, ANameBesideWhichMostIsLeftIsNone) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const auto offset = with_cause(healthy, population.model(valve), {.cause = "sensor_offset", .parameters = {3}});
  EXPECT_EQ(diagnosed(with_spikes(offset, 10), population).discrepancy.conclusion, Conclusion::kNamed);
  EXPECT_EQ(diagnosed(with_spikes(offset, 90), population).discrepancy.conclusion, Conclusion::kUnexplained);
}

TEST(HeldOut, APartOfAnExplanationIsJudgedByWhatIsHeldOutOfTheWhole) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const auto humming =
      with_cause(healthy, population.model(valve), {.cause = "periodic_disturbance", .parameters = {7, 0.5, 1}});
  const Explanation nothing = explain_nothing(humming, population.options, *fit_valve(humming, population.options));
  const Survey survey = survey_laws(LinearisedValve(*nothing.problem, nothing.v), *nothing.options);
  const auto tone = std::find_if(survey.tested.begin(), survey.tested.end(),
                                 [](const Tested& tested) { return tested.cause() == "periodic_disturbance"; });
  ASSERT_NE(tone, survey.tested.end());
  const Explanation all = extend(nothing, tone->fit, 5, {});
  // A tone has a phase of its own in each recording: parts of recordings are held out of it, not recordings.
  const double of_parts = measure_gain(nothing, all).gain.rmse_baseline;
  EXPECT_EQ(held_out_rmse(nothing, nothing, all), of_parts);
  EXPECT_NE(measure_gain(nothing, nothing).gain.rmse_baseline, of_parts);
}

TEST(ValveDiagnosis, WhatGoodValvesLeaveAsWellHidesNoSecondCause) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  auto spoiled = healthy;
  for (const MechanismUse& use : {MechanismUse{.cause = "sensor_offset", .parameters = {9}},
                                  MechanismUse{.cause = "periodic_disturbance", .parameters = {7, 0.12, 1}}}) {
    spoiled = with_cause(spoiled, population.model(valve), use);
  }
  spoiled = with_spikes(spoiled, 20);
  const auto causes = [&](std::span<const LeftoverOnGoodValves> leftovers) {
    const auto fit = fit_valve(spoiled, population.options);
    const ValveDiagnosis found = diagnose_valve(
        spoiled, *fit,
        {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = leftovers});
    std::vector<std::string> names;
    for (const NamedCause& cause : found.discrepancy.causes) names.push_back(cause.cause);
    return names;
  };
  const LeftoverOnGoodValves another{"another", 0, 0.1}, three_tenths{"above the noise", std::log(1.3), 0.1};
  EXPECT_EQ(causes({&another, 1}), std::vector<std::string>{"sensor_offset"});
  EXPECT_EQ(causes({&three_tenths, 1}), (std::vector<std::string>{"sensor_offset", "periodic_disturbance"}));
}

/// The session read by a gauge whose gain wanders by so much, over a tenth of a second.
std::vector<Recording> with_wandering_gain(std::vector<Recording> recordings, double sd) {
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  for (Recording& recording : recordings) {
    const double keep = std::exp(-recording.sample_period_s / 0.1);
    double wander = 0;
    for (double& pressure : recording.output.values) {
      wander = keep * wander + std::sqrt(1 - keep * keep) * normal(generator);
      pressure *= 1 + sd * wander;
    }
  }
  return recordings;
}

TEST(ValveDiagnosis, WhatIsFarLouderThanGoodValvesLeaveIsNoNoiseOfTheStand) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const auto diagnosis_of = [&](double sd, double usual) {
    const std::vector<LeftoverOnGoodValves> leftovers{{"above the noise", std::log1p(usual), 0.1}};
    const auto wandering = with_wandering_gain(healthy, sd);
    const auto fit = fit_valve(wandering, population.options);
    return diagnose_valve(
               wandering, *fit,
               {.fit = population.options, .good_valves = 8, .causes = population.causes, .leftovers = leftovers})
        .discrepancy;
  };
  const Discrepancy loud = diagnosis_of(0.03, 0.05);
  EXPECT_EQ(loud.conclusion, Conclusion::kUnexplained);
  ASSERT_TRUE(loud.unnamed_change());
  EXPECT_NE(loud.unnamed_change()->what.find("times the noise"), std::string::npos) << loud.unnamed_change()->what;
  // Where good valves leave as much, and where slow noise is no louder than a stand's may be.
  EXPECT_EQ(diagnosis_of(0.03, 40).conclusion, Conclusion::kNone);
  EXPECT_EQ(diagnosis_of(0.006, 0.05).conclusion, Conclusion::kNone);
}

const Candidate& candidate(const Discrepancy& discrepancy, const std::string& cause) {
  const auto& list = discrepancy.candidates;
  return *std::find_if(list.begin(), list.end(), [&](const Candidate& c) { return c.cause == cause; });
}

TEST(ValveDiagnosis, ANarrowDeadBandIsFoundWhereverItsMiddleIs) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 7);
  Population population(healthy, valve);
  // Maps that bend alike: a step between two neighbours is no good valve's.
  auto& covariance = population.options.prior->covariance;
  const Eigen::Index count = covariance.rows() - 8;
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      const double apart = 0.025 * static_cast<double>(i - j) / 0.2;
      covariance(8 + i, 8 + j) = std::exp(-0.5 * apart * apart) + (i == j ? 1e-3 : 0);
    }
  }
  for (const double middle_a : {1.37, 1.52, 1.736}) {
    const auto spoiled =
        with_cause(healthy, population.model(valve), {.cause = "dead_band", .parameters = {middle_a, 0.008}});
    const Discrepancy found = diagnosed(spoiled, population).discrepancy;
    ASSERT_EQ(found.causes.size(), 1u) << middle_a;
    EXPECT_EQ(found.causes.front().cause, "dead_band") << middle_a;
    EXPECT_NEAR(found.causes.front().parameters.front().second.value, middle_a, 0.01);
  }
}

TEST(ValveDiagnosis, ASpoolThatSticksHardIsFoundWhereTheFitHasBentTowardsIt) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 21);
  const Population population(healthy, valve);
  const MechanismUse sticking{.cause = "friction", .parameters = {0.083, 0.051, 0.2, 0}};
  const ValveDiagnosis diagnosis = diagnosed(with_cause(healthy, population.model(valve), sticking), population);
  ASSERT_FALSE(diagnosis.discrepancy.causes.empty());
  const NamedCause& named = diagnosis.discrepancy.causes.front();
  EXPECT_EQ(named.cause, "friction");
  // On ramps of one speed the kinetic force and how fast friction falls to it stand for each other; breakaway does not.
  EXPECT_NEAR(named.parameters[0].second.value, 0.083, 0.004);
  EXPECT_EQ(diagnosis.discrepancy.causes.size(), 1u);
}

/// Channels that have nothing to do with the valve, as many as may stand beside one other.
void add_idle_channels(std::vector<Recording>& recordings) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (Recording& recording : recordings) {
    for (std::size_t c = 0; c + 1 < kMaxSideInputs; ++c) {
      Channel idle{.name = "idle_" + std::to_string(c), .values = std::vector<double>(recording.samples())};
      // Each wanders, as temperatures do.
      double at = 0;
      for (double& value : idle.values) value = at += normal(random);
      recording.side.push_back(std::move(idle));
    }
  }
}

TEST(ValveDiagnosis, ChannelsThatDoNothingAreNoCause) {
  const test::MadeValve valve;
  auto healthy = test::session(valve, kNoise_psi, 7);
  add_idle_channels(healthy);
  EXPECT_EQ(diagnosed(healthy, Population(healthy, valve)).discrepancy.conclusion, Conclusion::kNone);
}

TEST(ValveDiagnosis, AChannelThatLowersTheReadingIsFoundAsOneThatRaisesItBehindFifteenOthers) {
  const test::MadeValve valve;
  auto healthy = test::session(valve, kNoise_psi, 7);
  add_idle_channels(healthy);
  for (std::size_t r = 0; r < healthy.size(); ++r) {
    Channel supply{.name = "supply_psi", .unit = "psi", .values = {}};
    for (std::size_t i = 0; i < healthy[r].samples(); ++i) {
      const double turns = 0.005 * static_cast<double>(i) / 2.3 + 0.3 * static_cast<double>(r);
      supply.values.push_back(450 + 4 * std::sin(2 * std::numbers::pi * turns));
    }
    healthy[r].side.push_back(std::move(supply));
  }
  for (const double coefficient : {0.03, -0.03}) {
    auto spoiled = healthy;
    for (Recording& recording : spoiled) {
      for (std::size_t i = 0; i < recording.samples(); ++i) {
        recording.output.values[i] += coefficient * (recording.side.back().values[i] - 450);
      }
    }
    const Discrepancy found = diagnosed(spoiled, Population(healthy, valve)).discrepancy;
    ASSERT_EQ(found.causes.size(), 1u) << coefficient;
    EXPECT_EQ(found.causes.front().cause, "side_input") << coefficient;
    EXPECT_NEAR(found.causes.front().parameters.front().second.value, coefficient, 0.01);
  }
}

TEST(ValveDiagnosis, AChannelsOwnNoiseIsNoLagOfTheReading) {
  const test::MadeValve valve;
  auto healthy = test::session(valve, kNoise_psi, 7);
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.1);
  const auto temperature = [](std::size_t i, std::size_t recording) {
    const double turns = 0.005 * static_cast<double>(i) / 7 + 0.3 * static_cast<double>(recording);
    return 24 + 2 * std::sin(2 * std::numbers::pi * turns);
  };
  for (std::size_t r = 0; r < healthy.size(); ++r) {
    Channel logged{.name = "temperature_C", .unit = "C", .values = {}};
    for (std::size_t i = 0; i < healthy[r].samples(); ++i) logged.values.push_back(temperature(i, r) + noise(random));
    healthy[r].side.push_back(std::move(logged));
  }
  auto spoiled = healthy;
  for (std::size_t r = 0; r < spoiled.size(); ++r) {
    for (std::size_t i = 0; i < spoiled[r].samples(); ++i) spoiled[r].output.values[i] += 2 * (temperature(i, r) - 24);
  }
  const Discrepancy found = diagnosed(spoiled, Population(healthy, valve)).discrepancy;
  ASSERT_EQ(found.causes.size(), 1u);
  EXPECT_EQ(found.conclusion, Conclusion::kNamed);
  EXPECT_EQ(found.causes.front().cause, "side_input");
  EXPECT_NEAR(found.causes.front().parameters.front().second.value, 2, 0.1);
}

TEST(ValveDiagnosis, ASizeThatIsExcludedWouldHaveBeenFound) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 3);
  const Population population(healthy, valve);
  const Discrepancy none = diagnosed(healthy, population).discrepancy;
  ASSERT_EQ(none.conclusion, Conclusion::kNone);
  for (const auto& [cause, parameter] : {std::pair("sensor_offset", "offset_psi"), {"gain_loss", "ratio"}}) {
    const auto& limits = candidate(none, cause).upper_limit95;
    ASSERT_TRUE(limits.contains(parameter)) << cause;
    // Five standard errors are a name, the colour that the noise seems to have paid for; a limit is 1.6 of them from
    // the likeliest size.
    const double neutral = find_mechanism(cause)->neutral;
    const double excluded = neutral + 6 * (limits.at(parameter) - neutral);
    const auto spoiled = with_cause(healthy, population.model(valve), {.cause = cause, .parameters = {excluded}});
    const Discrepancy found = diagnosed(spoiled, population).discrepancy;
    ASSERT_FALSE(found.causes.empty()) << cause << ' ' << excluded;
    EXPECT_TRUE(candidate(found, found.causes.front().cause).upper_limit95.empty());  // what is in has no limit
  }
}

TEST(ValveDiagnosis, WhatAllGoodValvesHaveToTheLastDigitStiffensNothingBesideIt) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 3);
  Population population(healthy, valve);
  constexpr Eigen::Index kNarrowLoop = 7;
  population.options.prior->covariance(kNarrowLoop, kNarrowLoop) = 1e-18;
  const Discrepancy none = diagnosed(healthy, population).discrepancy;
  ASSERT_EQ(none.conclusion, Conclusion::kNone);
  // Good valves' maps differ by 1 psi at each of about sixty knots: an offset of much less cannot be excluded. The
  // noise alone would allow 0.01 psi.
  EXPECT_GT(std::abs(candidate(none, "sensor_offset").upper_limit95.at("offset_psi")), 0.04);
}

TEST(LeadStillAskedFor, IsWhatPutsARivalOut) {
  const Ranked leak{.cause = "leakage", .reduction = 1000, .left = 500};
  const Ranked curve{.cause = "static_curve", .reduction = 950};
  const auto lead_over = [](const Ranked& winner, const Ranked& rival, bool leaves_usual,
                            const FurtherRecordings& further) {
    return lead_still_asked_for(winner, rival, leaves_usual, further, 2,
                                {.good_valves = 8, .causes = {}, .leftovers = {}});
  };
  // It has a lead of 50. Five sixths of what it removes are near, and a rival must leave 1.44 times what it leaves. As
  // an idealisation it may miss a twentieth of the effect.
  EXPECT_NEAR(lead_over(leak, curve, true, {}), kLeastEvidence + 0.05 * 0.05 * 1000 / 2 - 50.0 / 2, 1e-9);
  EXPECT_NEAR(lead_over(leak, curve, false, {}), (1000.0 / 6 - 50) / 2, 1e-9);
  EXPECT_NEAR(lead_over(leak, curve, false, {.removed = 2000}), (0.44 * 500 - 50) / 2, 1e-9);
  EXPECT_NEAR(lead_over(leak, curve, false, {.left = 200, .removed = 2000}), (0.44 * 700 - 50) / 2, 1e-9);
  // Where free runs stick a worse fit may not be the best one: nothing but a distance puts it out.
  const Ranked friction{.cause = "friction", .reduction = 750, .fitted_jointly = true, .sticks = true};
  EXPECT_NEAR(lead_over(leak, friction, true, {.removed = 2000}), (3000.0 / 6 - 250) / 2, 1e-9);
  // Beside play it is the best: friction's search has begun there. Four fifths of what play removes are not near.
  const Ranked play{.cause = "backlash", .reduction = 1000, .fitted_jointly = true};
  // It may miss 2.33 twentieths, as one law in a hundred does.
  EXPECT_NEAR(lead_over(play, friction, true, {.removed = 2000}),
              kLeastEvidence + std::pow(2.3263 * 0.05, 2) * 3000 / 2 - 250.0 / 2, 1e-3);
}

TEST(LeastContrast, IsAskedOfWhatSticksAndOfWhatLeavesMoreThanGoodValvesDo) {
  const Ranked leak{.cause = "leakage"}, friction{.cause = "friction", .sticks = true};
  EXPECT_FALSE(least_contrast(leak, true));
  EXPECT_EQ(least_contrast(leak, false), 2.5);  // 4 z² of 25, in both directions together
  EXPECT_NEAR(*least_contrast(friction, true), 2.576, 1e-3);
}

TEST(ValveDiagnosis, AsksForATestOverTheRangeOfGoodValvesAndNotOfTheOneStepThatThereIs) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const std::vector<Recording> one_step{test::step_to(valve, 1.6, kNoise_psi, 5)};
  const auto spoiled = with_cause(one_step, population.model(valve), {.cause = "gain_loss", .parameters = {0.9}});
  const Discrepancy found = diagnosed(spoiled, population).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kAmbiguous);
  ASSERT_TRUE(found.next_test);
  EXPECT_GT(found.next_test->expected_probability, 0.5);
  double highest = 0;
  for (std::size_t at = found.next_test->input_csv.find(','); at != std::string::npos;
       at = found.next_test->input_csv.find(',', at + 1)) {
    highest = std::max(highest, std::strtod(found.next_test->input_csv.c_str() + at + 1, nullptr));
  }
  EXPECT_GT(highest, 1.75);  // good valves have been to 2.1 A
  EXPECT_LE(highest, population.options.knots.back());
}

TEST(KeepAsRival, GivesACauseAShareAndLeavesASumOfOne) {
  std::vector<Ranked> ranked(2);
  ranked[0] = {.cause = "friction", .probability = 1};
  ranked[1] = {.cause = "backlash", .probability = 0};
  keep_as_rival("backlash", ranked);
  keep_as_rival("hysteresis", ranked);
  double sum = 0;
  for (const Ranked& r : ranked) {
    sum += r.probability;
    EXPECT_GE(r.probability, 0.1) << r.cause;
  }
  EXPECT_EQ(ranked.size(), 3u);
  EXPECT_NEAR(sum, 1, 1e-12);
  EXPECT_EQ(ranked.front().cause, "friction");
}

/// A session whose gauge reads 6 psi too much.
ValveDiagnosis diagnosed_with_sensor_off(unsigned seed) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, seed);
  const Population population(healthy, valve);
  const auto spoiled = with_cause(healthy, population.model(valve), {.cause = "sensor_offset", .parameters = {6}});
  return diagnosed(spoiled, population);
}

TEST(ValveDiagnosis, TheGainCarriesOverToAKindOfTestThatWasNotFitted) {
  const Discrepancy found = diagnosed_with_sensor_off(9).discrepancy;
  ASSERT_FALSE(found.gain.transfer.empty());
  for (const Transfer& transfer : found.gain.transfer) {
    EXPECT_NE(transfer.from.find(transfer.to), 0u);
    EXPECT_LE(transfer.rmse_extended, 1.01 * transfer.rmse_baseline) << transfer.to;
  }
}

TEST(ValveDiagnosis, WithoutItsCauseTheExtendedModelIsOffByTheCause) {
  const ValveDiagnosis diagnosis = diagnosed_with_sensor_off(9);
  ASSERT_EQ(diagnosis.discrepancy.causes.size(), 1u);
  ASSERT_EQ(diagnosis.without_cause.size(), 1u);
  const double offset = diagnosis.discrepancy.causes.front().parameters.front().second.value;
  EXPECT_NEAR(diagnosis.extended[0][100] - diagnosis.without_cause[0][0][100], offset, 1e-9);
}

TEST(ValveDiagnosis, BesideANamedCauseASecondMayBeTooSmallToSee) {
  const Discrepancy found = diagnosed_with_sensor_off(5).discrepancy;
  ASSERT_EQ(found.conclusion, Conclusion::kNamed);
  EXPECT_GT(found.causes.front().probability, 0.95);
  double sum = 0, together = 0;
  for (const Candidate& candidate : found.candidates) {
    sum += candidate.probability;
    if (candidate.cause.starts_with("sensor_offset+")) together += candidate.probability;
  }
  EXPECT_NEAR(sum, 1, 1e-9);
  EXPECT_GT(together, 0.1);
  EXPECT_NEAR(candidate(found, "sensor_offset").probability + together, found.causes.front().probability, 1e-3);
  EXPECT_GT(candidate(found, "sensor_offset+friction").probability, 0);
  // Of its own family another would be an account of the same thing.
  for (const Candidate& candidate : found.candidates) EXPECT_NE(candidate.cause, "sensor_offset+sensor_drift");
}

TEST(ValveDiagnosis, AFaultThatTheFitHasTakenUpIsNotNothing) {
  const test::MadeValve valve;
  // No law of the vocabulary changes the spool's own speed, and the fit follows it wherever it is.
  test::MadeValve slow = valve;
  slow.parameters.spool.natural_frequency_rad_s *= 0.5;
  slow.parameters.spool.damping_ratio *= 0.6;
  const auto recordings = test::session(slow, kNoise_psi, 5);
  const Discrepancy found = diagnosed(recordings, Population(recordings, valve)).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kUnexplained);
  EXPECT_TRUE(std::any_of(found.findings.begin(), found.findings.end(), [](const Finding& finding) {
    return finding.what.starts_with("natural_frequency_rad_s below good valves'");
  }));
  // Around a fit that has taken it up no size is excluded.
  for (const Candidate& candidate : found.candidates) EXPECT_TRUE(candidate.upper_limit95.empty()) << candidate.cause;
}

TEST(ValveDiagnosis, MoreAirInTheFluidIsNoCauseThatLooksLikeIt) {
  // Slow where the pressure is low, which it is at the end of every fall: much like a fall slower than a rise.
  const test::MadeValve valve;
  test::MadeValve airy = valve;
  airy.parameters.volume.air_share = 0.03;
  const auto recordings = test::session(airy, kNoise_psi, 5);
  const Discrepancy found = diagnosed(recordings, Population(recordings, valve)).discrepancy;
  EXPECT_EQ(found.conclusion, Conclusion::kUnexplained);
  EXPECT_TRUE(std::any_of(found.findings.begin(), found.findings.end(), [](const Finding& finding) {
    return finding.what.starts_with("air in the fluid above good valves' explains more than");
  }));
  EXPECT_FALSE(found.next_test);
}

/// Good valves' mean, with one entry so many of their standard deviations off.
OwnParameters own_with(Eigen::Index entry, double deviations) {
  const test::MadeValve valve;
  const Population population(test::session(valve, kNoise_psi, 3), valve);
  const ValvePrior& good = *population.options.prior;
  Eigen::VectorXd v = good.mean;
  v(entry) += deviations * std::sqrt(good.covariance(entry, entry));
  return own_parameters_of(v, Eigen::VectorXd::Zero(v.size()),
                           {.fit = population.options, .good_valves = 8, .causes = {}, .leftovers = {}});
}

TEST(OwnParameters, AreThoseOfAGoodValveUpToWhatEightOfThemTell) {
  constexpr Eigen::Index kSupply = 6, kKnot = 8 + 20;
  for (const Eigen::Index entry : {kSupply, kKnot}) {
    // Student's t of seven freedoms beyond 8, twice, over about sixty entries.
    EXPECT_GT(own_with(entry, 7).p_value, kFalseAlarm) << entry;
    EXPECT_LT(own_with(entry, -10).p_value, kFalseAlarm) << entry;
  }
  EXPECT_EQ(own_with(kSupply, 3).findings.size(), 0u);
  ASSERT_EQ(own_with(kSupply, -10).findings.size(), 1u);
  EXPECT_EQ(own_with(kSupply, -10).findings.front().what,
            "supply_psi below good valves' by 10 of their standard deviations");
  EXPECT_TRUE(own_with(kKnot, 12).findings.front().what.starts_with("the map at "));
}

TEST(OwnParameters, KnotsThatSayTheSameThingAreOneTest) {
  const test::MadeValve valve;
  Population population(test::session(valve, kNoise_psi, 3), valve);
  ValvePrior& good = *population.options.prior;
  const Eigen::Index knots = good.mean.size() - 8;
  const auto p_value = [&] {
    Eigen::VectorXd v = good.mean;
    v(8 + 20) += 7 * std::sqrt(good.covariance(8 + 20, 8 + 20));
    return own_parameters_of(v, Eigen::VectorXd::Zero(v.size()),
                             {.fit = population.options, .good_valves = 8, .causes = {}, .leftovers = {}})
        .p_value;
  };
  const double apart = p_value();
  good.covariance.bottomRightCorner(knots, knots).setConstant(1.0);
  good.covariance.diagonal().tail(knots).array() += 1e-3;
  EXPECT_LT(p_value(), 0.25 * apart);
}

TEST(OwnParameters, ALoopThatNoGoodValveHasIsNotOddByLessThanDifferencesTell) {
  const test::MadeValve valve;
  Population population(test::session(valve, kNoise_psi, 3), valve);
  constexpr Eigen::Index kLoop = 3;
  ValvePrior& good = *population.options.prior;
  good.mean(kLoop) = 0;
  good.covariance(kLoop, kLoop) = 1e-18;
  const auto p_value_of_loop = [&](double width_a) {
    Eigen::VectorXd v = good.mean;
    v(kLoop) = width_a;
    return own_parameters_of(v, Eigen::VectorXd::Zero(v.size()),
                             {.fit = population.options, .good_valves = 8, .causes = {}, .leftovers = {}})
        .p_value;
  };
  EXPECT_GT(p_value_of_loop(2e-6), kFalseAlarm);
  EXPECT_LT(p_value_of_loop(2e-5), kFalseAlarm);
}

TEST(ValveDiagnosis, EqualRecordingsGiveEqualBits) {
  const test::MadeValve valve;
  const auto healthy = test::session(valve, kNoise_psi, 5);
  const Population population(healthy, valve);
  const auto spoiled = with_cause(healthy, population.model(valve), {.cause = "sensor_offset", .parameters = {5}});
  const ValveDiagnosis one = diagnosed(spoiled, population), other = diagnosed(spoiled, population);
  EXPECT_EQ(one.extended, other.extended);
  ASSERT_EQ(one.discrepancy.candidates.size(), other.discrepancy.candidates.size());
  for (std::size_t i = 0; i < one.discrepancy.candidates.size(); ++i) {
    EXPECT_EQ(one.discrepancy.candidates[i].probability, other.discrepancy.candidates[i].probability);
  }
}

}  // namespace
}  // namespace valvetriage
