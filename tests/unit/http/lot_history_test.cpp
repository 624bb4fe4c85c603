#include "server/http/lot_history.h"

#include <gtest/gtest.h>

namespace valvetriage::http {
namespace {

SubmissionRow row(const std::string& id, std::optional<std::string> serial, double error,
                  JobState state = JobState::kDone) {
  SubmissionRow row;
  row.id = id;
  row.state = state;
  row.labels.serial = std::move(serial);
  row.summary.errors = {{.level_a = 1.4, .error_eq20 = error}};
  return row;
}

TEST(ControlLimits, AreThreeSigmaOfTheMovingRange) {
  const auto limits = control_limits({10, 12, 11, 13}, 0);
  ASSERT_TRUE(limits);
  EXPECT_DOUBLE_EQ(limits->centre, 11.5);
  EXPECT_NEAR(limits->upper - limits->centre, 3 * (5.0 / 3) / 1.128, 1e-12);  // ranges 2, 1, 2
  EXPECT_FALSE(control_limits({10}, 0));
}

TEST(ControlLimits, NeverGoBelowTheLeastValueThereCanBe) {
  EXPECT_EQ(control_limits({1, 9, 1, 9}, 0)->lower, 0);
  EXPECT_LT(control_limits({1, 9, 1, 9}, -100)->lower, 0);
}

TEST(LotHistory, CountsEachValveOnceByItsNewestResultOldestFirst) {
  const LotHistory history =
      lot_history({row("sub_5", "A", 5), row("sub_4", "C", 4, JobState::kFailed), row("sub_3", "B", 3),
                   row("sub_2", std::nullopt, 2), row("sub_1", "A", 1), row("sub_0", std::nullopt, 0)});
  std::vector<std::string> ids;
  for (const SubmissionRow& valve : history.valves) ids.push_back(valve.id);
  EXPECT_EQ(ids, (std::vector<std::string>{"sub_0", "sub_2", "sub_3", "sub_5"}));
  ASSERT_EQ(history.levels.size(), 1u);
  EXPECT_EQ(history.levels.at(1.4).values, (std::vector<double>{0, 2, 3, 5}));
  EXPECT_EQ(history.levels.at(1.4).valves, (std::vector<std::size_t>{0, 1, 2, 3}));
}

TEST(LotHistory, ListsTheFeaturesOfTheValvesThatWereSwept) {
  std::vector<SubmissionRow> rows{row("sub_3", "C", 1), row("sub_2", "B", 1), row("sub_1", "A", 1)};
  rows[0].summary.features = {{"rolloff_db_per_decade", -26}, {"bandwidth_hz", 2.5}};
  rows[2].summary.features = {{"rolloff_db_per_decade", -24}};
  const LotHistory history = lot_history(rows);
  EXPECT_EQ(history.features.at("rolloff_db_per_decade").values, (std::vector<double>{-24, -26}));
  EXPECT_EQ(history.features.at("rolloff_db_per_decade").valves, (std::vector<std::size_t>{0, 2}));
  EXPECT_LT(history.features.at("rolloff_db_per_decade").limits->lower, -26);
  EXPECT_FALSE(history.features.at("bandwidth_hz").limits);
}

TEST(LotHistory, TakesLevelsAFewMilliamperesApartAsOne) {
  std::vector<SubmissionRow> rows{row("sub_3", "C", 3), row("sub_2", "B", 2), row("sub_1", "A", 1)};
  rows[1].summary.errors[0].level_a = 1.41;
  rows[2].summary.errors.push_back({.level_a = 1.6, .error_eq20 = 7});
  const LotHistory history = lot_history(rows);
  ASSERT_EQ(history.levels.size(), 2u);
  EXPECT_EQ(history.levels.begin()->first, 1.4);
  EXPECT_EQ(history.levels.begin()->second.values, (std::vector<double>{1, 2, 3}));
  EXPECT_EQ(history.valves[1].summary.errors[0].level_a, 1.4);
}

SubmissionRow named(const std::string& stand, const std::string& cause, const std::string& conclusion = "named") {
  SubmissionRow valve = row("sub_" + stand + cause, std::nullopt, 1);
  valve.labels.stand = stand;
  valve.summary.conclusion = conclusion;
  if (!cause.empty()) valve.summary.causes = {{.cause = cause, .probability = 0.98, .settled = conclusion == "named"}};
  return valve;
}

/// A valve with a further settled cause.
SubmissionRow with(SubmissionRow valve, const std::string& cause, double probability = 0.96) {
  valve.summary.causes.push_back({.cause = cause, .probability = probability, .settled = true});
  return valve;
}

TEST(StandAlarms, TellConsecutiveValvesOfAStandThatShareAStandCause) {
  const auto alarms = stand_alarms({named("s1", "sensor_offset"), named("s2", "friction"), named("s1", "sensor_offset"),
                                    named("s1", "friction"), named("s2", "sensor_drift"), named("s2", "sensor_drift")});
  ASSERT_EQ(alarms.size(), 2u);
  EXPECT_EQ(alarms[0].stand, "s2");
  EXPECT_EQ(alarms[0].cause, "sensor_drift");
  EXPECT_EQ(alarms[0].valves, (std::vector<std::size_t>{4, 5}));
  EXPECT_TRUE(alarms[0].current);
  EXPECT_EQ(alarms[1].valves, (std::vector<std::size_t>{0, 2}));
  EXPECT_FALSE(alarms[1].current) << "a valve without it came since";
}

TEST(StandAlarms, AreNoneForOneValveForCausesOfValvesAndForNamesThatAreNotSettled) {
  EXPECT_TRUE(stand_alarms({named("s1", "sensor_offset"), named("s2", "sensor_offset")}).empty());
  EXPECT_TRUE(stand_alarms({named("s1", "friction"), named("s1", "friction")}).empty());
  EXPECT_TRUE(stand_alarms({named("s1", "sensor_offset"), named("s1", "sensor_offset", "ambiguous")}).empty());
  EXPECT_TRUE(stand_alarms({named("s1", "sensor_offset"), named("s1", ""), named("s1", "sensor_offset")}).empty());
}

TEST(StandAlarms, GoByEverySettledCauseOfAValveNotItsStrongestAlone) {
  const auto alarms = stand_alarms({with(named("s1", "friction"), "sensor_offset"), named("s1", "sensor_offset"),
                                    with(named("s1", "sensor_offset"), "sensor_drift"), named("s1", "sensor_drift")});
  ASSERT_EQ(alarms.size(), 2u);
  EXPECT_EQ(alarms[0].cause, "sensor_drift");
  EXPECT_EQ(alarms[0].valves, (std::vector<std::size_t>{2, 3}));
  EXPECT_TRUE(alarms[0].current);
  EXPECT_EQ(alarms[1].cause, "sensor_offset");
  EXPECT_EQ(alarms[1].valves, (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_FALSE(alarms[1].current);
}

TEST(Outcomes, AreTheSettledCausesOfAValveElseItsConclusion) {
  EXPECT_EQ(outcomes(with(named("s1", "friction"), "leakage")), (std::vector<std::string>{"friction", "leakage"}));
  EXPECT_EQ(outcomes(named("s1", "friction", "ambiguous")), std::vector<std::string>{"ambiguous"});
  EXPECT_EQ(outcomes(row("sub_1", "A", 1)), std::vector<std::string>{""});
}

TEST(NameQValues, StandBesideEverySettledCauseOfEveryValve) {
  const auto q = name_q_values(
      {with(named("s1", "friction"), "leakage"), named("s1", "", "none"), named("s1", "friction", "ambiguous")});
  ASSERT_EQ(q.size(), 3u);
  ASSERT_EQ(q[0].size(), 2u);
  EXPECT_NEAR(q[0][0], 0.02, 1e-12);
  EXPECT_NEAR(q[0][1], (0.02 + 0.04) / 2, 1e-12);
  EXPECT_TRUE(q[1].empty());
  EXPECT_TRUE(q[2].empty());
}

}  // namespace
}  // namespace valvetriage::http
