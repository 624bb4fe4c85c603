// What every implementation of Store promises. A new one is one more entry in the list at the end.
#include <gtest/gtest.h>

#include <functional>
#include <ostream>
#include <set>
#include <thread>

#include "server/store/retry_policy.h"
#include "server/store/sqlite/sqlite_store.h"
#include "server/wire/sha256.h"
#include "tests/contract/manual_clock.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

using test::a_valve;
using test::alone;
using test::an_analysis;
using test::together;

constexpr std::int64_t kLeaseMs = 30'000;

struct Implementation {
  std::string name;
  std::function<Result<std::unique_ptr<Store>>(const std::string& folder, const Clock& clock)> open;

  friend void PrintTo(const Implementation& tested, std::ostream* out) { *out << tested.name; }
};

class StoreContract : public testing::TestWithParam<Implementation> {
 protected:
  void SetUp() override { reopen(); }

  void reopen() {
    store_.reset();
    auto opened = GetParam().open(folder_.path(), clock_);
    ASSERT_TRUE(opened) << opened.error().message;
    store_ = std::move(*opened);
  }

  Accepted accept(const NewSubmission& submission) {
    clock_.advance_ms(1);
    auto accepted = store_->accept(submission);
    EXPECT_TRUE(accepted) << accepted.error().message;
    return accepted ? *accepted : Accepted{};
  }

  JobRow claim() {
    auto claimed = store_->claim("worker", kLeaseMs);
    EXPECT_TRUE(claimed && *claimed);
    return claimed && *claimed ? **claimed : JobRow{};
  }

  /// Accepts and analyses.
  Accepted analysed(const NewSubmission& submission, const NewAnalysis& analysis) {
    const Accepted accepted = accept(submission);
    EXPECT_TRUE(store_->finish(claim().lease(), analysis));
    return accepted;
  }

  JobState state_of(const std::string& job_id) { return store_->job(job_id)->state; }

  test::TemporaryFolder folder_;
  test::ManualClock clock_;
  std::unique_ptr<Store> store_;
};

std::vector<std::string> ids(const std::vector<RecordingRow>& rows) {
  std::vector<std::string> found;
  for (const RecordingRow& row : rows) found.push_back(row.id);
  return found;
}

// --- accepting -------------------------------------------------------------------------------------------------------

TEST_P(StoreContract, KeepsWhatItAccepted) {
  const Accepted accepted = accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  ASSERT_EQ(accepted.kind, AcceptKind::kCreated);
  reopen();
  const auto row = store_->recording(accepted.recordings.at(0).id);
  ASSERT_TRUE(row);
  EXPECT_EQ(row->id.substr(0, 4), "rec_");
  EXPECT_EQ(row->id.size(), 30u);
  EXPECT_EQ(row->state, JobState::kQueued);
  EXPECT_EQ(row->labels, a_valve("lot-a", "EFC-1"));
  EXPECT_EQ(row->name, "bytes.csv");
  EXPECT_EQ(row->sha256, sha256_hex("bytes"));
  EXPECT_EQ(row->test, "step");
  EXPECT_EQ(row->metadata_json, R"({"operator":"kim"})");
  EXPECT_EQ(row->received_at, clock_.utc_ms());
  EXPECT_EQ(row->submission_id, accepted.submission.id);
  EXPECT_EQ(state_of(row->job_id), JobState::kQueued);
}

TEST_P(StoreContract, GivesIdsThatSortByAge) {
  const Accepted first = accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  const Accepted second = accept(alone(a_valve("lot-a", "EFC-1"), "two"));
  EXPECT_LT(first.recordings.at(0).id, second.recordings.at(0).id);
}

TEST_P(StoreContract, AnswersTheFirstRecordingForTheSameBytesLotAndSerial) {
  const Accepted first = accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  const Accepted again = accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  EXPECT_EQ(again.kind, AcceptKind::kDuplicate);
  EXPECT_EQ(ids(again.recordings), ids(first.recordings));
  EXPECT_EQ(accept(alone(a_valve("lot-b", "EFC-1"), "bytes")).kind, AcceptKind::kCreated);
  EXPECT_EQ(accept(alone(a_valve("lot-a", "EFC-2"), "bytes")).kind, AcceptKind::kCreated);
}

TEST_P(StoreContract, ReadsARejectedRecordingAgainWhereItIsSentWithOtherOptions) {
  const NewSubmission request = alone(a_valve("lot-a", "EFC-1"), "bytes");
  const Accepted first = accept(request);
  ASSERT_TRUE(store_->end_attempt(claim().lease(), AttemptEnd::kRejected, R"({"code":"missing_column"})"));
  EXPECT_EQ(accept(request).submission.state, JobState::kRejected) << "the same again comes to the same";
  NewSubmission mended = request;
  mended.options_json = R"({"columns":"time=t,input=u,output=y"})";
  const Accepted again = accept(mended);
  EXPECT_EQ(again.kind, AcceptKind::kDuplicate);
  EXPECT_EQ(ids(again.recordings), ids(first.recordings));
  EXPECT_EQ(again.submission.state, JobState::kQueued);
  EXPECT_EQ(store_->job(again.submission.job_id)->options_json, mended.options_json);
}

