#include "core/discrepancy/advise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <sstream>

#include "core/model/valve_dynamics.h"

namespace valvetriage {
namespace {

Model valve() {
  Model model;
  model.kind = "valve";
  model.input_unit = "A";
  model.output_unit = "psi";
  model.loop = MagneticLoop{.width_a = 0.004};
  model.dynamics = to_transfer_function({.delay_s = 0.004, .natural_frequency_rad_s = 200, .damping_ratio = 0.8});
  model.map = StaticMap{.input = {1.0, 1.2, 1.4, 1.6, 1.8, 2.0}, .output = {0.84, 3.1, 26, 120, 160, 210}};
  model.volume = OrificeVolume{.time_constant_s = 0.06, .exponent = 0.55, .supply_psi = 300, .reference_psi = 105};
  return model;
}

/// sd  of the law's parameters; empty: nothing is known of how far the model is open
Alternative alternative(const std::string& cause, const std::vector<double>& parameters, double probability,
                        const std::vector<double>& sd = {}) {
  Alternative a{.cause = cause, .probability = probability, .model = valve(), .moved = {}};
  if (cause != "none") a.model.mechanisms.push_back({cause, parameters, ""});
  for (std::size_t j = 0; j < sd.size(); ++j) {
    a.moved.push_back(a.model);
    a.moved.back().mechanisms.back().parameters[j] += sd[j];
  }
  return a;
}

const AdviceOptions kStand{.noise_rms = 0.35, .input_low = 1.0, .input_high = 2.0};

TEST(Advise, ALoopAndALagAreToldApartByAnotherRate) {
  const std::vector<Alternative> open{alternative("hysteresis", {0.02, 0.06, 0}, 0.5, {0.002, 0, 0}),
                                      alternative("extra_lag", {0.05, 0}, 0.5, {0.01, 0})};
  const auto next = advise_next_test(open, kStand);
  ASSERT_TRUE(next.has_value());
  EXPECT_GT(next->expected_probability, 0.95);
  EXPECT_EQ(next->separates, (std::vector<std::string>{"extra_lag", "hysteresis"}));
  EXPECT_NE(next->why.find("times the noise"), std::string::npos);
}

TEST(Advise, TheInputIsReadyForTheStand) {
  const std::vector<Alternative> open{alternative("friction", {0.02, 0.01, 0.3, 0}, 0.6),
                                      alternative("leakage", {0.05}, 0.4)};
  const auto next = advise_next_test(open, kStand);
  ASSERT_TRUE(next.has_value());
  EXPECT_EQ(next->input_csv.substr(0, 17), "time_s,current_A\n");
  EXPECT_NE(next->test.find(" A"), std::string::npos) << next->test;  // its levels carry their unit
  EXPECT_GT(std::count(next->input_csv.begin(), next->input_csv.end(), '\n'), 200);
}

TEST(Advise, ADeadBandThatLiesHighIsLookedForWhereItIs) {
  const std::vector<Alternative> open{alternative("dead_band", {1.9, 0.03}, 0.5), alternative("none", {}, 0.5)};
  const auto next = advise_next_test(open, kStand);
  ASSERT_TRUE(next.has_value());
  EXPECT_GT(next->expected_probability, 0.9);
  EXPECT_NE(next->test.find("to 2 A"), std::string::npos) << next->test;  // a test that reaches the top of the range
}

TEST(Advise, WhatNoTestCanTellIsNotAskedFor) {
  const std::vector<Alternative> same{alternative("sensor_offset", {2}, 0.5), alternative("none", {}, 0.5)};
  EXPECT_FALSE(advise_next_test(same, kStand).has_value());  // an offset is the baseline's own freedom
}

TEST(Advise, NoAlternativeNoTest) {
  EXPECT_FALSE(advise_next_test({}, kStand).has_value());
  const std::vector<Alternative> one{alternative("leakage", {0.05}, 1)};
  EXPECT_FALSE(advise_next_test(one, kStand).has_value());
}

TEST(Advise, MoreNoiseTellsLess) {
  const std::vector<Alternative> open{alternative("backlash", {0.0025, 0, 0}, 0.5),
                                      alternative("friction", {0.0025, 0.001, 0.3, 0}, 0.5)};
  AdviceOptions loud = kStand;
  loud.noise_rms = 25;
  const auto quiet = advise_next_test(open, kStand), drowned = advise_next_test(open, loud);
  ASSERT_TRUE(quiet.has_value());
  EXPECT_GT(quiet->expected_probability, (drowned ? drowned->expected_probability : 0) + 0.1);
}

TEST(Advise, AParameterThatMayStillMoveTellsLessThanAKnownOne) {
  const std::vector<Alternative> known{alternative("leakage", {0.01}, 0.5, {0.0}),
                                       alternative("orifice_flow", {0.004}, 0.5, {0.0})};
  const std::vector<Alternative> loose{alternative("leakage", {0.01}, 0.5, {0.05}),
                                       alternative("orifice_flow", {0.004}, 0.5, {0.05})};
  const auto sure = advise_next_test(known, kStand), unsure = advise_next_test(loose, kStand);
  ASSERT_TRUE(sure);
  EXPECT_LT(unsure ? unsure->expected_probability : 0, sure->expected_probability - 0.1);
}

TEST(Advise, AMapThatMayStillBendTellsLessOfAnEffectThatBendsIt) {
  std::vector<Alternative> open{alternative("static_curve", {0.004}, 0.5, {0.0005}),
                                alternative("gain_loss", {0.998}, 0.5, {0.0005})};
  const auto firm = advise_next_test(open, kStand);
  for (Alternative& a : open) {
    for (std::size_t k = 1; k < 6; ++k) {
      a.moved.push_back(a.model);
      a.moved.back().map->output[k] += 0.5;
    }
  }
  const auto soft = advise_next_test(open, kStand);
  ASSERT_TRUE(firm);
  EXPECT_LT(soft ? soft->expected_probability : 0, firm->expected_probability - 0.1);
}

TEST(Advise, WhereNoTestSettlesAllTheOneThatBeatsARivalIsAskedFor) {
  std::vector<Alternative> open{alternative("gain_loss", {0.998}, 0.49, {0.01}),
                                alternative("gain_loss", {0.999}, 0.49, {0.01}),
                                alternative("extra_lag", {0.02, 0}, 0.02, {0.0})};
  const auto next = advise_next_test(open, kStand);
  ASSERT_TRUE(next);
  EXPECT_NEAR(next->expected_probability, 0.02, 0.005);  // that of the one whose rivals are both beaten
  open.pop_back();
  EXPECT_FALSE(advise_next_test(open, kStand));
}

TEST(Advise, TheChanceToSettleIsThatOfBeatingEveryRival) {
  const double sizes[] = {0.002, 0.0022, 0.0024};
  const auto with_width = [](double width) { return alternative("hysteresis", {width, 0.06, 0}, 0.3, {1e-6, 0, 0}); };
  const std::vector<double> input = [] {
    std::vector<double> triangle(2000);
    for (std::size_t i = 0; i < triangle.size(); ++i) {
      triangle[i] = 1 + static_cast<double>(i < 1000 ? i : 2000 - i) / 1000;
    }
    return triangle;
  }();
  const auto chance = [&](const std::vector<Alternative>& open) { return chance_to_settle(open, input, kStand); };
  const std::vector<Alternative> open{with_width(sizes[0]), with_width(sizes[1]), with_width(sizes[2])};
  const double ab = chance({open[0], open[1]}), ac = chance({open[0], open[2]}), bc = chance({open[1], open[2]});
  EXPECT_GT(ab, 0.01);
  EXPECT_LT(ab, 0.9);
  EXPECT_NEAR(chance(open), (ab * ac + ab * bc + ac * bc) / 3, 1e-6);
}

std::vector<double> currents_in(const std::string& csv) {
  std::vector<double> currents;
  std::istringstream lines(csv);
  std::string line;
  for (std::getline(lines, line); std::getline(lines, line);)
    currents.push_back(std::stod(line.substr(line.find(',') + 1)));
  return currents;
}

TEST(Advise, TheShortestThatSettlesEverythingIsAskedFor) {
  const std::vector<Alternative> open{alternative("gain_loss", {0.7}, 0.5, {0.001}),
                                      alternative("hysteresis", {0.2, 0.06, 0}, 0.5, {0.001, 0, 0})};
  const auto next = advise_next_test(open, kStand);
  ASSERT_TRUE(next);
  EXPECT_GT(next->expected_probability, 0.999);
  EXPECT_EQ(next->test, "triangle from 1 to 2 A and back in 3 s");
  EXPECT_NE(next->why.find("no longer test settles more"), std::string::npos) << next->why;
}

TEST(Advise, ASecondTestFollowsInTheSameRecordingWhereOneAloneMayLeaveTheQuestionOpen) {
  const std::vector<Alternative> open{alternative("backlash", {0.0025, 0, 0}, 0.5),
                                      alternative("friction", {0.0025, 0.001, 0.3, 0}, 0.5)};
  const auto quiet = advise_next_test(open, kStand);
  ASSERT_TRUE(quiet);
  EXPECT_EQ(quiet->test.find(", then "), std::string::npos) << quiet->test;
  AdviceOptions loud = kStand;
  loud.noise_rms = 8;
  const auto both = advise_next_test(open, loud);
  ASSERT_TRUE(both);
  EXPECT_NE(both->test.find(", then "), std::string::npos) << both->test;
  const std::string alone = "its first part alone settles with probability ";
  const auto at = both->why.find(alone);
  ASSERT_NE(at, std::string::npos) << both->why;
  EXPECT_LT(std::stod(both->why.substr(at + alone.size())), both->expected_probability - 0.09);
  // What is stated is of the two as they are played, one after the other.
  EXPECT_NEAR(chance_to_settle(open, currents_in(both->input_csv), loud), both->expected_probability, 0.02);
}

TEST(Advise, TellsHowMuchOfACauseATestShows) {
  const std::vector<Alternative> open{alternative("extra_lag", {0.02, 0}, 0.5, {1e-4, 0}),
                                      alternative("extra_lag", {0.03, 0}, 0.5, {1e-4, 0})};
  std::vector<double> removed;
  AdviceOptions options = kStand;
  options.settling = [&](const Alternative&, const Alternative&, const PlayedTest& test) {
    removed.push_back(test.removed);
    return Settling{};
  };
  const std::vector<double> step = [] {
    std::vector<double> current(400, 1.2);
    std::fill(current.begin() + 100, current.end(), 1.6);
    return current;
  }();
  chance_to_settle(open, step, options);
  ASSERT_EQ(removed.size(), 2u);
  EXPECT_EQ(removed[0], 0);
  EXPECT_EQ(removed[1], 0);
  options.nothing = alternative("none", {}, 0);
  options.nothing->moved.push_back(options.nothing->model);
  chance_to_settle(open, step, options);
  ASSERT_EQ(removed.size(), 4u);
  EXPECT_GT(removed[2], 100);
  EXPECT_GT(removed[3], 1.5 * removed[2]);  // of the larger lag more
}

TEST(Advise, IsTheSameEveryTime) {
  const std::vector<Alternative> open{alternative("backlash", {0.01, 0, 0}, 0.5),
                                      alternative("friction", {0.01, 0.006, 0.3, 0}, 0.5)};
  const auto a = advise_next_test(open, kStand), b = advise_next_test(open, kStand);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->why, b->why);
  EXPECT_EQ(a->input_csv, b->input_csv);
}

TEST(Advise, WhatIsAskedForBesideThePosteriorMakesATestSettleLess) {
  const std::vector<Alternative> open{alternative("gain_loss", {0.998}, 0.5), alternative("none", {}, 0.5)};
  const auto chance = [&](double least_log_odds) {
    AdviceOptions options = kStand;
    options.settling = [=](const Alternative&, const Alternative&, const PlayedTest&) {
      return Settling{.least_log_odds = least_log_odds};
    };
    const auto next = advise_next_test(open, options);
    return next ? next->expected_probability : 0;
  };
  EXPECT_EQ(chance(1), chance(0));  // a posterior of 0.95 asks for 2.9 nats itself
  EXPECT_LT(chance(100), chance(0) - 0.1);
}

TEST(Advise, PromisesLessWhereWhatACauseGetsWrongIsLoudAlongTheDifference) {
  const std::vector<Alternative> open{alternative("gain_loss", {0.998}, 0.5), alternative("none", {}, 0.5)};
  const auto chance = [&](double noise_along) {
    AdviceOptions options = kStand;
    options.settling = [=](const Alternative&, const Alternative&, const PlayedTest&) {
      return Settling{.noise_along = noise_along};
    };
    const auto next = advise_next_test(open, options);
    return next ? next->expected_probability : 0;
  };
  EXPECT_GT(chance(1), 0.9);
  EXPECT_LT(chance(25), chance(4));
  EXPECT_LT(chance(4), chance(1));
}

TEST(Advise, TellsHowFarApartTheTwoAreOnATest) {
  std::vector<double> distances;
  AdviceOptions options = kStand;
  options.settling = [&](const Alternative&, const Alternative&, const PlayedTest& test) {
    distances.push_back(test.distance);
    return Settling{};
  };
  std::vector<double> step(400, 1.2);
  std::fill(step.begin() + 100, step.end(), 1.6);
  const std::vector<Alternative> open{alternative("extra_lag", {0.02, 0}, 0.5, {1e-4, 0}),
                                      alternative("extra_lag", {0.021, 0}, 0.5, {1e-4, 0})};
  chance_to_settle(open, step, options);
  const std::vector<Alternative> farther{open[0], alternative("extra_lag", {0.022, 0}, 0.5, {1e-4, 0})};
  chance_to_settle(farther, step, options);
  ASSERT_EQ(distances.size(), 4u);
  EXPECT_EQ(distances[0], distances[1]);
  EXPECT_NEAR(distances[2] / distances[0], 2, 0.2);
}

TEST(Advise, PromisesNothingForACauseWhoseRivalNoLeadSettles) {
  const std::vector<Alternative> open{alternative("gain_loss", {0.95}, 0.25), alternative("none", {}, 0.75)};
  const auto chance = [&](bool is_asked) {
    AdviceOptions options = kStand;
    if (is_asked) {
      options.settling = [](const Alternative& true_one, const Alternative&, const PlayedTest&) {
        const bool is_none = true_one.cause == "none";
        return Settling{.least_log_odds = is_none ? std::numeric_limits<double>::infinity() : 0.0};
      };
    }
    return advise_next_test(open, options)->expected_probability;
  };
  EXPECT_GT(chance(false), 0.95);
  EXPECT_NEAR(chance(true), 0.25, 0.01);
}

}  // namespace
}  // namespace valvetriage
