#include "server/jobs/worker.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>

#include "server/jobs/accept.h"
#include "server/store/sqlite/sqlite_store.h"
#include "server/wire/sha256.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::int64_t kWorkerMemoryBytes = INT64_MAX;  // a sanitizer maps terabytes of shadow memory
#else
constexpr std::int64_t kWorkerMemoryBytes = std::int64_t{512} << 20;
#endif

class Worker : public testing::Test {
 protected:
  std::unique_ptr<WorkerPool> start(std::int64_t wall_ms = 60'000) {
    WorkerOptions options;
    options.workers = 2;
    options.child_command = {VALVETRIAGE_FAKE_CHILD};
    options.child.memory_bytes = kWorkerMemoryBytes;
    options.child.wall_ms = wall_ms;
    options.poll_ms = 10;
    return std::make_unique<WorkerPool>(*store_, *blobs_, options);
  }

  /// Uploads a recording whose analysis will `act`; its job.
  std::string submit(const std::string& act) {
    auto writer = blobs_->begin(1 << 20);
    EXPECT_TRUE(writer->write("bytes"));
    AcceptRequest request{.labels = {}, .files = {{.name = "a.csv", .blob = *writer->commit(), .test = {}}}};
    request.labels.valve_type = "type-1";
    request.options_json = R"({"do":")" + act + R"("})";
    return accept_submission(*store_, request)->submission.job_id;
  }

  JobRow wait_until(const std::string& job_id, const std::function<bool(const JobRow&)>& reached) {
    for (int tick = 0; tick < 6'000; ++tick) {
      const auto job = store_->job(job_id);
      if (job && reached(*job)) return *job;
      ::usleep(10'000);
    }
    ADD_FAILURE() << "the job never got there";
    return {};
  }
  JobRow wait_for(const std::string& job_id, JobState state) {
    return wait_until(job_id, [&](const JobRow& job) { return job.state == state; });
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Store> store_ = std::move(*open_sqlite_store(folder_.file("db")));
  std::unique_ptr<BlobStore> blobs_ = std::move(*BlobStore::open(folder_.path()));
};

TEST_F(Worker, RunsAJobInAChildAndStoresItsResult) {
  ASSERT_TRUE(
      store_->add_document(DocumentKind::kReference, "type-1", R"({"r":1})", sha256_hex(R"({"r":1})"), "local"));
  const auto pool = start();
  const JobRow job = wait_for(submit("succeed"), JobState::kDone);
  EXPECT_EQ(*store_->analysis_body(*job.analysis_id), R"({"files":1,"reference":"{\"r\":1}"})");
  EXPECT_EQ(store_->submission(job.submission_id)->summary.verdict, "Good");
}

TEST_F(Worker, RejectsBadInputWithItsProblem) {
  const auto pool = start();
  const JobRow job = wait_for(submit("reject"), JobState::kRejected);
  EXPECT_EQ(job.problem_json, R"({"code":"not_a_number","detail":"line 3: 'x'","line":3})");
  EXPECT_EQ(job.attempt, 1);
}

TEST_F(Worker, TriesAgainWhatPassesAndWhatCrashesAndGoesOnWithOthers) {
  const auto pool = start();
  const std::string fault = submit("fault");
  const std::string crash = submit("segv");
  const std::string silent = submit("silent");
  wait_for(submit("succeed"), JobState::kDone);
  const auto queued_again = [](const JobRow& job) { return job.state == JobState::kQueued && job.attempt >= 1; };
  EXPECT_EQ(wait_until(fault, queued_again).crashes, 0);
  EXPECT_GE(wait_until(crash, queued_again).crashes, 1);
  EXPECT_GE(wait_until(silent, queued_again).crashes, 1);
}

TEST_F(Worker, KillsTheChildOfACancelledJobAndKeepsNoResult) {
  const auto pool = start();
  const std::string job_id = submit("hang");
  wait_for(job_id, JobState::kRunning);
  ASSERT_TRUE(store_->cancel(job_id, "local"));
  for (int tick = 0; pool->busy() > 0 && tick < 500; ++tick) ::usleep(10'000);
  EXPECT_EQ(pool->busy(), 0);
  EXPECT_EQ(store_->job(job_id)->state, JobState::kCancelled);
}

TEST_F(Worker, TellsWhatAJobIsAtLongBeforeItsLeaseIsProlonged) {
  const auto pool = start();
  const std::string job_id = submit("begin and hang");
  wait_for(job_id, JobState::kRunning);
  for (int tick = 0; store_->job(job_id)->progress_note.empty() && tick < 500; ++tick) ::usleep(10'000);
  EXPECT_EQ(store_->job(job_id)->progress_note, "fitting");
  EXPECT_DOUBLE_EQ(store_->job(job_id)->progress, 0.25);
  ASSERT_TRUE(store_->cancel(job_id, "local"));
}

TEST_F(Worker, HandsARunningJobBackWhenDrainedAndDoesNotCountTheAttempt) {
  auto pool = start();
  const std::string job_id = submit("hang");
  wait_for(job_id, JobState::kRunning);
  pool->drain();
  const auto job = store_->job(job_id);
  EXPECT_EQ(job->state, JobState::kQueued);
  EXPECT_EQ(job->attempt, 0);
  EXPECT_EQ(pool->busy(), 0);
}

TEST_F(Worker, GivesATimeoutOneMoreTry) {
  const auto pool = start(/*wall_ms=*/100);
  const JobRow job = wait_for(submit("hang"), JobState::kFailed);
  EXPECT_EQ(job.attempt, 2);
}

TEST_F(Worker, FailsAJobWhoseBytesHaveChanged) {
  const std::string job_id = submit("succeed");
  const std::string blob = blobs_->path_of(sha256_hex("bytes"));
  ASSERT_EQ(::unlink(blob.c_str()), 0);
  std::ofstream(blob) << "other";
  const auto pool = start();
  const JobRow job = wait_for(job_id, JobState::kFailed);
  EXPECT_NE(job.problem_json->find("blob_damaged"), std::string::npos);
}

TEST_F(Worker, TakesOverWhatADeadServerLeftRunning) {
  const std::string job_id = submit("succeed");
  ASSERT_TRUE(*store_->claim("a server that died", 3'600'000));
  const auto pool = start();
  EXPECT_EQ(wait_for(job_id, JobState::kDone).attempt, 1);
}

}  // namespace
}  // namespace valvetriage