TEST_P(StoreContract, TakesOverTheValveTypeThatARecordingLackedAndAnalysesItAgain) {
  Labels untyped = a_valve("lot-a", "EFC-1");
  untyped.valve_type.reset();
  const Accepted first = accept(alone(untyped, "bytes"));
  ASSERT_TRUE(store_->finish(claim().lease(), an_analysis("")));
  const Accepted again = accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  EXPECT_EQ(again.submission.labels.valve_type, "type-1");
  EXPECT_NE(again.submission.job_id, first.submission.job_id);
  EXPECT_EQ(claim().id, again.submission.job_id);
}

TEST_P(StoreContract, AsksNothingAnewOfARecordingThatHasItsResult) {
  accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  ASSERT_TRUE(store_->finish(claim().lease(), an_analysis("Good")));
  NewSubmission other = alone(a_valve("lot-a", "EFC-1"), "bytes");
  other.options_json = R"({"sample_rate_hz":100})";
  EXPECT_EQ(accept(other).submission.state, JobState::kDone);
  EXPECT_FALSE(*store_->claim("w", kLeaseMs));
}

TEST_P(StoreContract, FindsNothingADuplicateWithoutASerial) {
  Labels nameless = a_valve("lot-a", "");
  nameless.serial.reset();
  EXPECT_EQ(accept(alone(nameless, "bytes")).kind, AcceptKind::kCreated);
  EXPECT_EQ(accept(alone(nameless, "bytes")).kind, AcceptKind::kCreated);
}

TEST_P(StoreContract, TellsARecordingApartFromTheSubmissionItIsIn) {
  const Labels valve = a_valve("lot-a", "EFC-1");
  const Accepted session = accept(together(valve, {"one", "two"}));
  const Accepted single = accept(alone(valve, "two"));
  EXPECT_EQ(single.kind, AcceptKind::kDuplicate);
  ASSERT_EQ(single.recordings.size(), 1u);
  EXPECT_EQ(single.recordings[0].id, session.recordings.at(1).id);
  EXPECT_EQ(accept(together(valve, {"two", "one"})).kind, AcceptKind::kDuplicate) << "the order does not matter";
  EXPECT_EQ(accept(together(valve, {"one", "two", "three"})).kind, AcceptKind::kCreated);
}

TEST_P(StoreContract, RepeatsTheAnswerForTheSameIdempotencyKey) {
  NewSubmission request = alone(Labels{}, "bytes");
  request.idempotency = {"tok_1", "key-1"};
  const Accepted first = accept(request);
  reopen();
  const Accepted again = accept(request);
  EXPECT_EQ(again.kind, AcceptKind::kReplayed);
  EXPECT_TRUE(again.first_created);
  EXPECT_EQ(ids(again.recordings), ids(first.recordings));
  request.idempotency->principal = "tok_2";
  EXPECT_EQ(accept(request).kind, AcceptKind::kCreated) << "another token's keys are its own";
}

TEST_P(StoreContract, RefusesAnIdempotencyKeyForAnotherRequest) {
  NewSubmission request = alone(Labels{}, "bytes");
  request.idempotency = {"tok_1", "key-1"};
  accept(request);
  request.request_sha256 = sha256_hex("something else");
  const auto refused = store_->accept(request);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "idempotency_conflict");
}

TEST_P(StoreContract, RepeatsADuplicatesAnswerAsADuplicate) {
  accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
  NewSubmission request = alone(a_valve("lot-a", "EFC-1"), "bytes");
  request.idempotency = {"local", "key-1"};
  EXPECT_EQ(accept(request).kind, AcceptKind::kDuplicate);
  const Accepted again = accept(request);
  EXPECT_EQ(again.kind, AcceptKind::kReplayed);
  EXPECT_FALSE(again.first_created);
}

TEST_P(StoreContract, RefusesBeyondTheQueuesBoundAndLeavesNothing) {
  NewSubmission request = alone(a_valve("lot-a", "EFC-1"), "one");
  request.max_queued_jobs = 1;
  accept(request);
  NewSubmission refused = alone(a_valve("lot-b", "EFC-2"), "two");
  refused.max_queued_jobs = 1;
  const auto answer = store_->accept(refused);
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, "overloaded");
  EXPECT_EQ(store_->list_recordings({}, {})->items.size(), 1u);
  EXPECT_FALSE(store_->lot("lot-b"));
  refused.max_queued_jobs = 2;
  EXPECT_EQ(accept(refused).kind, AcceptKind::kCreated);
}

TEST_P(StoreContract, RefusesASubmissionWithoutARecording) {
  const auto answer = store_->accept(NewSubmission{});
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, "no_files");
}

TEST_P(StoreContract, AcceptsTheSameValveOnceHoweverManySendItAtOnce) {
  constexpr int kClients = 8;
  std::vector<std::thread> clients;
  std::array<std::string, kClients> answers;
  for (int i = 0; i < kClients; ++i) {
    clients.emplace_back([&, i] {
      const auto accepted = store_->accept(alone(a_valve("lot-a", "EFC-1"), "bytes"));
      if (accepted) answers[static_cast<std::size_t>(i)] = accepted->recordings.at(0).id;
    });
  }
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(std::set<std::string>(answers.begin(), answers.end()).size(), 1u);
  EXPECT_EQ(store_->queue_stats()->jobs.at(JobState::kQueued), 1);
}

