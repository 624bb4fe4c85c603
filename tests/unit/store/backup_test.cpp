#include "server/store/backup.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <thread>

#include "server/jobs/accept.h"
#include "server/store/sqlite/connection.h"
#include "server/store/sqlite/operations.h"
#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

class Backup : public testing::Test {
 protected:
  std::string upload(const std::string& bytes) {
    auto writer = blobs_->begin(1 << 20);
    EXPECT_TRUE(writer->write(bytes));
    const auto accepted = accept_submission(*store_, {.labels = test::a_valve("lot-a", bytes),
                                                      .files = {{.name = "a", .blob = *writer->commit(), .test = {}}}});
    EXPECT_TRUE(accepted);
    return accepted->recordings.at(0).id;
  }

  Result<BackupReport> restore_here(const std::string& name) {
    return restore(folder_.file("backup"), folder_.file(name + ".sqlite"), folder_.file(name));
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Store> store_ = std::move(*open_sqlite_store(folder_.file("db")));
  std::unique_ptr<BlobStore> blobs_ = std::move(*BlobStore::open(folder_.file("data")));
};

TEST_F(Backup, ACountThatIsLostIsFoundAsAWrongOneIs) {
  upload("one");
  for (const auto& [lost, damage] :
       {std::pair("DELETE FROM job_counts", "jobs are miscounted"),
        {"DELETE FROM lot_counts", "a lot's valves are miscounted"},
        {"INSERT INTO lot_counts VALUES ('lot-a', 1, 'Good', 1)", "a lot's valves are miscounted"},
        {"UPDATE lot_counts SET analysed = 0, verdict = 'Good'", "a lot's valves are miscounted"},
        {"DELETE FROM lots", "a lot has valves and no row of its own"}}) {
    store_.reset();
    sqlite::Connection(folder_.file("db"), sqlite::Access::kWrite).run(lost);
    store_ = std::move(*open_sqlite_store(folder_.file("db")));
    const auto damages = *store_->check();
    EXPECT_TRUE(std::ranges::any_of(damages, [&](const auto& said) { return said.starts_with(damage); })) << damage;
  }
}

TEST_F(Backup, TakenUnderLoadRestoresToASoundWhole) {
  std::vector<std::string> before;
  for (int i = 0; i < 20; ++i) before.push_back(upload("before " + std::to_string(i)));
  std::atomic<bool> stop = false;
  std::thread load([&] {
    for (int i = 0; !stop; ++i) upload("during " + std::to_string(i));
  });
  const auto reader = open_sqlite_reader(folder_.file("db"));
  const auto report = back_up(**reader, *blobs_, folder_.file("backup"));
  stop = true;
  load.join();
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_GE(report->blobs, 20);

  const auto restored = restore_here("restored");
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_EQ(restored->blobs, report->blobs);
  const auto store = std::move(*open_sqlite_store(folder_.file("restored.sqlite")));
  const auto blobs = std::move(*BlobStore::open(folder_.file("restored")));
  EXPECT_EQ(*check_everything(*store, *blobs), std::vector<std::string>{});
  for (const std::string& id : before) EXPECT_EQ(blobs->verify(store->recording(id)->sha256).has_value(), true);
}

TEST_F(Backup, WaitsForAFileThatIsLockedForAMoment) {
  upload("bytes");
  const std::string target = folder_.file("copy");
  sqlite::Connection other(target, sqlite::Access::kWrite);
  other.script("PRAGMA journal_mode = DELETE; BEGIN EXCLUSIVE");
  std::thread lets_go([&] {
    ::usleep(50'000);
    other.script("ROLLBACK");
  });
  sqlite::Connection source(folder_.file("db"), sqlite::Access::kRead);
  EXPECT_NO_THROW(EXPECT_TRUE(sqlite::backup(source, target)));
  lets_go.join();
}

TEST_F(Backup, IsAsTheDatabaseOpenToItsOwnerAndGroupOnlyWhateverTheMaskOfTheProcess) {
  const mode_t before = ::umask(0);
  const auto store = open_sqlite_store(folder_.file("own"));
  const auto made = (*store)->backup(folder_.file("copy"));
  ::umask(before);
  ASSERT_TRUE(made) << made.error().message;
  for (const char* name : {"own", "own-wal", "own-shm", "own.lock", "copy"}) {
    struct stat status {};
    ASSERT_EQ(::stat(folder_.file(name).c_str(), &status), 0) << name;
    EXPECT_EQ(status.st_mode & 0777, 0640u) << name;
  }
}

TEST_F(Backup, RefusesToOverwriteABackupOrADatabase) {
  upload("bytes");
  ASSERT_TRUE(back_up(*store_, *blobs_, folder_.file("backup")));
  EXPECT_EQ(back_up(*store_, *blobs_, folder_.file("backup")).error().code, "already_there");
  ASSERT_TRUE(restore_here("restored"));
  EXPECT_EQ(restore_here("restored").error().code, "already_there");
}

TEST_F(Backup, RestoresNothingFromADamagedOne) {
  upload("bytes");
  ASSERT_TRUE(back_up(*store_, *blobs_, folder_.file("backup")));
  const auto copy = std::move(*BlobStore::open(folder_.file("backup")));
  const std::string path = copy->path_of(sha256_hex("bytes"));
  ASSERT_EQ(::unlink(path.c_str()), 0);
  std::ofstream(path) << "other";
  EXPECT_EQ(restore_here("restored").error().code, "blob_damaged");
  EXPECT_NE(::access(folder_.file("restored.sqlite").c_str(), F_OK), 0) << "without a database it does not count";
}

TEST_F(Backup, SaysWhichBlobIsDamaged) {
  upload("bytes");
  EXPECT_EQ(*check_everything(*store_, *blobs_), std::vector<std::string>{});
  ASSERT_EQ(::unlink(blobs_->path_of(sha256_hex("bytes")).c_str()), 0);
  const auto damages = check_everything(*store_, *blobs_);
  ASSERT_EQ(damages->size(), 1u);
  EXPECT_NE(damages->front().find(sha256_hex("bytes")), std::string::npos);
}

}  // namespace
}  // namespace valvetriage
