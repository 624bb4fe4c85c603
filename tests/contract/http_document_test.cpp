#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <vector>

#include "server/http/limits.h"
#include "tests/contract/http_fixture.h"

namespace valvetriage {
namespace {

constexpr const char* kReferences = "/v1/valve-types/type-1/references";

std::string from_submissions(const std::vector<std::string>& ids) {
  return dump_json({{"submissions", ids}});
}

TEST(HttpDocument, LearnsAReferenceFromSoManySubmissionsAndNoMore) {
  TestServer server({});
  std::vector<std::string> ids(http::kMaxReferenceSubmissions, "sub_that_is_not_there");
  EXPECT_EQ(json_of(server.post(kReferences, from_submissions(ids)))["code"], "not_found");
  ids.push_back(ids.front());
  const RawAnswer refused = server.post(kReferences, from_submissions(ids));
  EXPECT_EQ(refused.status, 422) << refused.body;
  EXPECT_EQ(json_of(refused)["code"], "out_of_range");
}

TEST(HttpDocument, SaysWhyNoReferenceCanBeLearnedFromOneValve) {
  TestServer server({});
  const Json sent = json_of(server.post("/v1/recordings?name=steps.csv", good_csv("GOOD-1", "")));
  const RawAnswer refused = server.post(kReferences, from_submissions({sent["submission_id"].get<std::string>()}));
  EXPECT_EQ(refused.status, 422) << refused.body;
  EXPECT_EQ(json_of(refused)["code"], "too_few_valves");
}

TEST(HttpDocument, IsAnotherOneUnderAnotherVersionThoughItsContentCameBefore) {
  TestServer server({});
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/schemas/examples/valid/reference_three_valves.json");
  Json reference = parse_json(std::string(std::istreambuf_iterator<char>(file), {})).value();
  for (const double noise : {0.3, 0.4, 0.3}) {
    reference["noise_floor"] = noise;
    ASSERT_EQ(server.post(kReferences, dump_json(reference)).status, 201);
  }
  const std::string first = server.get(std::string(kReferences) + "/1").header("ETag");
  EXPECT_EQ(server.get(std::string(kReferences) + "/1", {{"If-None-Match", first}}).status, 304);
  const RawAnswer newest = server.get(std::string(kReferences) + "/newest", {{"If-None-Match", first}});
  EXPECT_EQ(newest.status, 200);
  EXPECT_EQ(json_of(newest)["version"], 3);
}

TEST(HttpDocument, IsStoredUnderNoNameThatCouldNotBeShown) {
  TestServer server({});
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/schemas/examples/valid/rule_base_two_classes.json");
  const std::string rule_base{std::istreambuf_iterator<char>(file), {}};
  for (const std::string& name : {std::string("%FF"), std::string(5000, 'a')}) {
    EXPECT_EQ(json_of(server.post("/v1/valve-types/" + name + "/rule-bases", rule_base))["code"], "bad_metadata");
    const RawAnswer finding = server.post("/v1/valves/" + name + "/findings", R"({"cause":"friction","who":"kim"})");
    EXPECT_EQ(json_of(finding)["code"], "bad_metadata");
  }
}

TEST(HttpDocument, ListsComeInPagesAndAsCsvAndADocumentSaysItsVersion) {
  TestServer server({});
  constexpr const char* kRuleBases = "/v1/valve-types/type-1/rule-bases";
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/schemas/examples/valid/reference_three_valves.json");
  Json reference = parse_json(std::string(std::istreambuf_iterator<char>(file), {})).value();
  for (int version = 1; version <= 3; ++version) {
    reference["noise_floor"] = 0.3 + 0.01 * version;
    const RawAnswer stored = server.post(kReferences, dump_json(reference));
    ASSERT_EQ(stored.status, 201) << stored.body;
    const std::string own = std::string(kReferences) + "/" + std::to_string(version);
    EXPECT_EQ(json_of(server.get(own))["version"], version);
  }
  const Json first = json_of(server.get(std::string(kReferences) + "?limit=2"));
  ASSERT_EQ(first["items"].size(), 2u);
  const std::string next = first["next"].get<std::string>();
  const Json rest = json_of(server.get(std::string(kReferences) + "?limit=2&cursor=" + next));
  ASSERT_EQ(rest["items"].size(), 1u);
  EXPECT_TRUE(rest["next"].is_null());
  EXPECT_EQ(json_of(server.get(kReferences))["items"].size(), 3u);
  EXPECT_EQ(json_of(server.get(std::string(kReferences) + "?cursor=4"))["code"], "invalid_cursor");
  EXPECT_EQ(server.get(std::string(kReferences) + "?format=xml").status, 400);
  EXPECT_EQ(server.get(std::string(kRuleBases) + "?format=csv").header("Content-Type"),
            "text/csv; charset=utf-8; header=absent");
  const RawAnswer causes = server.get("/v1/causes?limit=1&format=csv");
  EXPECT_EQ(causes.header("Content-Type"), "text/csv; charset=utf-8; header=present");
  EXPECT_EQ(server.get("/v1/events?after=0&format=csv").body.substr(0, 10), "cursor,at,");
}

}  // namespace
}  // namespace valvetriage