// --- lists -----------------------------------------------------------------------------------------------------------

TEST_P(StoreContract, ListsNewestFirstInPagesThatMissNothingAndRepeatNothing) {
  std::vector<std::string> expected;
  for (int i = 0; i < 7; ++i) {
    // Every second one shares its millisecond with the one before.
    if (i % 2 == 0) clock_.advance_ms(1);
    const auto accepted = store_->accept(
        together(a_valve("lot-a", "EFC-" + std::to_string(i)), {std::to_string(i), "second of " + std::to_string(i)}));
    ASSERT_TRUE(accepted);
    for (const RecordingRow& row : accepted->recordings) expected.insert(expected.begin(), row.id);
  }
  for (const int limit : {1, 3, 14, 100}) {
    std::vector<std::string> seen;
    PageRequest request{.limit = limit, .cursor = {}};
    do {
      const auto page = store_->list_recordings({.lot = "lot-a"}, request);
      ASSERT_TRUE(page);
      for (const std::string& id : ids(page->items)) seen.push_back(id);
      request.cursor = page->next;
    } while (request.cursor);
    EXPECT_EQ(seen, expected) << "limit " << limit;
  }
}

TEST_P(StoreContract, ListsWhatMatchesEveryFilterGiven) {
  analysed(alone(a_valve("lot-a", "EFC-1"), "one"), an_analysis("Severe", "leakage"));
  const TimestampMs between = clock_.utc_ms() + 1;
  analysed(alone(a_valve("lot-a", "EFC-2"), "two"), an_analysis("Good", "friction"));
  Labels other = a_valve("lot-b", "EFC-3");
  other.valve_type = "type-2";
  other.stand = "stand-9";
  accept(alone(other, "three"));

  const auto names = [&](const Filter& filter) {
    std::string found;
    const auto recordings = store_->list_recordings(filter, {});
    for (const RecordingRow& row : recordings->items) found += row.name.substr(0, 3) + " ";
    std::string sessions;
    const auto submissions = store_->list_submissions(filter, {});
    for (const SubmissionRow& row : submissions->items) {
      sessions += store_->recordings_of(row.id)->front().name.substr(0, 3) + " ";
    }
    EXPECT_EQ(found, sessions);
    return found;
  };
  EXPECT_EQ(names({}), "thr two one ");
  EXPECT_EQ(names({.lot = "lot-a"}), "two one ");
  EXPECT_EQ(names({.serial = "EFC-2"}), "two ");
  EXPECT_EQ(names({.valve_type = "type-2"}), "thr ");
  EXPECT_EQ(names({.stand = "stand-3"}), "two one ");
  EXPECT_EQ(names({.verdict = "Severe"}), "one ");
  EXPECT_EQ(names({.cause = "friction"}), "two ");
  EXPECT_EQ(names({.since = between}), "thr two ");
  EXPECT_EQ(names({.until = between}), "one ");
  EXPECT_EQ(names({.lot = "lot-a", .verdict = "Good"}), "two ");
  EXPECT_EQ(names({.lot = "lot-b", .verdict = "Good"}), "");
}

TEST_P(StoreContract, RefusesACursorItDidNotGive) {
  for (const char* cursor : {"", "nonsense", "c1-1-2", "c1-1-2-3-4", "c1-1-2-3 ", "c1-x-2-3"}) {
    const auto page = store_->list_recordings({}, {.limit = 10, .cursor = cursor});
    ASSERT_FALSE(page) << cursor;
    EXPECT_EQ(page.error().code, "invalid_cursor");
  }
}

TEST_P(StoreContract, BoundsThePage) {
  EXPECT_TRUE(store_->list_submissions({}, {.limit = 1, .cursor = {}}));
  EXPECT_TRUE(store_->list_submissions({}, {.limit = kMaxPageLimit, .cursor = {}}));
  EXPECT_EQ(store_->list_submissions({}, {.limit = 0, .cursor = {}}).error().code, "invalid_limit");
  EXPECT_EQ(store_->list_submissions({}, {.limit = kMaxPageLimit + 1, .cursor = {}}).error().code, "invalid_limit");
}

TEST_P(StoreContract, SaysNotFoundForWhatIsNotThere) {
  EXPECT_EQ(store_->recording("rec_x").error().code, "not_found");
  EXPECT_EQ(store_->submission("sub_x").error().code, "not_found");
  EXPECT_EQ(store_->recordings_of("sub_x").error().code, "not_found");
  EXPECT_EQ(store_->job("job_x").error().code, "not_found");
  EXPECT_EQ(store_->analysis_body("ana_x").error().code, "not_found");
  EXPECT_EQ(store_->newest_analysis("sub_x").error().code, "not_found");
  EXPECT_EQ(store_->reanalyze("sub_x", "{}", "local", 10).error().code, "not_found");
  EXPECT_EQ(store_->cancel("job_x", "local").error().code, "not_found");
  EXPECT_EQ(store_->lot("lot-x").error().code, "not_found");
  EXPECT_EQ(store_->document(DocumentKind::kReference, "type-x").error().code, "not_found");
}

// --- jobs ------------------------------------------------------------------------------------------------------------

