// What is left after a power cut: only what was synced. This program's own fsync and fdatasync stand in front of the
// system's, for our files as for SQLite's, and keep an image of what the disk is sure to hold after each of them.
#include <dirent.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <mutex>

#include "server/jobs/accept.h"
#include "server/store/backup.h"
#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

/// Contents by inode as of their last sync; names by folder as of the folder's last sync.
struct DiskImage {
  std::map<ino_t, std::string> contents;
  std::map<std::string, std::map<std::string, ino_t>> folders;

  void write_to(const std::string& from, const std::string& to) const {
    for (const auto& [folder, names] : folders) {
      const std::string copy = to + folder.substr(from.size());
      std::filesystem::create_directories(copy);
      for (const auto& [name, inode] : names) {
        const auto content = contents.find(inode);
        if (folders.count(folder + "/" + name) == 0) {
          std::ofstream(copy + "/" + name) << (content == contents.end() ? "" : content->second);
        }
      }
    }
  }
};

/// What the syncs of this process did, while `watching`.
struct Disk {
  std::mutex mutex;
  bool watching = false;
  int syncs = 0;
  int fail_at = 0;
  DiskImage image;
  std::function<void()> after_sync = [] {};

  void note(int fd) {
    std::string path(4096, '\0');
    path.resize(static_cast<std::size_t>(
        std::max<ssize_t>(0, ::readlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), path.data(), path.size()))));
    struct stat info {};
    ::fstat(fd, &info);
    if (S_ISDIR(info.st_mode)) {
      auto& names = image.folders[path];
      names.clear();
      for (const auto& entry : std::filesystem::directory_iterator(path)) {
        struct stat named {};
        if (::lstat(entry.path().c_str(), &named) == 0) names[entry.path().filename()] = named.st_ino;
      }
    } else {
      std::ifstream file("/proc/self/fd/" + std::to_string(fd), std::ios::binary);
      image.contents[info.st_ino] = std::string(std::istreambuf_iterator<char>(file), {});
    }
  }
};

Disk disk;

int synced(int fd, long system_call) {
  const std::lock_guard lock(disk.mutex);
  if (disk.watching && ++disk.syncs == disk.fail_at) {
    errno = EIO;
    return -1;
  }
  const int status = static_cast<int>(::syscall(system_call, fd));
  if (disk.watching && status == 0) {
    disk.note(fd);
    disk.after_sync();
  }
  return status;
}

}  // namespace
}  // namespace valvetriage

extern "C" int fsync(int fd) {
  return valvetriage::synced(fd, SYS_fsync);
}
extern "C" int fdatasync(int fd) {
  return valvetriage::synced(fd, SYS_fdatasync);
}

namespace valvetriage {
namespace {

class Durability : public testing::Test {
 protected:
  void SetUp() override {
    disk.syncs = 0;
    disk.fail_at = 0;
    disk.image = {};
    disk.watching = true;
  }
  void TearDown() override {
    disk.watching = false;
    disk.after_sync = [] {};
  }

  Result<Accepted> upload(Store& store, BlobStore& blobs, const std::string& bytes) {
    auto writer = blobs.begin(1 << 20);
    if (!writer) return tl::unexpected(writer.error());
    const auto blob = writer->write(bytes).and_then([&] { return writer->commit(); });
    if (!blob) return tl::unexpected(blob.error());
    return accept_submission(
        store, {.labels = test::a_valve("lot-a", bytes), .files = {{.name = "a", .blob = *blob, .test = {}}}});
  }

  test::TemporaryFolder folder_;
};

TEST_F(Durability, LosesNothingThatWasAnsweredWheneverThePowerFails) {
  struct Cut {
    DiskImage image;
    std::vector<std::string> answered;
  };
  std::vector<Cut> cuts;
  std::vector<std::string> answered;
  {
    const auto store = std::move(*open_sqlite_store(folder_.file("db")));
    const auto blobs = std::move(*BlobStore::open(folder_.path()));
    disk.after_sync = [&] { cuts.push_back({disk.image, answered}); };
    for (int i = 0; i < 8; ++i) {
      const auto accepted = upload(*store, *blobs, "bytes " + std::to_string(i));
      ASSERT_TRUE(accepted);
      const std::lock_guard lock(disk.mutex);
      answered.push_back(accepted->recordings.at(0).id);
      cuts.push_back({disk.image, answered});
    }
    disk.watching = false;
  }
  EXPECT_GE(cuts.size(), 8u * 5) << "file, folder, log and the answer itself, each time";
  for (std::size_t cut = 0; cut < cuts.size(); ++cut) {
    SCOPED_TRACE("cut " + std::to_string(cut));
    const test::TemporaryFolder after;
    cuts[cut].image.write_to(folder_.path(), after.path());
    const auto store = open_sqlite_store(after.file("db"));
    ASSERT_TRUE(store) << store.error().message;
    const auto blobs = std::move(*BlobStore::open(after.path()));
    EXPECT_EQ(*check_everything(**store, *blobs), std::vector<std::string>{});
    for (const std::string& id : cuts[cut].answered) {
      const auto row = (*store)->recording(id);
      ASSERT_TRUE(row);
      EXPECT_TRUE(blobs->verify(row->sha256));
      EXPECT_EQ((*store)->job(row->job_id)->state, JobState::kQueued);
    }
  }
}

TEST_F(Durability, AnswersNothingAfterASyncThatFailedUntilItIsOpenedAgain) {
  std::vector<std::string> answered;
  // Each sync of three uploads fails once.
  for (int fail_at = 1, last = 0; last == 0; ++fail_at) {
    const test::TemporaryFolder folder;
    answered.clear();
    {
      disk.watching = false;
      const auto store = std::move(*open_sqlite_store(folder.file("db")));
      const auto blobs = std::move(*BlobStore::open(folder.path()));
      disk.syncs = 0;
      disk.fail_at = fail_at;
      disk.watching = true;
      bool broken = false;
      for (int i = 0; i < 3; ++i) {
        const auto accepted = upload(*store, *blobs, "bytes " + std::to_string(i));
        EXPECT_FALSE(broken && accepted) << "after the database's log could not be synced nothing is answered";
        broken = broken || (!accepted && accepted.error().code == "store_broken");
        if (accepted) answered.push_back(accepted->recordings.at(0).id);
      }
      if (broken) {
        EXPECT_EQ(store->probe().error().code, "store_broken");
      }
      last = disk.syncs < fail_at ? fail_at : 0;
      disk.fail_at = 0;
    }
    disk.watching = false;
    const auto store = std::move(*open_sqlite_store(folder.file("db")));
    for (const std::string& id : answered) EXPECT_TRUE(store->recording(id)) << "failed sync " << fail_at;
    EXPECT_EQ(*store->check(), std::vector<std::string>{});
    ASSERT_LT(fail_at, 100);
  }
  EXPECT_EQ(answered.size(), 3u) << "the last round saw no fault";
}

TEST_F(Durability, ProvesWithAProbeThatAWriteWouldBeDurable) {
  disk.watching = false;
  const auto store = std::move(*open_sqlite_store(folder_.file("db")));
  disk.syncs = 0;
  disk.watching = true;
  ASSERT_TRUE(store->probe());
  EXPECT_GE(disk.syncs, 1) << "a probe that syncs nothing proves nothing";
}

}  // namespace
}  // namespace valvetriage
