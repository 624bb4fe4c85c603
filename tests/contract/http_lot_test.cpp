#include <gtest/gtest.h>

#include <cctype>
#include <set>
#include <sstream>

#include "server/http/limits.h"
#include "server/http/request_head.h"
#include "server/http/stored_patterns.h"
#include "tests/contract/http_fixture.h"

namespace valvetriage {
namespace {

/// Adds 20 psi to forty rows of a recording from row `at` on; none where it is negative.
std::string with_bump(const std::string& csv, int at) {
  std::istringstream in(csv);
  std::string out, line;
  for (int row = -1; std::getline(in, line);) {
    const bool data = !line.empty() && (std::isdigit(line[0]) != 0);
    if (data && ++row >= at && at >= 0 && row < at + 40) {
      const auto comma = line.rfind(',');
      line = line.substr(0, comma + 1) + std::to_string(std::stod(line.substr(comma + 1)) + 20);
    }
    out += line + "\n";
  }
  return out;
}

/// A lot whose valves are concluded on as their complaints say; the stored recordings are those of good_csv.
class HttpLot : public ::testing::Test {
 protected:
  void send(const std::string& serial, const std::string& complaint, const std::string& stand = "stand-1",
            const std::string& lot = "lot-1", int bump_at = -1) {
    const std::string head = "# complaint: " + complaint + "\n# stand: " + stand + "\n";
    const std::string csv = head + with_bump(good_csv(serial, lot), bump_at);
    const Json row = server_.await(server_.post("/v1/recordings?name=steps.csv", csv).header("Location"));
    EXPECT_EQ(row["state"], "done") << row.dump();
  }
  Json get(const std::string& target) const {
    const RawAnswer answer = server_.get(target);
    EXPECT_EQ(answer.status, 200) << answer.body;
    return json_of(answer);
  }