TEST_P(StoreContract, GivesEachJobToOneWorkerInTheOrderOfArrival) {
  const Accepted first = accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  const Accepted second = accept(alone(a_valve("lot-a", "EFC-2"), "two"));
  const JobRow claimed = claim();
  EXPECT_EQ(claimed.id, first.submission.job_id);
  EXPECT_EQ(claimed.attempt, 1);
  EXPECT_EQ(store_->submission(first.submission.id)->state, JobState::kRunning);
  EXPECT_EQ(claim().id, second.submission.job_id);
  EXPECT_FALSE(*store_->claim("worker", kLeaseMs));
}

TEST_P(StoreContract, StoresTheResultWithTheEndOfItsJob) {
  const Accepted accepted = accept(together(a_valve("lot-a", "EFC-1"), {"one", "two"}));
  const JobRow job = claim();
  const auto stored = store_->finish(job.lease(), an_analysis("Severe"));
  ASSERT_TRUE(stored) << stored.error().message;
  reopen();
  EXPECT_EQ(state_of(job.id), JobState::kDone);
  EXPECT_EQ(store_->job(job.id)->analysis_id, stored->id);
  const auto recordings = store_->recordings_of(accepted.submission.id);
  for (const RecordingRow& row : *recordings) {
    EXPECT_EQ(row.state, JobState::kDone);
    EXPECT_EQ(row.summary, an_analysis("Severe").summary);
  }
  EXPECT_EQ(store_->newest_analysis(accepted.submission.id)->result_sha256, an_analysis("Severe").result_sha256);
  EXPECT_EQ(*store_->analysis_body(stored->id), an_analysis("Severe").body_json);
}

TEST_P(StoreContract, KeepsTheResidualsOfTheNewestAnalysisWhereItHasAny) {
  const Accepted accepted = accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  EXPECT_EQ(store_->newest_residuals(accepted.submission.id).error().code, "not_found");
  NewAnalysis analysis = an_analysis("Severe");
  analysis.residuals_json = R"({"step, 2.0 s":{"time_s":[1.0],"value":[0.5],"white_sd":0.1}})";
  ASSERT_TRUE(store_->finish(claim().lease(), analysis));
  reopen();
  EXPECT_EQ(*store_->newest_residuals(accepted.submission.id), analysis.residuals_json);
  ASSERT_TRUE(store_->reanalyze(accepted.submission.id, "{}", "local", 10));
  EXPECT_EQ(*store_->newest_residuals(accepted.submission.id), analysis.residuals_json);
  ASSERT_TRUE(store_->finish(claim().lease(), an_analysis("Good")));
  EXPECT_EQ(*store_->newest_residuals(accepted.submission.id), "");
}

TEST_P(StoreContract, ShowsWhatWasAskedLastThoughAnEarlierJobEndsLater) {
  const Accepted accepted = accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  const JobRow earlier = claim();
  ASSERT_TRUE(store_->reanalyze(accepted.submission.id, "{}", "local", 10));
  const JobRow later = claim();
  ASSERT_TRUE(store_->finish(later.lease(), an_analysis("Severe")));
  const auto stored = store_->finish(earlier.lease(), an_analysis("Good"));
  ASSERT_TRUE(stored);
  EXPECT_EQ(stored->summary.verdict, "Good") << "the answer is the analysis of this job";
  EXPECT_EQ(store_->submission(accepted.submission.id)->summary.verdict, "Severe");
  EXPECT_EQ(store_->newest_analysis(accepted.submission.id)->summary.verdict, "Severe");
  EXPECT_EQ(store_->analyses_of(accepted.submission.id)->at(0).summary.verdict, "Severe");
  EXPECT_EQ(store_->lot("lot-a")->verdicts.at("Severe"), 1);
  EXPECT_EQ(*store_->check(), std::vector<std::string>{});
}

TEST_P(StoreContract, TakesNoSecondResultForAJob) {
  accept(alone(Labels{}, "one"));
  const JobRow job = claim();
  ASSERT_TRUE(store_->finish(job.lease(), an_analysis("Good")));
  EXPECT_EQ(store_->finish(job.lease(), an_analysis("Severe")).error().code, "lease_lost");
  EXPECT_EQ(store_->end_attempt(job.lease(), AttemptEnd::kCrash, "{}").error().code, "lease_lost");
  EXPECT_EQ(store_->analyses_of(job.submission_id)->size(), 1u);
}

TEST_P(StoreContract, TakesNothingFromAWorkerWhoseLeaseRanOut) {
  accept(alone(Labels{}, "one"));
  const JobRow zombie = claim();
  clock_.advance_ms(kLeaseMs - 1);
  EXPECT_EQ(*store_->expire_leases(), 0);
  clock_.advance_ms(1);
  EXPECT_EQ(*store_->expire_leases(), 1);
  EXPECT_EQ(store_->heartbeat(zombie.lease(), kLeaseMs, 0.5, "").error().code, "lease_lost");
  clock_.advance_ms(kFirstBackoffMs);
  const JobRow again = claim();
  EXPECT_EQ(again.id, zombie.id);
  EXPECT_EQ(store_->finish(zombie.lease(), an_analysis("Severe")).error().code, "lease_lost");
  EXPECT_TRUE(store_->finish(again.lease(), an_analysis("Good")));
  EXPECT_EQ(store_->submission(zombie.submission_id)->summary.verdict, "Good");
}

