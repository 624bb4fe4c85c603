#include "server/store/blob_store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "server/jobs/accept.h"
#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/manual_clock.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"
#include "tests/unit/store/faulty_file_system.h"

namespace valvetriage {
namespace {

Result<StoredBlob> put(BlobStore& blobs, std::string_view bytes, std::int64_t max_bytes = 1 << 20) {
  auto writer = blobs.begin(max_bytes);
  if (!writer) return tl::unexpected(writer.error());
  if (const auto written = writer->write(bytes); !written) return tl::unexpected(written.error());
  return writer->commit();
}

class Blobs : public testing::Test {
 protected:
  std::size_t incoming() { return posix_file_system().list(folder_.file("incoming"))->size(); }

  test::TemporaryFolder folder_;
  test::FaultyFileSystem files_;
  std::unique_ptr<BlobStore> blobs_ = std::move(*BlobStore::open(folder_.path(), files_));
};

TEST_F(Blobs, StandUnderTheirHashForReadingOnly) {
  const auto blob = put(*blobs_, "bytes");
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->sha256(), sha256_hex("bytes"));
  EXPECT_EQ(blob->size_bytes(), 5);
  struct stat info {};
  ASSERT_EQ(::stat(blobs_->path_of(blob->sha256()).c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0440u);
  EXPECT_EQ(incoming(), 0u);
}

TEST_F(Blobs, AreStoredOnceHoweverOftenTheyCome) {
  ASSERT_TRUE(put(*blobs_, "bytes"));
  ASSERT_TRUE(put(*blobs_, "bytes"));
  EXPECT_EQ(blobs_->list()->size(), 1u);
}

TEST_F(Blobs, AreNotReadToTheirEndOnceNobodyWantsThem) {
  const auto blob = put(*blobs_, std::string(1 << 18, 'a'));
  int pieces = 0;
  const auto verified = blobs_->verify(blob->sha256(), [&] { return ++pieces < 2; });
  ASSERT_FALSE(verified);
  EXPECT_EQ(verified.error().code, "interrupted");
  EXPECT_EQ(pieces, 2);
}

TEST_F(Blobs, AreNoneOfACallersWhereTheirFolderIsGone) {
  std::filesystem::remove_all(folder_.file("incoming"));
  EXPECT_EQ(blobs_->begin(10).error().code, "io_error");
}

/// The folder of one database's recordings.
class DataFolder : public Blobs {
 protected:
  std::unique_ptr<Store> database(const std::string& name) {
    return std::move(*open_sqlite_store(folder_.file(name), {.readers = 1}));
  }
  void accept_into(Store& store, const std::string& content) {
    ASSERT_TRUE(put(*blobs_, content));
    ASSERT_TRUE(store.accept(test::alone(test::a_valve("lot", "EFC-1"), content)));
  }
  std::string refusal(Store& store) {
    const auto ours = blobs_->belong_to(store);
    return ours ? "" : ours.error().code;
  }
};

TEST_F(DataFolder, BelongsToTheDatabaseThatFirstServedFromIt) {
  const auto first = database("first.sqlite"), second = database("second.sqlite");
  EXPECT_EQ(refusal(*first), "");
  EXPECT_EQ(refusal(*first), "");
  EXPECT_EQ(refusal(*second), "store_mismatch");
}

TEST_F(DataFolder, IsTheDatabasesThatABackupBroughtBack) {
  const auto lost = database("lost.sqlite"), restored = database("restored.sqlite");
  EXPECT_EQ(refusal(*lost), "");
  ASSERT_TRUE(blobs_->adopt(*restored));
  EXPECT_EQ(refusal(*restored), "");
  EXPECT_EQ(refusal(*lost), "store_mismatch");
}

TEST_F(DataFolder, IsNoEmptyDatabasesWhereItHoldsRecordings) {
  const auto served = database("served.sqlite"), empty = database("empty.sqlite");
  accept_into(*served, "bytes");
  EXPECT_EQ(refusal(*empty), "store_mismatch");
  EXPECT_EQ(refusal(*served), "") << "of a version that did not write whose it is";
}

TEST_F(DataFolder, IsNoDatabasesWhoseRecordingsAreElsewhere) {
  const auto served = database("served.sqlite");
  ASSERT_TRUE(served->accept(test::alone(test::a_valve("lot", "EFC-1"), "bytes")));
  EXPECT_EQ(refusal(*served), "store_mismatch");
}

TEST_F(Blobs, MayBeAsLargeAsTheCapAndNoLarger) {
  EXPECT_TRUE(put(*blobs_, "12345", 5));
  const auto refused = put(*blobs_, "123456", 5);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "too_large");
  EXPECT_EQ(incoming(), 0u);
}

TEST_F(Blobs, VanishWithoutACommit) {
  { ASSERT_TRUE(blobs_->begin(10)->write("bytes")); }
  EXPECT_EQ(incoming(), 0u);
  EXPECT_TRUE(blobs_->list()->empty());
}

TEST_F(Blobs, TellWhenTheyWereChanged) {
  const auto blob = put(*blobs_, "bytes");
  const std::string path = blobs_->path_of(blob->sha256());
  ASSERT_TRUE(files_.remove(path));
  EXPECT_EQ(blobs_->read(blob->sha256()).error().code, "not_found");
  std::ofstream(path) << "other";
  EXPECT_EQ(blobs_->read(blob->sha256()).error().code, "blob_damaged");
  EXPECT_EQ(blobs_->verify(blob->sha256()).error().code, "blob_damaged");
}

TEST_F(Blobs, AreSweptWhenNobodyNamesThemAndTheyAreADayOld) {
  const auto store = std::move(*open_sqlite_store(folder_.file("db")));
  const auto named = put(*blobs_, "named");
  ASSERT_TRUE(accept_submission(*store, {.labels = {}, .files = {{.name = "a", .blob = *named, .test = {}}}}));
  ASSERT_TRUE(put(*blobs_, "orphan"));
  std::ofstream(folder_.file("incoming/left")) << "by a server that died";

  EXPECT_EQ(*blobs_->sweep(*store), 1) << "the orphan may still get its row";
  test::ManualClock later;
  later.jump_wall_ms(system_clock().utc_ms() - later.utc_ms() + 25 * 3600 * std::int64_t{1000});
  const auto tomorrow = std::move(*BlobStore::open(folder_.path(), files_, later));
  EXPECT_EQ(*tomorrow->sweep(*store), 1);
  EXPECT_EQ(*tomorrow->list(), std::vector<std::string>{named->sha256()});
  EXPECT_TRUE(std::filesystem::exists(folder_.file("orphans/" + sha256_hex("orphan")))) << "for whoever looks for it";
}

/// Fails every operation of an upload in turn.
TEST_F(Blobs, LeaveNothingHalfDoneWhicheverOperationFails) {
  const auto store = std::move(*open_sqlite_store(folder_.file("db")));
  for (const bool for_ever : {false, true}) {
    int fail_at = 0;
    bool accepted = false;
    while (!accepted) {
      const std::string bytes = (for_ever ? "for ever " : "once ") + std::to_string(++fail_at);
      files_.operations = 0;
      files_.fail_at = fail_at;
      files_.for_ever = for_ever;
      const auto blob = put(*blobs_, bytes);
      const bool fault_was_hit = files_.operations >= fail_at;
      files_.fail_at = 0;
      if (blob) {
        EXPECT_TRUE(blobs_->verify(blob->sha256())) << "what was answered is there";
        accepted = !fault_was_hit;
      } else {
        EXPECT_EQ(blob.error().code, "io_error");
        EXPECT_TRUE(put(*blobs_, bytes)) << "the next one is not harmed";
      }
      ASSERT_LT(fail_at, 100);
    }
    EXPECT_GE(fail_at, 7) << "create, write, mode, sync, shard, rename, folder";
  }
  EXPECT_LE(*blobs_->sweep(*store), 20);
  EXPECT_EQ(incoming(), 0u);
}

}  // namespace
}  // namespace valvetriage
