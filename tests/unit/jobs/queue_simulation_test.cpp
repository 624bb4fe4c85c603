// Many schedules of workers that crash, freeze, wake as zombies, lose leases and are cancelled, on one store with a
// clock that jumps. Whatever the order, every job ends and has at most one result, exactly one where it is done.
#include <gtest/gtest.h>

#include <random>

#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/manual_clock.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

constexpr std::int64_t kLeaseMs = 30'000;
constexpr int kJobs = 6;
constexpr int kStepsPerSchedule = 60;
constexpr int kSchedules = 60;

class Schedule {
 public:
  Schedule(Store& store, test::ManualClock& clock, unsigned seed) : store_(store), clock_(clock), random_(seed) {
    for (int i = 0; i < kJobs; ++i) submit(std::to_string(seed) + "/" + std::to_string(i));
  }

  void run() {
    for (int step = 0; step < kStepsPerSchedule; ++step) act();
    finish_everything();
  }

  void check() {
    for (const auto& [job_id, submission_id] : jobs_) {
      const auto job = store_.job(job_id);
      ASSERT_TRUE(job);
      EXPECT_TRUE(is_final(job->state)) << to_text(job->state);
      const auto analyses = store_.analyses_of(submission_id);
      ASSERT_TRUE(analyses);
      EXPECT_EQ(analyses->size(), job->state == JobState::kDone ? 1u : 0u);
      EXPECT_EQ(accepted_finishes_[job_id], job->state == JobState::kDone ? 1 : 0);
    }
  }

 private:
  void submit(const std::string& content) {
    const auto accepted = store_.accept(test::alone(Labels{}, content));
    ASSERT_TRUE(accepted);
    jobs_.emplace_back(accepted->submission.job_id, accepted->submission.id);
  }

  int dice(int sides) { return std::uniform_int_distribution<int>(0, sides - 1)(random_); }

  /// Any lease ever given, dead ones too: zombies act as well.
  const LeaseToken* some_lease() {
    return leases_.empty() ? nullptr : &leases_[static_cast<std::size_t>(dice(static_cast<int>(leases_.size())))];
  }

  void act() {
    switch (dice(10)) {
      case 0:
      case 1:
      case 2:
        return claim();
      case 3:
      case 4:
        return finish();
      case 5:
        return end(AttemptEnd::kFault);
      case 6:
        return end(dice(2) == 0 ? AttemptEnd::kCrash : AttemptEnd::kReturned);
      case 7:
        return beat();
      case 8:
        if (dice(4) == 0) (void)store_.cancel(jobs_[static_cast<std::size_t>(dice(kJobs))].first, "local");
        return;
      default:
        return pass_time();
    }
  }

  void claim() {
    const auto claimed = store_.claim("worker", kLeaseMs);
    ASSERT_TRUE(claimed);
    if (*claimed) leases_.push_back((*claimed)->lease());
  }

  void finish() {
    const LeaseToken* lease = some_lease();
    if (lease && store_.finish(*lease, test::an_analysis("Good"))) ++accepted_finishes_[lease->job_id];
  }

  void beat() {
    if (const LeaseToken* lease = some_lease()) (void)store_.heartbeat(*lease, kLeaseMs, 0.5, "");
  }

  void end(AttemptEnd how) {
    if (const LeaseToken* lease = some_lease()) (void)store_.end_attempt(*lease, how, "{}");
  }

  void pass_time() {
    clock_.advance_ms(dice(2) == 0 ? 1'000 : 2 * kLeaseMs);
    clock_.jump_wall_ms(dice(3) == 0 ? -3'600'000 : 0);
    ASSERT_TRUE(store_.expire_leases());
    if (dice(8) != 0) return;
    ASSERT_TRUE(store_.release_dead_leases());
  }

  void finish_everything() {
    for (int round = 0; round < 100; ++round) {
      clock_.advance_ms(3'600'000);
      ASSERT_TRUE(store_.expire_leases());
      claim();
      if (leases_.empty()) continue;
      const LeaseToken newest = leases_.back();
      if (store_.finish(newest, test::an_analysis("Good"))) ++accepted_finishes_[newest.job_id];
    }
  }

  Store& store_;
  test::ManualClock& clock_;
  std::mt19937 random_;
  std::vector<std::pair<std::string, std::string>> jobs_;
  std::vector<LeaseToken> leases_;
  std::map<std::string, int> accepted_finishes_;
};

TEST(Queue, GivesEveryJobAtMostOneResultWhateverHappensToItsWorkers) {
  const test::TemporaryFolder folder;
  test::ManualClock clock;
  auto store = open_sqlite_store(folder.file("db"), {.clock = &clock, .readers = 1});
  ASSERT_TRUE(store);
  for (unsigned seed = 1; seed <= kSchedules; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Schedule schedule(**store, clock, seed);
    schedule.run();
    schedule.check();
  }
  EXPECT_EQ(*(*store)->check(), std::vector<std::string>{});
}

}  // namespace
}  // namespace valvetriage