TEST_P(StoreContract, ProlongsTheLeaseWithEveryHeartbeat) {
  accept(alone(Labels{}, "one"));
  const JobRow job = claim();
  for (int beat = 0; beat < 5; ++beat) {
    clock_.advance_ms(kLeaseMs - 1);
    ASSERT_TRUE(store_->heartbeat(job.lease(), kLeaseMs, 0.2 * beat, "fitting"));
    EXPECT_EQ(*store_->expire_leases(), 0);
  }
  EXPECT_DOUBLE_EQ(store_->job(job.id)->progress, 0.8);
  EXPECT_EQ(store_->job(job.id)->progress_note, "fitting");
}

TEST_P(StoreContract, LetsNoLeaseRunOutBecauseTheWallClockJumped) {
  accept(alone(Labels{}, "one"));
  const JobRow job = claim();
  for (const std::int64_t years : {10, -20}) {
    clock_.jump_wall_ms(years * 365 * 24 * 3600 * std::int64_t{1000});
    EXPECT_EQ(*store_->expire_leases(), 0);
  }
  EXPECT_TRUE(store_->finish(job.lease(), an_analysis("Good")));
}

TEST_P(StoreContract, NeverTriesBadInputAgain) {
  const Accepted accepted = accept(alone(Labels{}, "one"));
  const JobRow job = claim();
  EXPECT_EQ(store_->end_attempt(job.lease(), AttemptEnd::kRejected, R"({"code":"not_a_number"})")->state,
            JobState::kRejected);
  const auto row = store_->recording(accepted.recordings.at(0).id);
  EXPECT_EQ(row->state, JobState::kRejected);
  EXPECT_EQ(row->problem_json, R"({"code":"not_a_number"})");
  clock_.advance_ms(kLongestBackoffMs);
  EXPECT_FALSE(*store_->claim("worker", kLeaseMs));
}

TEST_P(StoreContract, TriesAPassingFaultAgainAfterABackoffUntilTheAttemptsAreUsedUp) {
  accept(alone(Labels{}, "one"));
  std::int64_t backoff_ms = kFirstBackoffMs;
  for (int attempt = 1; attempt < kMaxAttempts; ++attempt) {
    const JobRow job = claim();
    EXPECT_EQ(job.attempt, attempt);
    EXPECT_EQ(store_->end_attempt(job.lease(), AttemptEnd::kFault, "{}")->state, JobState::kQueued);
    clock_.advance_ms(backoff_ms - 1);
    EXPECT_FALSE(*store_->claim("worker", kLeaseMs));
    clock_.advance_ms(1);
    backoff_ms *= 2;
  }
  EXPECT_EQ(store_->end_attempt(claim().lease(), AttemptEnd::kFault, "{}")->state, JobState::kFailed);
}

TEST_P(StoreContract, PoisonsAJobWhoseChildDiedThreeTimes) {
  accept(alone(Labels{}, "one"));
  for (int crash = 1; crash < kMaxCrashes; ++crash) {
    EXPECT_EQ(store_->end_attempt(claim().lease(), AttemptEnd::kCrash, "{}")->state, JobState::kQueued);
    clock_.advance_ms(kLongestBackoffMs);
  }
  EXPECT_EQ(store_->end_attempt(claim().lease(), AttemptEnd::kCrash, "{}")->state, JobState::kPoisoned);
}

TEST_P(StoreContract, GivesUpAfterTheSecondTimeout) {
  accept(alone(Labels{}, "one"));
  EXPECT_EQ(store_->end_attempt(claim().lease(), AttemptEnd::kTimeout, "{}")->state, JobState::kQueued);
  clock_.advance_ms(kLongestBackoffMs);
  EXPECT_EQ(store_->end_attempt(claim().lease(), AttemptEnd::kTimeout, "{}")->state, JobState::kFailed);
}

TEST_P(StoreContract, DoesNotCountAnAttemptThatWasHandedBack) {
  accept(alone(Labels{}, "one"));
  for (int drain = 0; drain < 2 * kMaxAttempts; ++drain) {
    const JobRow job = claim();
    EXPECT_EQ(job.attempt, 1);
    EXPECT_EQ(store_->end_attempt(job.lease(), AttemptEnd::kReturned, "")->state, JobState::kQueued);
  }
}

TEST_P(StoreContract, ReleasesTheLeasesOfADeadServerAtStartAlsoAfterAReboot) {
  accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  accept(alone(a_valve("lot-a", "EFC-2"), "two"));
  const JobRow lost = claim();
  clock_.reboot();
  reopen();
  EXPECT_EQ(*store_->release_dead_leases(), 1);
  EXPECT_EQ(claim().attempt, 1);
  EXPECT_EQ(claim().attempt, 1) << "one that waited before the reboot does not wait for the old clock";
  EXPECT_EQ(store_->finish(lost.lease(), an_analysis("Good")).error().code, "lease_lost");
}

TEST_P(StoreContract, CancelsAQueuedJobAtOnce) {
  const Accepted accepted = accept(alone(Labels{}, "one"));
  EXPECT_EQ(store_->cancel(accepted.submission.job_id, "tok_1")->state, JobState::kCancelled);
  EXPECT_FALSE(*store_->claim("worker", kLeaseMs));
  EXPECT_EQ(store_->cancel(accepted.submission.job_id, "tok_1").error().code, "not_cancellable");
  EXPECT_EQ(store_->recording(accepted.recordings.at(0).id)->state, JobState::kCancelled);
}

