#include "server/jobs/child_process.h"

#include <gtest/gtest.h>

#include "server/jobs/child_protocol.h"

namespace valvetriage {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kAddressSpaceIsBounded = false;  // a sanitizer maps terabytes of shadow memory
constexpr std::int64_t kMemoryBytes = INT64_MAX;
#else
constexpr bool kAddressSpaceIsBounded = true;
constexpr std::int64_t kMemoryBytes = std::int64_t{256} << 20;
#endif

struct Ran {
  ChildOutcome outcome;
  ChildMessage answer;
};

/// Runs the fake child told to `act`.
Ran run(
    const std::string& act, ChildLimits limits = {}, std::function<bool()> keep_going = [] { return true; }) {
  limits.memory_bytes = kMemoryBytes;
  Ran ran;
  const JobSpec spec{.job_id = "job_1",
                     .submission_id = "sub_1",
                     .files = {},
                     .labels = {},
                     .options_json = R"({"do":")" + act + R"("})",
                     .reference_json = {},
                     .rule_base_json = {},
                     .reference_version = 0};
  const auto on_line = [&](std::string_view line) {
    auto message = child_message_from(line);
    if (message && !message->progress) ran.answer = *message;
  };
  const auto outcome = run_child_process({VALVETRIAGE_FAKE_CHILD}, to_json_text(spec), limits,
                                         {.on_line = on_line, .keep_going = std::move(keep_going)});
  EXPECT_TRUE(outcome);
  if (outcome) ran.outcome = *outcome;
  return ran;
}

TEST(ChildProcess, BringsBackTheAnswer) {
  const Ran ran = run("succeed");
  EXPECT_EQ(ran.outcome.end, ChildEnd::kExited);
  EXPECT_EQ(ran.outcome.status, 0);
  EXPECT_TRUE(ran.answer.done);
}

TEST(ChildProcess, ConfinesTheChild) {
  EXPECT_TRUE(run("confined").answer.done);
}

TEST(ChildProcess, SurvivesAChildThatCrashes) {
  const Ran ran = run("segv");
#if defined(__SANITIZE_ADDRESS__)
  EXPECT_EQ(ran.outcome.end, ChildEnd::kExited);  // the sanitizer turns the signal into a report
#else
  EXPECT_EQ(ran.outcome.end, ChildEnd::kSignal);
  EXPECT_EQ(ran.outcome.status, SIGSEGV);
#endif
}

TEST(ChildProcess, EndsAChildWhoseTimeIsUp) {
  EXPECT_EQ(run("hang", {.wall_ms = 200}).outcome.end, ChildEnd::kTimeout);
}

TEST(ChildProcess, EndsAChildWhoseProcessorTimeIsUp) {
  EXPECT_EQ(run("spin", {.cpu_s = 1}).outcome.end, ChildEnd::kTimeout);
}

TEST(ChildProcess, StopsAChildWhenAsked) {
  int asked = 0;
  EXPECT_EQ(run("hang", {}, [&] { return ++asked < 3; }).outcome.end, ChildEnd::kStopped);
}

TEST(ChildProcess, LetsAChildThatEatsMemorySayThatItHasNoMore) {
  if (!kAddressSpaceIsBounded) GTEST_SKIP() << "no bound on the address space under this sanitizer";
  const Ran ran = run("eat");
  EXPECT_EQ(ran.outcome.end, ChildEnd::kExited);
  ASSERT_TRUE(ran.answer.rejected_json);
  EXPECT_NE(ran.answer.rejected_json->find("out_of_memory"), std::string::npos);
}

TEST(ChildProcess, EndsAChildThatBabbles) {
  EXPECT_EQ(run("babble", {.answer_bytes = 1 << 20}).outcome.end, ChildEnd::kResource);
}

TEST(ChildProcess, KeepsTheLastWords) {
  const Ran ran = run("exit", {.messages_bytes = 5});
  EXPECT_EQ(ran.outcome.end, ChildEnd::kExited);
  EXPECT_EQ(ran.outcome.status, 3);
  EXPECT_EQ(ran.outcome.messages, "words");
}

TEST(ChildProcess, SaysWhenTheProgramIsNotThere) {
  const auto outcome = run_child_process({"/nowhere/at/all"}, "x", {},
                                         {.on_line = [](std::string_view) {}, .keep_going = [] { return true; }});
  ASSERT_TRUE(outcome);
  EXPECT_EQ(outcome->status, 127);
}

TEST(ChildProcess, TakesASpecLargerThanAPipeHolds) {
  const std::string large(4 << 20, ' ');
  const auto outcome =
      run_child_process({"/bin/cat"}, large + "\n", {.memory_bytes = kMemoryBytes, .answer_bytes = 8 << 20},
                        {.on_line = [&](std::string_view line) { EXPECT_EQ(line.size(), large.size()); },
                         .keep_going = [] { return true; }});
  ASSERT_TRUE(outcome);
  EXPECT_EQ(outcome->end, ChildEnd::kExited);
}

}  // namespace
}  // namespace valvetriage