  TestServer server_{{.tokens_required = false, .workers = 1, .limits = {}}};
};

TEST_F(HttpLot, GivesTheParametersOfEachNamedCauseOverItsValves) {
  send("EFC-1", "named friction");
  send("EFC-2", "named friction");
  send("EFC-3", "named backlash");
  send("EFC-4", "unexplained");
  const Json answer = get("/v1/lots/lot-1/parameters");
  EXPECT_EQ(answer["named"], 3);
  EXPECT_EQ(answer["read"], 3);
  ASSERT_EQ(answer["items"].size(), 2u);
  const Json& friction = answer["items"][0];
  EXPECT_EQ(friction["cause"], "friction");
  EXPECT_EQ(friction["valves"], 2);
  ASSERT_EQ(friction["parameters"].size(), 1u);
  EXPECT_EQ(friction["parameters"][0]["name"], "breakaway_A");
  ASSERT_EQ(friction["parameters"][0]["values"].size(), 2u);
  EXPECT_EQ(friction["parameters"][0]["values"][0]["value"], 0.02);
}

TEST_F(HttpLot, ListsTheFeaturesOfFrequencyResponsesWithTheirControlLimits) {
  send("EFC-1", "named friction");
  send("EFC-2", "named friction");
  const Json history = get("/v1/lots/lot-1/history");
  EXPECT_EQ(history["valves"][0]["features"]["bandwidth_hz"], 2.25);
  ASSERT_EQ(history["features"].size(), 1u);
  EXPECT_EQ(history["features"][0]["name"], "bandwidth_hz");
  EXPECT_EQ(history["features"][0]["valves"], 2);
  EXPECT_EQ(history["features"][0]["centre"], 2.25);
}

TEST_F(HttpLot, RaisesAnAlarmWhereValvesInARowShareACauseOfTheStand) {
  send("EFC-1", "named sensor_offset", "stand-3");
  send("EFC-2", "named friction", "stand-1");
  send("EFC-3", "named sensor_offset", "stand-3", "lot-2");
  const Json stands = get("/v1/stands")["items"];
  ASSERT_EQ(stands.size(), 2u);
  EXPECT_TRUE(stands[0]["alarms"].empty());
  ASSERT_EQ(stands[1]["alarms"].size(), 1u);
  EXPECT_EQ(stands[1]["alarms"][0]["cause"], "sensor_offset");
  EXPECT_EQ(stands[1]["alarms"][0]["current"], true);
  EXPECT_EQ(stands[1]["alarms"][0]["valves"][1]["serial"], "EFC-3");
  EXPECT_TRUE(get("/v1/lots/lot-1/history")["alarms"].empty()) << "one valve of this lot";
  EXPECT_EQ(get("/v1/lots/lot-1/history")["valves"][0]["stand"], "stand-3");
}

TEST_F(HttpLot, CountsEverySettledCauseOfAValveAndTellsItsQValue) {
  send("EFC-1", "named friction sensor_offset", "stand-3");
  send("EFC-2", "named sensor_offset", "stand-3");
  EXPECT_EQ(get("/v1/lots/lot-1")["causes"], (Json{{"friction", 1}, {"sensor_offset", 2}}));
  const Json history = get("/v1/lots/lot-1/history");
  ASSERT_EQ(history["valves"][0]["causes"].size(), 2u);
  EXPECT_EQ(history["valves"][0]["causes"][1]["cause"], "sensor_offset");
  EXPECT_NEAR(history["valves"][0]["causes"][1]["q_value"].get<double>(), 0.02, 1e-12);
  ASSERT_EQ(history["alarms"].size(), 1u) << "the offset is the first valve's second cause";
  EXPECT_EQ(get("/v1/submissions?cause=sensor_offset")["items"].size(), 2u);
  const Json with_itself = get("/v1/comparison?lot=lot-1&with_stand=stand-3");
  EXPECT_EQ(with_itself["causes"][0]["a"], 1);
  EXPECT_EQ(with_itself["causes"][0]["of_a"], 2) << "valves, not names";
}

TEST_F(HttpLot, SaysWhyItsValvesCannotBeHeldAgainstGoodOnes) {
  for (const char* serial : {"EFC-1", "EFC-2", "EFC-3"}) send(serial, "none");
  const Json shifts = get("/v1/lots/lot-1/shifts");
  EXPECT_TRUE(shifts["items"].empty());
  EXPECT_TRUE(shifts["sentences"].empty());
  EXPECT_EQ(shifts["scope"],
            "No valve of this lot without a settled cause was compared with a stored reference of good valves.");
}

TEST_F(HttpLot, TellsItsHistoryWhateverItsLabelsHold) {
  send("a\"b\\c<img>", "unexplained", "stand \"ü\"");
  send("EFC-2", "named friction");
  const Json valves = get("/v1/lots/lot-1/history")["valves"];
  ASSERT_EQ(valves.size(), 2u);
  EXPECT_EQ(valves[0]["serial"], "a\"b\\c<img>");
  EXPECT_EQ(valves[0]["stand"], "stand \"ü\"");
  EXPECT_EQ(valves[0]["top_cause"], nullptr);
  EXPECT_EQ(valves[1]["top_cause"], "friction");
  EXPECT_EQ(valves[1]["top_cause_probability"], 0.98);
  EXPECT_EQ(valves[1]["errors"], (Json::array({Json{{"level_A", 1.4}, {"error_eq20", 2.5}}})));
}

TEST_F(HttpLot, IsComparedWithAnotherAndWithAStand) {
  send("EFC-1", "named friction");
  send("EFC-2", "named friction");
  send("EFC-3", "named backlash", "stand-3", "lot-2");
  const Json lots = get("/v1/comparison?lot=lot-1&with_lot=lot-2");
  EXPECT_EQ(lots["a"]["valves"], 2);
  EXPECT_EQ(lots["b"]["valves"], 1);
  ASSERT_EQ(lots["causes"].size(), 2u);
  EXPECT_EQ(lots["causes"][1]["name"], "friction");
  EXPECT_EQ(lots["causes"][1]["a"], 2);
  EXPECT_NEAR(lots["causes"][1]["p_value"].get<double>(), 1.0 / 3, 1e-12);
  EXPECT_EQ(lots["levels"][0]["p_value"], nullptr);
  EXPECT_EQ(get("/v1/comparison?stand=stand-1&with_stand=stand-3")["b"]["valves"], 1);
  EXPECT_EQ(json_of(server_.get("/v1/comparison?lot=lot-1"))["field"], "with_lot");
}

TEST_F(HttpLot, LaysWhatTeardownFoundBesideWhatWasNamed) {
  send("EFC-1", "named friction");
  send("EFC-2", "named friction");
  send("EFC-3", "unexplained");
  const auto found = [&](const std::string& serial, const std::string& cause) {
    EXPECT_EQ(server_.post("/v1/valves/" + serial + "/findings", R"({"who": "kim", "cause": ")" + cause + "\"}").status,
              201);
  };
  found("EFC-1", "friction");
  found("EFC-1", "friction");
  found("EFC-2", "backlash");
  found("EFC-3", "none");
  found("EFC-4", "leakage");
  const Json table = get("/v1/confusion");
  EXPECT_EQ(table["findings"], 5);
  EXPECT_EQ(table["valves"], 4);
  EXPECT_EQ(table["named"], 2);
  EXPECT_EQ(table["named_right"], 1);
  std::set<std::string> cells;
  for (const Json& cell : table["items"]) {
    cells.insert(cell["named"].get<std::string>() + "/" + cell["found"].get<std::string>() + "/" +
                 cell["valves"].dump());
  }
  EXPECT_EQ(cells, (std::set<std::string>{"friction/backlash/1", "friction/friction/1", "not_analysed/leakage/1",
                                          "unexplained/none/1"}));
}

TEST_F(HttpLot, TakesNoIndexForASizeOfItsCause) {
  send("EFC-1", "named intermittent");
  const Json answer = get("/v1/lots/lot-1/parameters");
  ASSERT_EQ(answer["items"].size(), 1u);
  ASSERT_EQ(answer["items"][0]["parameters"].size(), 1u) << answer.dump();
  EXPECT_EQ(answer["items"][0]["parameters"][0]["name"], "breakaway_A");
}

std::vector<std::string> serials(const Json& valves) {
  std::vector<std::string> all;
  for (const Json& valve : valves) all.push_back(valve["serial"]);
  std::sort(all.begin(), all.end());
  return all;
}

TEST_F(HttpLot, GroupsUnexplainedValvesThatLeaveTheSameResidual) {
  for (const char* serial : {"G-1", "G-2", "G-3"}) send(serial, "none");
  for (const char* serial : {"A-1", "A-2", "A-3"}) send(serial, "unexplained", "stand-1", "lot-1", 180);
  for (const char* serial : {"B-1", "B-2"}) send(serial, "unexplained", "stand-1", "lot-1", 320);
  send("C-1", "unexplained", "stand-1", "lot-1", 20);
  const Json answer = get("/v1/lots/lot-1/patterns");
  EXPECT_EQ(answer["unexplained"], 6);
  EXPECT_EQ(answer["compared"], 6);
  EXPECT_EQ(answer["good_valves"], 3);
  ASSERT_EQ(answer["groups"].size(), 2u) << answer.dump();
  EXPECT_EQ(serials(answer["groups"][0]["members"]), (std::vector<std::string>{"A-1", "A-2", "A-3"}));
  EXPECT_EQ(serials(answer["groups"][1]["members"]), (std::vector<std::string>{"B-1", "B-2"}));
  EXPECT_EQ(serials(answer["alone"]), std::vector<std::string>{"C-1"});
  const Json& residual = answer["groups"][0]["residuals"][0];
  EXPECT_EQ(residual["test"], "step, 2.0 s");
  ASSERT_EQ(residual["mean"].size(), 64u);
  // The bump of 20 psi from sample 180 on: bins of 6.25 samples, so the 31st lies in it. The free run's state is
  // estimated on the bumped record, so a part of it is taken up.
  EXPECT_NEAR(residual["mean"][31].get<double>() - residual["good"][31].get<double>(), 20, 2);
}

TEST_F(HttpLot, ComparesEveryValveThatKeptItsResidualsAndTheNewestFewOfTheOthers) {
  for (const char* serial : {"G-1", "G-2", "G-3"}) send(serial, "none kept");
  send("K-1", "unexplained kept", "stand-1", "lot-1", 180);
  send("K-2", "unexplained kept", "stand-1", "lot-1", 180);
  for (int i = 0; i < 42; ++i) send("OLD-" + std::to_string(i), "unexplained", "stand-1", "lot-1", i < 2 ? 180 : 320);
  const Json answer = get("/v1/lots/lot-1/patterns");
  EXPECT_EQ(answer["unexplained"], 44);
  EXPECT_EQ(answer["compared"], 42);
  ASSERT_EQ(answer["groups"].size(), 2u);
  EXPECT_EQ(answer["groups"][0]["members"].size(), 40u);
  // The two oldest of those that would have to be simulated are left out.
  EXPECT_EQ(serials(answer["groups"][1]["members"]), (std::vector<std::string>{"K-1", "K-2"}));
  // What was kept says the same as what would be simulated.
  EXPECT_NEAR(answer["groups"][1]["members"][0]["typicality"].get<double>(), 1, 0.01);
}

TEST_F(HttpLot, ComparesAsManyUnexplainedValvesAsItSaysAndLeavesTheOldestOut) {
  send("K", "unexplained kept", "stand-1", "lot-1", 180);
  const auto kept = server_.store().list_submissions({.lot = "lot-1"}, {});
  ASSERT_TRUE(kept);
  http::LotHistory history;
  const auto add = [&](const std::string& serial) {  // oldest first, each with the residuals that were kept
    history.valves.push_back(kept->items[0]);
    history.valves.back().labels.serial = serial;
  };
  add("the second oldest");
  while (history.valves.size() < http::kMaxPatternValves) add("another");
  const auto all = http::stored_patterns(server_.service(), history);
  ASSERT_TRUE(all) << all.error().message;
  EXPECT_EQ(all->unexplained, http::kMaxPatternValves);
  EXPECT_EQ(all->compared.size(), http::kMaxPatternValves);
  EXPECT_EQ(all->compared.back()->labels.serial, "the second oldest");
  ASSERT_EQ(all->groups.size(), 1u);
  EXPECT_EQ(all->groups[0].members.size(), http::kMaxPatternValves);

  history.valves.insert(history.valves.begin(), history.valves[0]);
  history.valves[0].labels.serial = "the oldest";
  const auto newest = http::stored_patterns(server_.service(), history);
  ASSERT_TRUE(newest) << newest.error().message;
  EXPECT_EQ(newest->unexplained, http::kMaxPatternValves + 1);
  EXPECT_EQ(newest->compared.size(), http::kMaxPatternValves);
  EXPECT_EQ(newest->compared.back()->labels.serial, "the second oldest");
}

}  // namespace
}  // namespace valvetriage