TEST_P(StoreContract, TakesNoResultOfAJobThatWasCancelledWhileItRan) {
  const Accepted accepted = accept(alone(Labels{}, "one"));
  const JobRow job = claim();
  ASSERT_TRUE(store_->cancel(job.id, "local"));
  EXPECT_EQ(store_->heartbeat(job.lease(), kLeaseMs, 0, "").error().code, "lease_lost");
  EXPECT_EQ(store_->finish(job.lease(), an_analysis("Good")).error().code, "lease_lost");
  EXPECT_TRUE(store_->analyses_of(accepted.submission.id)->empty());
}

TEST_P(StoreContract, KeepsTheOldAnalysisBesideTheNewOne) {
  const Accepted accepted = analysed(alone(a_valve("lot-a", "EFC-1"), "one"), an_analysis("Good"));
  const auto again = store_->reanalyze(accepted.submission.id, R"({"rule_base":"paper"})", "local", 10);
  ASSERT_TRUE(again);
  EXPECT_EQ(store_->submission(accepted.submission.id)->state, JobState::kDone) << "it has a result already";
  const JobRow job = claim();
  EXPECT_EQ(job.options_json, R"({"rule_base":"paper"})");
  ASSERT_TRUE(store_->finish(job.lease(), an_analysis("Severe")));
  const auto analyses = store_->analyses_of(accepted.submission.id);
  ASSERT_EQ(analyses->size(), 2u);
  EXPECT_EQ(analyses->at(0).summary.verdict, "Severe");
  EXPECT_EQ(analyses->at(1).summary.verdict, "Good");
  EXPECT_EQ(store_->submission(accepted.submission.id)->summary.verdict, "Severe");
}

TEST_P(StoreContract, ShowsTheOldResultWhenAReanalysisFails) {
  const Accepted accepted = analysed(alone(Labels{}, "one"), an_analysis("Good"));
  ASSERT_TRUE(store_->reanalyze(accepted.submission.id, "{}", "local", 10));
  ASSERT_TRUE(store_->end_attempt(claim().lease(), AttemptEnd::kFailed, "{}"));
  const auto row = store_->submission(accepted.submission.id);
  EXPECT_EQ(row->state, JobState::kDone);
  EXPECT_EQ(row->summary.verdict, "Good");
  EXPECT_EQ(state_of(row->job_id), JobState::kFailed);
}

TEST_P(StoreContract, CountsTheQueue) {
  const TimestampMs first_at = clock_.utc_ms() + 1;
  for (int i = 0; i < 4; ++i) accept(alone(a_valve("lot-a", std::to_string(i)), std::to_string(i)));
  auto stats = store_->queue_stats();
  EXPECT_EQ(stats->oldest_queued_at, first_at);
  ASSERT_TRUE(store_->finish(claim().lease(), an_analysis("Good")));
  claim();
  stats = store_->queue_stats();
  EXPECT_EQ(stats->jobs.at(JobState::kQueued), 2);
  EXPECT_EQ(stats->jobs.at(JobState::kRunning), 1);
  EXPECT_EQ(stats->jobs.at(JobState::kDone), 1);
  EXPECT_EQ(stats->jobs.at(JobState::kPoisoned), 0);
}

// --- lots, documents, findings, tokens, events -----------------------------------------------------------------------

TEST_P(StoreContract, CountsAValveOnceWithItsNewestResult) {
  analysed(alone(a_valve("lot-a", "EFC-1"), "first try"), an_analysis("Severe", "friction"));
  analysed(alone(a_valve("lot-a", "EFC-1"), "second try"), an_analysis("Good", "leakage"));
  analysed(alone(a_valve("lot-a", "EFC-2"), "other"), an_analysis("Severe", "friction"));
  accept(alone(a_valve("lot-a", "EFC-3"), "waits"));
  const auto lot = store_->lot("lot-a");
  ASSERT_TRUE(lot);
  EXPECT_EQ(lot->recordings, 4);
  EXPECT_EQ(lot->submissions, 4);
  EXPECT_EQ(lot->valves, 3);
  EXPECT_EQ(lot->analysed_valves, 2);
  EXPECT_EQ(lot->verdicts, (std::map<std::string, std::int64_t>{{"Good", 1}, {"Severe", 1}}));
  EXPECT_EQ(lot->causes, (std::map<std::string, std::int64_t>{{"friction", 1}, {"leakage", 1}}));
}

TEST_P(StoreContract, CountsAValveWithEachOfItsSettledCauses) {
  NewAnalysis both = an_analysis("Severe", "friction");
  both.summary.causes.push_back({.cause = "sensor_offset", .probability = 0.96, .settled = true});
  both.summary.causes.push_back({.cause = "leakage", .probability = 0.6, .settled = false});
  analysed(alone(a_valve("lot-a", "EFC-1"), "one"), both);
  analysed(alone(a_valve("lot-a", "EFC-2"), "two"), an_analysis("Severe", "friction"));
  EXPECT_EQ(store_->lot("lot-a")->causes, (std::map<std::string, std::int64_t>{{"friction", 2}, {"sensor_offset", 1}}));
  const auto rows = store_->list_submissions({.lot = "lot-a", .serial = "EFC-1"}, {});
  EXPECT_EQ(rows->items.at(0).summary.causes, both.summary.causes);
  analysed(alone(a_valve("lot-a", "EFC-1"), "again"), an_analysis("Good", "leakage"));
  EXPECT_EQ(store_->lot("lot-a")->causes, (std::map<std::string, std::int64_t>{{"friction", 1}, {"leakage", 1}}));
}

