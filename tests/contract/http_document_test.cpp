#include <gtest/gtest.h>

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

}  // namespace
}  // namespace valvetriage
