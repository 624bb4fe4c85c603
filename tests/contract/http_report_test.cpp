#include <gtest/gtest.h>

#include "server/http/request_head.h"
#include "tests/contract/http_fixture.h"

namespace valvetriage {
namespace {

constexpr const char* kHostile = "<img src=x onerror=alert(1)>";

TEST(Report, OfASubmissionIsOnePageThatMayRunNothing) {
  TestServer server({.tokens_required = false, .workers = 1, .limits = {}});
  const Json recording = server.await(server.post("/v1/recordings", good_csv(kHostile, kHostile)).header("Location"));
  for (const std::string& target : {"/v1/submissions/" + recording["submission_id"].get<std::string>() + "/report",
                                    "/v1/recordings/" + recording["id"].get<std::string>() + "/report",
                                    "/v1/lots/" + http::percent_encode(kHostile) + "/report"}) {
    const RawAnswer answer = server.get(target);
    ASSERT_EQ(answer.status, 200) << target << answer.body;
    EXPECT_TRUE(answer.header("Content-Type").starts_with("text/html"));
    EXPECT_TRUE(answer.header("Content-Security-Policy").starts_with("default-src 'none'"));
    EXPECT_NE(answer.body.find("&lt;img src=x onerror=alert(1)&gt;"), std::string::npos);
    EXPECT_EQ(answer.body.find("<img"), std::string::npos);
    EXPECT_NE(answer.body.find("<svg"), std::string::npos);
  }
}

TEST(Report, OfARecordingThatIsNotAnalysedSaysSo) {
  TestServer server({.tokens_required = false, .workers = 0, .limits = {}});
  const Json recording = json_of(server.post("/v1/recordings", good_csv("EFC-1")));
  const RawAnswer answer = server.get("/v1/recordings/" + recording["id"].get<std::string>() + "/report");
  EXPECT_EQ(answer.status, 409);
  EXPECT_EQ(json_of(answer)["code"], "not_finished");
}

TEST(Plot, OfARecordingIsSvg) {
  TestServer server({.tokens_required = false, .workers = 1, .limits = {}});
  const Json recording = server.await(server.post("/v1/recordings", good_csv("EFC-1")).header("Location"));
  const RawAnswer answer = server.get("/v1/recordings/" + recording["id"].get<std::string>() + "/plot.svg");
  ASSERT_EQ(answer.status, 200) << answer.body;
  EXPECT_EQ(answer.header("Content-Type"), "image/svg+xml");
  EXPECT_TRUE(answer.body.starts_with("<svg xmlns="));
}

}  // namespace
}  // namespace valvetriage