TEST_P(StoreContract, FindsAValveByEachOfItsCausesInPagesThatRepeatNothing) {
  for (int i = 0; i < 5; ++i) {
    clock_.advance_ms(1);
    NewAnalysis both = an_analysis("Severe", "friction");
    both.summary.causes.push_back({.cause = "sensor_offset", .probability = 0.96, .settled = true});
    analysed(alone(a_valve("lot-a", "EFC-" + std::to_string(i)), std::to_string(i)), both);
  }
  for (const Filter& filter : {Filter{.cause = "sensor_offset"}, Filter{.lot = "lot-a", .cause = "sensor_offset"}}) {
    std::string found;
    PageRequest request{.limit = 2, .cursor = {}};
    do {
      const auto page = store_->list_submissions(filter, request);
      ASSERT_TRUE(page);
      for (const SubmissionRow& row : page->items) found += row.labels.serial->back();
      request.cursor = page->next;
    } while (request.cursor);
    EXPECT_EQ(found, "43210");
  }
  EXPECT_EQ(store_->list_recordings({.cause = "sensor_offset"}, {})->items.size(), 5u);
  EXPECT_TRUE(store_->list_submissions({.verdict = "Good", .cause = "sensor_offset"}, {})->items.empty());
}

TEST_P(StoreContract, DoesNotLetALateResultOfAnOlderTestDisplaceTheNewest) {
  accept(alone(a_valve("lot-a", "EFC-1"), "older"));
  accept(alone(a_valve("lot-a", "EFC-1"), "newer"));
  const JobRow older = claim();
  const JobRow newer = claim();
  ASSERT_TRUE(store_->finish(newer.lease(), an_analysis("Good")));
  ASSERT_TRUE(store_->finish(older.lease(), an_analysis("Severe")));
  EXPECT_EQ(store_->lot("lot-a")->verdicts, (std::map<std::string, std::int64_t>{{"Good", 1}}));
}

TEST_P(StoreContract, CountsEverySubmissionWithoutASerialAsAValve) {
  Labels nameless;
  nameless.lot = "lot-a";
  accept(alone(nameless, "one"));
  accept(alone(nameless, "two"));
  EXPECT_EQ(store_->lot("lot-a")->valves, 2);
}

TEST_P(StoreContract, CountsAResultWithoutAVerdictUnderTheEmptyKey) {
  NewAnalysis undecided = an_analysis("Good");
  undecided.summary.verdict.reset();
  undecided.summary.top_cause.reset();
  undecided.summary.causes.clear();
  analysed(alone(a_valve("lot-a", "EFC-1"), "one"), undecided);
  EXPECT_EQ(store_->lot("lot-a")->verdicts, (std::map<std::string, std::int64_t>{{"", 1}}));
  EXPECT_TRUE(store_->lot("lot-a")->causes.empty());
}

TEST_P(StoreContract, ListsLotsNewestFirstInPages) {
  for (const char* lot : {"lot-a", "lot-b", "lot-c"}) accept(alone(a_valve(lot, "EFC-1"), lot));
  const auto first = store_->list_lots({.limit = 2, .cursor = {}});
  ASSERT_EQ(first->items.size(), 2u);
  EXPECT_EQ(first->items[0].lot, "lot-c");
  const auto second = store_->list_lots({.limit = 2, .cursor = first->next});
  ASSERT_EQ(second->items.size(), 1u);
  EXPECT_EQ(second->items[0].lot, "lot-a");
  EXPECT_FALSE(second->next);
}

TEST_P(StoreContract, NumbersTheVersionsOfADocumentAndServesTheNewest) {
  EXPECT_EQ(store_->add_document(DocumentKind::kReference, "type-1", R"({"a":1})", sha256_hex(R"({"a":1})"), "local")
                ->version,
            1);
  EXPECT_EQ(store_->add_document(DocumentKind::kReference, "type-1", R"({"a":2})", sha256_hex(R"({"a":2})"), "local")
                ->version,
            2);
  EXPECT_EQ(store_->add_document(DocumentKind::kReference, "type-1", R"({"a":2})", sha256_hex(R"({"a":2})"), "local")
                ->version,
            2)
      << "the same again";
  EXPECT_EQ(store_->add_document(DocumentKind::kReference, "type-1", R"({"a":1})", sha256_hex(R"({"a":1})"), "local")
                ->version,
            3)
      << "back to an older one";
  EXPECT_EQ(store_->add_document(DocumentKind::kReference, "type-2", R"({"a":1})", sha256_hex(R"({"a":1})"), "local")
                ->version,
            1);
  EXPECT_EQ(
      store_->add_document(DocumentKind::kRuleBase, "type-1", R"({"r":1})", sha256_hex(R"({"r":1})"), "local")->version,
      1);
  EXPECT_EQ(store_->document(DocumentKind::kReference, "type-1")->body_json, R"({"a":1})");
  EXPECT_EQ(store_->document(DocumentKind::kReference, "type-1", 2)->body_json, R"({"a":2})");
  EXPECT_EQ(store_->document(DocumentKind::kReference, "type-1", 4).error().code, "not_found");
  EXPECT_EQ(store_->list_documents(DocumentKind::kReference, "type-1")->front().version, 3);
}

