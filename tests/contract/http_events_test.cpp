#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <set>
#include <vector>

#include "tests/contract/http_fixture.h"

namespace valvetriage {
namespace {

std::string next_of(const Json& document) {
  return document.value("next", "");
}

Json events(const TestServer& server, const std::string& after, const std::string& wait_s = "0") {
  return json_of(server.get("/v1/events?after=" + after + "&wait_s=" + wait_s));
}

TEST(Events, WithoutACursorTellWhereToBegin) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});
  EXPECT_EQ(next_of(json_of(server.get("/v1/events"))), "0");
  server.post("/v1/recordings", good_csv("EFC-1"));
  const Json now = json_of(server.get("/v1/events"));
  EXPECT_TRUE(now["items"].empty());
  EXPECT_TRUE(events(server, next_of(now))["items"].empty());
  EXPECT_FALSE(events(server, "0")["items"].empty());
}

TEST(Events, FollowAJobFromItsAcceptanceToItsResult) {
  TestServer server({.tokens_required = false, .workers = 1, .limits = {}});
  const std::string job = json_of(server.post("/v1/recordings", good_csv("EFC-1")))["job_id"];
  std::set<std::string> seen;
  std::string cursor = "0";
  for (int i = 0; i < 600 && !seen.contains("job.done"); ++i) {  // each waits for a change: only a hang gets there
    const Json answer = events(server, cursor, "5");
    for (const Json& event : answer["items"]) {
      if (event["subject"] == job) seen.insert(event["kind"].get<std::string>());
    }
    cursor = next_of(answer);
  }
  EXPECT_TRUE(seen.contains("job.queued"));
  EXPECT_TRUE(seen.contains("job.running"));
  EXPECT_TRUE(seen.contains("job.done"));
}

TEST(Events, AnswerAWaitingRequestAsSoonAsSomethingHappens) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});
  auto waiting = std::async(std::launch::async, [&] { return events(server, "0", "30"); });
  server.post("/v1/recordings", good_csv("EFC-1"));
  EXPECT_FALSE(waiting.get()["items"].empty());
}

TEST(Events, ComeInPagesWithoutLosingOne) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});
  for (const char* serial : {"EFC-1", "EFC-2", "EFC-3"}) server.post("/v1/recordings", good_csv(serial));
  const Json all = events(server, "0")["items"];
  std::string cursor = "0";
  for (const Json& expected : all) {
    const Json one = json_of(server.get("/v1/events?limit=1&after=" + cursor));
    ASSERT_EQ(one["items"].size(), 1u);
    EXPECT_EQ(one["items"][0], expected);
    cursor = next_of(one);
  }
  EXPECT_TRUE(events(server, cursor)["items"].empty());
}

TEST(Events, BoundTheWaitingRequestsAndLeaveTheServerFreeForOthers) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});  // 8 requests at a time: 2 may wait
  std::vector<std::future<RawAnswer>> waiting;
  for (int i = 0; i < 6; ++i) {
    waiting.push_back(std::async(std::launch::async, [&] { return server.get("/v1/events?after=0&wait_s=30"); }));
  }
  std::vector<RawAnswer> refused;
  for (int i = 0; i < 200 && refused.size() < 4; ++i) {
    for (auto& one : waiting) {
      if (one.valid() && one.wait_for(std::chrono::milliseconds(10)) == std::future_status::ready)
        refused.push_back(one.get());
    }
  }
  EXPECT_EQ(refused.size(), 4u);
  for (const RawAnswer& answer : refused) {
    EXPECT_EQ(answer.status, 503);
    EXPECT_EQ(answer.header("Retry-After"), "5");
  }
  EXPECT_EQ(server.get("/healthz").status, 200);
  server.post("/v1/recordings", good_csv("EFC-1"));
  for (auto& one : waiting) {
    if (one.valid()) {
      EXPECT_EQ(one.get().status, 200);
    }
  }
  EXPECT_EQ(events(server, "0", "30")["items"].empty(), false);  // the places are free again
}

TEST(Events, RefuseWhatIsNoCursorAndNoWait) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});
  EXPECT_EQ(json_of(server.get("/v1/events?after=x"))["code"], "invalid_cursor");
  EXPECT_EQ(json_of(server.get("/v1/events?after=-1"))["code"], "invalid_cursor");
  EXPECT_EQ(json_of(server.get("/v1/events?after=0&wait_s=31"))["code"], "bad_parameter");
  EXPECT_EQ(json_of(server.get("/v1/events?after=0&wait_s=nan"))["code"], "bad_parameter");
}

}  // namespace
}  // namespace valvetriage
