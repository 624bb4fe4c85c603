#include <gtest/gtest.h>

#include "server/http/request_head.h"
#include "tests/contract/http_fixture.h"

namespace valvetriage {
namespace {

/// A lot whose valves are concluded on as their complaints say; the stored recordings are those of good_csv.
class HttpLot : public ::testing::Test {
 protected:
  void send(const std::string& serial, const std::string& complaint, const std::string& stand = "stand-1",
            const std::string& lot = "lot-1") {
    const std::string csv = "# complaint: " + complaint + "\n# stand: " + stand + "\n" + good_csv(serial, lot);
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

}  // namespace
}  // namespace valvetriage