TEST_P(StoreContract, KeepsWhatTeardownFound) {
  ASSERT_TRUE(
      store_->add_finding({.serial = "EFC-1", .cause = "leakage", .found_by = "kim", .found_at = 42, .note = "seal"}));
  ASSERT_TRUE(
      store_->add_finding({.serial = "EFC-1", .cause = "friction", .found_by = "lee", .found_at = {}, .note = ""}));
  const auto findings = store_->findings("EFC-1");
  ASSERT_EQ(findings->size(), 2u);
  EXPECT_EQ(findings->at(0).found_at, 42);
  EXPECT_EQ(findings->at(0).note, "seal");
  EXPECT_EQ(findings->at(1).found_at, clock_.utc_ms());
  EXPECT_TRUE(store_->findings("EFC-2")->empty());
  ASSERT_TRUE(store_->add_finding({.serial = "EFC-2", .cause = "none", .found_by = "kim", .found_at = {}, .note = ""}));
  const auto newest = store_->newest_findings(2);
  ASSERT_EQ(newest->size(), 2u);
  EXPECT_EQ(newest->at(0).serial, "EFC-2");
  EXPECT_EQ(newest->at(1).cause, "friction");
}

TEST_P(StoreContract, FindsATokenByItsSecretUntilItIsRevoked) {
  const auto token =
      store_->add_token({.name = "ci", .secret_sha256 = sha256_hex("secret"), .scopes = {"submit", "read"}});
  ASSERT_TRUE(token);
  EXPECT_EQ(store_->token_by_secret(sha256_hex("secret"))->scopes, (std::vector<std::string>{"submit", "read"}));
  EXPECT_EQ(store_->token_by_secret(sha256_hex("other")).error().code, "not_found");
  ASSERT_TRUE(store_->revoke_token(token->id, "local"));
  EXPECT_EQ(store_->token_by_secret(sha256_hex("secret")).error().code, "not_found");
  EXPECT_EQ(store_->revoke_token(token->id, "local").error().code, "not_found");
  EXPECT_EQ(store_->list_tokens()->at(0).revoked_at, clock_.utc_ms());
}

TEST_P(StoreContract, TellsEveryChangeOnceInOrder) {
  EXPECT_EQ(store_->newest_event(), 0);
  const Accepted accepted = accept(alone(a_valve("lot-a", "EFC-1"), "one"));
  const JobRow job = claim();
  ASSERT_TRUE(store_->heartbeat(job.lease(), kLeaseMs, 0.5, "fitting"));
  ASSERT_TRUE(store_->heartbeat(job.lease(), kLeaseMs, 0.5, "fitting"));
  ASSERT_TRUE(store_->finish(job.lease(), an_analysis("Good")));
  std::vector<std::string> kinds;
  std::int64_t cursor = 0;
  for (;;) {
    const auto events = store_->events_after(cursor, 2);
    ASSERT_TRUE(events);
    if (events->empty()) break;
    for (const EventRow& event : *events) {
      EXPECT_GT(event.cursor, cursor);
      cursor = event.cursor;
      kinds.push_back(event.kind);
    }
  }
  EXPECT_EQ(kinds, (std::vector<std::string>{"recording.accepted", "job.queued", "job.running", "job.progress",
                                             "job.done", "analysis.stored"}));
  EXPECT_EQ(store_->newest_event(), cursor);
}

// --- operations ------------------------------------------------------------------------------------------------------

TEST_P(StoreContract, KnowsWhichBlobsAreNamed) {
  accept(together(Labels{}, {"one", "two"}));
  accept(alone(Labels{}, "one"));
  EXPECT_TRUE(*store_->blob_is_referenced(sha256_hex("one")));
  EXPECT_FALSE(*store_->blob_is_referenced(sha256_hex("three")));
  std::vector<std::string> all{sha256_hex("one"), sha256_hex("two")};
  std::sort(all.begin(), all.end());
  EXPECT_EQ(*store_->referenced_blobs("", 10), all);
  EXPECT_EQ(*store_->referenced_blobs(all[0], 10), std::vector<std::string>{all[1]});
}

TEST_P(StoreContract, FindsNothingWrongWithItself) {
  analysed(alone(a_valve("lot-a", "EFC-1"), "one"), an_analysis("Good"));
  accept(alone(a_valve("lot-a", "EFC-2"), "two"));
  EXPECT_TRUE(store_->probe());
  const auto damages = store_->check();
  ASSERT_TRUE(damages) << damages.error().message;
  EXPECT_EQ(*damages, std::vector<std::string>{});
}

const Implementation kSqlite{"Sqlite", [](const std::string& folder, const Clock& clock) {
                               return open_sqlite_store(folder + "/valvetriage.sqlite",
                                                        {.clock = &clock, .readers = 2});
                             }};

INSTANTIATE_TEST_SUITE_P(Every, StoreContract, testing::Values(kSqlite),
                         [](const auto& tested) { return tested.param.name; });

}  // namespace
}  // namespace valvetriage
