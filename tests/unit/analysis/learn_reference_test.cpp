#include "core/analysis/learn_reference.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "core/mechanisms/mechanism.h"
#include "tests/unit/identify/valves.h"

namespace valvetriage {
namespace {

using test::kNoise_psi;

/// Made valves with a spread of 5 % in the volume's time constant, 2 % in scale, 0.3 ms in delay.
std::vector<test::MadeValve> made_valves(int valves, unsigned seed, double current = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<test::MadeValve> made(static_cast<std::size_t>(valves), test::with_currents_times(current));
  for (test::MadeValve& valve : made) {
    valve.parameters.volume.time_constant_s *= std::exp(0.05 * normal(random));
    valve.parameters.spool.delay_s += 0.0003 * normal(random);
    valve.scale *= std::exp(0.02 * normal(random));
  }
  return made;
}

std::vector<ValveRecordings> population(int valves, unsigned seed, double current = 1) {
  std::vector<ValveRecordings> good;
  for (const test::MadeValve& valve : made_valves(valves, seed, current)) {
    const auto before = static_cast<unsigned>(good.size());
    good.push_back({fmt::format("GOOD-{}", before + 1), test::session(valve, kNoise_psi, seed + 100 * before)});
  }
  return good;
}

const Reference& eight() {
  static const Reference reference = *learn_reference(population(8, 5), "type-1");
  return reference;
}

TEST(LearnReference, FindsTheMeanOfThePopulation) {
  const Reference& reference = eight();
  EXPECT_EQ(reference.valves, 8);
  ASSERT_EQ(reference.parameters.size(), kValveParameters.size());
  // Standard error of a mean over eight: 5 % / √8 and 0.3 ms / √8; four allowed.
  EXPECT_EQ(reference.parameters[4].name, "volume_time_constant_s");
  EXPECT_NEAR(reference.parameters[4].mean, std::log(0.06), 4 * 0.05 / std::sqrt(8.0));
  EXPECT_NEAR(reference.parameters[2].mean, 0.0072, 4 * 0.0003 / std::sqrt(8.0));
  EXPECT_EQ(reference.parameters[2].name, "delay_s");
  EXPECT_NEAR((*reference.model.map)(1.6), test::MadeValve{}.map(1.6), 4 * 0.02 * 110 / std::sqrt(8.0) + 0.2);
}

TEST(LearnReference, FindsTheSpreadOfThePopulation) {
  // A standard deviation from eight has a relative standard error of 27 %; a factor of 2.3 covers four of them.
  EXPECT_GT(eight().parameters[4].sd, 0.05 / 2.3);
  EXPECT_LT(eight().parameters[4].sd, 0.05 * 2.3);
}

TEST(LearnReference, OfStepsAloneTheMapIsKnownWhereOnlyEdgesPass) {
  std::vector<ValveRecordings> good = population(3, 5);
  unsigned seed = 900;
  for (const test::MadeValve& valve : made_valves(3, 5)) {
    std::vector<Recording>& recordings = good[seed - 900].recordings;
    recordings.back() = test::step_to(valve, 2.1, kNoise_psi, seed++);  // in the place of the triangle
  }
  const auto reference = learn_reference(good, "type-1");
  ASSERT_TRUE(reference.has_value()) << reference.error().message;
  for (const auto& member : reference->members) EXPECT_LT(member.rmse, 1.02 * kNoise_psi) << member.serial;
  const StaticMap& map = *reference->model.map;
  for (std::size_t k = 0; k < map.input.size(); ++k) {
    EXPECT_NEAR(map.output[k], test::MadeValve{}.map(map.input[k]), 8) << map.input[k];
    EXPECT_LT(reference->map_sd[k], 8) << map.input[k];
  }
}

TEST(LearnReference, KnowsWhatItSaw) {
  const Reference& reference = eight();
  EXPECT_NEAR(reference.input_min, 1.0, 1e-9);
  EXPECT_NEAR(reference.input_max, 2.1, 0.002);
  EXPECT_EQ(reference.tests, (std::vector<std::string>{"step", "triangle"}));
  EXPECT_NEAR(reference.noise_floor, kNoise_psi, 0.1 * kNoise_psi);
  EXPECT_NEAR(reference.sample_period_s, 0.005, 1e-12);
  ASSERT_EQ(reference.levels.size(), 3u);
  EXPECT_NEAR(reference.levels[1].level_a, 1.6, 0.011);
  EXPECT_GT(reference.levels[1].error_eq20_mean, 0);
  EXPECT_GT(reference.levels[1].rise_time_mean_s, 0.03);
}

TEST(LearnReference, EachSizeSaysHowManyValvesItIsKnownOf) {
  for (const CauseOnGoodValves& good : eight().causes) {
    const bool has_a_neutral_size = std::isfinite(find_mechanism(good.cause)->neutral);
    ASSERT_TRUE(good.size_valves) << good.cause;
    EXPECT_LE(*good.size_valves, 8) << good.cause;
    EXPECT_TRUE(!has_a_neutral_size || *good.size_valves == 8) << good.cause;
  }
  for (const LeftoverOnGoodValves& left : eight().leftovers) {
    ASSERT_TRUE(left.valves) << left.group;
    EXPECT_GE(*left.valves, 1) << left.group;
    EXPECT_LE(*left.valves, 8) << left.group;
  }
}

const LeftoverOnGoodValves* leftover_of_eight(const std::string& name) {
  const std::vector<LeftoverOnGoodValves>& known = eight().leftovers;
  const auto left =
      std::find_if(known.begin(), known.end(), [&](const LeftoverOnGoodValves& l) { return l.group == name; });
  return left == known.end() ? nullptr : &*left;
}

TEST(LearnReference, KnowsHowFarGoodValvesGoAlongWhatNoCauseStandsFor) {
  for (const char* name : {"a delay that grows", "following for seconds"}) {
    const LeftoverOnGoodValves* left = leftover_of_eight(name);
    ASSERT_NE(left, nullptr) << name;
    EXPECT_EQ(left->valves, 8) << name;
    // ln(1 + χ²) of noise alone is 0.5 in the mean.
    EXPECT_GT(left->mean, 0) << name;
    EXPECT_LT(left->mean, 2) << name;
  }
}

TEST(LearnReference, KnowsWhatAGoodValveCostsAboveItsNoise) {
  const LeftoverOnGoodValves* left = leftover_of_eight("above the noise");
  ASSERT_NE(left, nullptr);
  EXPECT_EQ(left->valves, 8);
  // They are of the fitted structure and leave nothing but their noise.
  EXPECT_GE(left->mean, 0);
  EXPECT_LT(left->mean, 0.1);
}

TEST(LearnReference, TheCovarianceIsPositiveDefinite) {
  const Reference& reference = eight();
  const auto p = static_cast<Eigen::Index>(reference.parameters.size() + reference.map_sd.size());
  ASSERT_EQ(static_cast<std::size_t>(p * p), reference.covariance.size());
  const Eigen::MatrixXd covariance = Eigen::Map<const Eigen::MatrixXd>(reference.covariance.data(), p, p);
  EXPECT_GT(covariance.ldlt().vectorD().minCoeff(), 0);
  EXPECT_LT((covariance - covariance.transpose()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(LearnReference, TheWholeDelayVariesByNoMoreThanItDoes) {
  // A spool that is 10 % slower has 1.5 ms more of delay, which these valves make up for elsewhere.
  std::vector<ValveRecordings> valves;
  for (int i = 0; i < 6; ++i) {
    test::MadeValve valve;
    ValveDynamics& spool = valve.parameters.spool;
    const double whole_s = spool.delay_s + 2 * spool.damping_ratio / spool.natural_frequency_rad_s;
    spool.natural_frequency_rad_s *= std::exp(0.1 * (i - 2.5) / 1.87);
    spool.delay_s = whole_s - 2 * spool.damping_ratio / spool.natural_frequency_rad_s;
    const std::string serial = "V" + std::to_string(i);
    valves.push_back({serial, test::session(valve, kNoise_psi, 70 + 10u * static_cast<unsigned>(i))});
  }
  const auto reference = learn_reference(valves, "type-1");
  ASSERT_TRUE(reference);
  const auto p = static_cast<Eigen::Index>(reference->parameters.size() + reference->map_sd.size());
  const Eigen::MatrixXd covariance = Eigen::Map<const Eigen::MatrixXd>(reference->covariance.data(), p, p);
  Eigen::VectorXd whole = Eigen::VectorXd::Zero(p);
  whole.head(3) << -0.015, 0.015, 1;
  EXPECT_LT(std::sqrt(whole.dot(covariance * whole)), 0.0005);
  EXPECT_GT(reference->parameters[0].sd, 0.05);
}

TEST(LearnReference, PointsOutABadValveAmongTheGoodAndLeavesItOut) {
  auto valves = population(8, 5);
  test::MadeValve slow;
  slow.parameters.volume.time_constant_s *= 6;
  valves[3] = {"BAD", test::session(slow, kNoise_psi, 999)};
  const auto reference = learn_reference(valves, "type-1");
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->valves, 7);
  for (const ReferenceMember& member : reference->members)
    EXPECT_EQ(member.used, member.serial != "BAD") << member.serial;
}

TEST(LearnReference, KeepsEveryValveOfAGoodPopulation) {
  for (const unsigned seed : {5u, 6u, 7u}) EXPECT_EQ(learn_reference(population(6, seed), "type-1")->valves, 6) << seed;
}

TEST(LearnReference, KeepsEveryValveWhereTheSamplingHoldsAParameterOfMost) {
  // Spools at a ringing faster than samples 5 ms apart show: their frequency ends at its bound, 2 over a period, but
  // for one that is just slow enough to be seen.
  std::vector<ValveRecordings> valves;
  for (unsigned i = 0; i < 8; ++i) {
    test::MadeValve valve;
    valve.parameters.spool.natural_frequency_rad_s = i == 2 ? 330 : 900;
    valve.parameters.spool.damping_ratio = 0.7;
    valve.parameters.volume.time_constant_s *= 1 + 0.01 * i;
    valves.push_back({"V" + std::to_string(i), test::session(valve, kNoise_psi, 300 + 10 * i)});
  }
  const auto reference = learn_reference(valves, "type-1");
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->valves, 8);
  for (const ReferenceMember& member : reference->members) EXPECT_LT(member.distance, 20) << member.serial;
}

TEST(LearnReference, OfATenthOfTheCurrentsIsTheSameReference) {
  const auto large = learn_reference(population(4, 5, 0.5), "type-1");
  const auto small = learn_reference(population(4, 5, 0.05), "type-1");
  ASSERT_TRUE(large && small);
  EXPECT_EQ(small->valves, large->valves);
  EXPECT_NEAR(10 * small->model.loop->reach, large->model.loop->reach, 1e-9);
  ASSERT_EQ(small->map_sd.size(), large->map_sd.size());
  // Both descents end where a step gains a ten-millionth of the cost: far inside the spread between valves.
  const auto near = [](double value, double expected, double sd) { EXPECT_NEAR(value, expected, 0.02 * sd); };
  for (std::size_t j = 0; j < large->parameters.size(); ++j) {
    const PopulationParameter &there = large->parameters[j], &here = small->parameters[j];
    const double unit = there.unit == "A" ? 10 : 1;
    SCOPED_TRACE(there.name);
    near(unit * here.mean, there.mean, there.sd);
    EXPECT_NEAR(unit * here.sd / there.sd, 1, 0.05);
  }
  for (std::size_t k = 0; k < large->map_sd.size(); ++k) {
    near(small->model.map->output[k], large->model.map->output[k], large->map_sd[k]);
    EXPECT_NEAR(10 * small->model.map->input[k], large->model.map->input[k], 1e-9);
  }
  ASSERT_EQ(small->levels.size(), 3u);
  EXPECT_NEAR(small->levels[0].level_a, 0.07, 1e-9);
  EXPECT_NEAR(small->levels[0].rise_time_mean_s, large->levels[0].rise_time_mean_s, 1e-9);
}

TEST(LearnReference, FindsTheShapeOfTheLoopThatGoodValvesShare) {
  std::vector<ValveRecordings> valves;
  for (unsigned i = 0; i < 3; ++i) {
    test::MadeValve valve;
    valve.parameters.loop_width_a = 0.02 + 0.002 * i;
    valve.usual.loop_shares = {0, 0.1, 0.3, 0.6};
    valves.push_back({"V" + std::to_string(i), test::session(valve, kNoise_psi, 40 + 10 * i)});
  }
  const auto reference = learn_reference(valves, "type-1");
  ASSERT_TRUE(reference);
  const MagneticLoop::Shares shares = usual_mechanisms(reference->model).loop_shares;
  EXPECT_NEAR(shares[1], 0.1, 0.07);
  EXPECT_NEAR(shares[2], 0.3, 0.1);
  EXPECT_NEAR(shares[3], 0.6, 0.1);
}

/// Three good valves with so much air in the fluid.
std::vector<ValveRecordings> airy_valves(double air_share) {
  std::vector<ValveRecordings> valves;
  for (unsigned i = 0; i < 3; ++i) {
    test::MadeValve valve;
    valve.parameters.volume.time_constant_s *= 1 + 0.02 * i;
    valve.parameters.volume.air_share = air_share;
    valves.push_back({"V" + std::to_string(i), test::session(valve, kNoise_psi, 40 + 10 * i)});
  }
  return valves;
}

TEST(LearnReference, FindsTheAirInTheFluidThatGoodValvesShare) {
  const auto reference = learn_reference(airy_valves(0.03), "type-1");
  ASSERT_TRUE(reference);
  EXPECT_NEAR(usual_mechanisms(reference->model).air_share, 0.03, 0.006);
}

TEST(LearnReference, FindsThatCommandsAreHeldBetweenTheirSamples) {
  EXPECT_EQ(eight().model.input_between, InputBetween::kStraight);
  std::vector<ValveRecordings> good;
  for (unsigned i = 0; i < 3; ++i) {
    test::MadeValve valve{.scale = 1 + 0.01 * i};
    valve.usual.input_between = InputBetween::kHeld;
    good.push_back({"GOOD-" + std::to_string(i + 1), test::session(valve, kNoise_psi, 700 + 10 * i)});
    good.back().recordings.push_back(test::sweep(valve, kNoise_psi, 705 + 10 * i));
  }
  const auto reference = learn_reference(good, "type-1");
  ASSERT_TRUE(reference.has_value()) << reference.error().message;
  EXPECT_EQ(reference->model.input_between, InputBetween::kHeld);
  EXPECT_NEAR(reference->parameters[2].mean, 0.0072, 0.0003);
  EXPECT_NEAR(reference->noise_floor, kNoise_psi, 0.03 * kNoise_psi);
}

TEST(LearnReference, FindsThatTheDynamicsOfGoodValvesFollowTheirMap) {
  EXPECT_EQ(usual_mechanisms(eight().model).prompt_spool_rad_s, 0);
  std::vector<ValveRecordings> good;
  for (unsigned i = 0; i < 3; ++i) {
    test::MadeValve valve = test::with_a_mode({40 * (1 + 0.02 * i), 0.6});
    good.push_back({"GOOD-" + std::to_string(i + 1), test::session(valve, kNoise_psi, 700 + 10 * i)});
  }
  const auto reference = learn_reference(good, "type-1");
  ASSERT_TRUE(reference.has_value()) << reference.error().message;
  EXPECT_GT(usual_mechanisms(reference->model).prompt_spool_rad_s, 0);
  EXPECT_NEAR(std::exp(reference->parameters[0].mean), 40 * 1.02, 1);
  EXPECT_NEAR(std::exp(reference->parameters[1].mean), 0.6, 0.03);
  for (const auto& member : reference->members) EXPECT_NEAR(member.rmse, kNoise_psi, 0.04 * kNoise_psi);
}

TEST(LearnReference, FindsNoAirWhereThereIsNone) {
  const auto reference = learn_reference(airy_valves(0), "type-1");
  ASSERT_TRUE(reference);
  EXPECT_EQ(usual_mechanisms(reference->model).air_share, 0);
}

TEST(LearnReference, TakesNoValveForTwo) {
  std::vector<ValveRecordings> valves = population(3, 7);
  valves.push_back(valves[1]);
  const auto reference = learn_reference(valves, "type-1");
  ASSERT_FALSE(reference);
  EXPECT_EQ(reference.error().code, "repeated_valve");
  EXPECT_NE(reference.error().message.find("GOOD-2"), std::string::npos) << reference.error().message;
}

TEST(LearnReference, NeedsThreeValves) {
  const auto two = learn_reference(population(2, 5), "type-1");
  ASSERT_FALSE(two);
  EXPECT_EQ(two.error().code, "too_few_valves");
  EXPECT_TRUE(learn_reference(population(3, 5), "type-1"));
}

}  // namespace
}  // namespace valvetriage
