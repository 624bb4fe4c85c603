#include "server/jobs/child_protocol.h"

#include <gtest/gtest.h>

#include "tests/contract/store_samples.h"

namespace valvetriage {
namespace {

TEST(ChildProtocol, GivesTheChildTheSpecAsItIs) {
  JobSpec spec{
      .job_id = "job_1",
      .submission_id = "sub_1",
      .files = {{"a \"name\"\n.csv", "ab12", "/data/blobs/ab/ab12", "step", R"({"x":1})"}, {"b", "cd", "/d", {}, "{}"}},
      .labels = test::a_valve("lot-a", "EFC-1"),
      .options_json = R"({"sample_rate_hz":200})",
      .reference_json = R"({"r":1})",
      .rule_base_json = {},
      .reference_version = 3};
  const auto read = job_spec_from(to_json_text(spec));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->job_id, spec.job_id);
  EXPECT_EQ(read->labels, spec.labels);
  EXPECT_EQ(read->options_json, spec.options_json);
  EXPECT_EQ(read->reference_json, spec.reference_json);
  EXPECT_FALSE(read->rule_base_json);
  EXPECT_EQ(read->reference_version, 3);
  ASSERT_EQ(read->files.size(), 2u);
  EXPECT_EQ(read->files[0].name, spec.files[0].name);
  EXPECT_EQ(read->files[0].path, spec.files[0].path);
  EXPECT_EQ(read->files[0].test, "step");
  EXPECT_FALSE(read->files[1].test);
}

TEST(ChildProtocol, BringsTheResultBackOnOneLine) {
  NewAnalysis analysis = test::an_analysis("Severe", "leakage");
  analysis.body_json = "{\n  \"schema\": \"x\"\n}";
  analysis.residuals_json = R"({"step, 2.0 s":{}})";
  const std::string line = done_line(analysis);
  EXPECT_EQ(line.find('\n'), line.size() - 1);
  const auto message = child_message_from(line);
  ASSERT_TRUE(message && message->done);
  EXPECT_EQ(message->done->summary, analysis.summary);
  EXPECT_EQ(message->done->body_json, analysis.body_json);
  EXPECT_EQ(message->done->residuals_json, analysis.residuals_json);
  EXPECT_EQ(message->done->result_sha256, analysis.result_sha256);
}

TEST(ChildProtocol, TellsBadInputFromAFaultThatPasses) {
  const auto rejected = child_message_from(refused_line({.code = "not_a_number", .message = "line 3", .line = 3}));
  ASSERT_TRUE(rejected && rejected->rejected_json);
  EXPECT_EQ(*rejected->rejected_json, R"({"code":"not_a_number","detail":"line 3","line":3})");
  const auto fault = child_message_from(refused_line({.code = std::string(kPassingFault), .message = "busy"}));
  EXPECT_TRUE(fault && fault->fault_json && !fault->rejected_json);
}

TEST(ChildProtocol, RefusesALineThatIsNoMessage) {
  for (const char* line : {"", "hello", "[]", "{}", R"({"done":{}})", R"({"progress":"half","note":""})"}) {
    EXPECT_FALSE(child_message_from(line)) << line;
  }
}

}  // namespace
}  // namespace valvetriage
