#include "server/jobs/accept.h"

#include <gtest/gtest.h>

#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

class Accept : public testing::Test {
 protected:
  AcceptedFile upload(const std::string& name, const std::string& bytes) {
    auto writer = blobs_->begin(1 << 20);
    EXPECT_TRUE(writer && writer->write(bytes));
    auto blob = writer->commit();
    EXPECT_TRUE(blob);
    return {.name = name, .blob = *blob, .test = {}};
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<Store> store_ = std::move(*open_sqlite_store(folder_.file("db")));
  std::unique_ptr<BlobStore> blobs_ = std::move(*BlobStore::open(folder_.path()));
};

TEST_F(Accept, StoresTheBytesUnderTheirHashAndTheRowsThatNameThem) {
  AcceptRequest request{
      .labels = test::a_valve("lot-a", "EFC-1"), .files = {upload("a.csv", "some bytes")}, .alone = true};
  const auto accepted = accept_submission(*store_, request);
  ASSERT_TRUE(accepted);
  EXPECT_EQ(accepted->recordings.at(0).sha256, sha256_hex("some bytes"));
  EXPECT_EQ(*blobs_->read(accepted->recordings.at(0).sha256), "some bytes");
}

TEST_F(Accept, BindsAKeyToEverythingThatWasAsked) {
  const AcceptRequest request{.labels = test::a_valve("lot-a", "EFC-1"), .files = {upload("a.csv", "bytes")}};
  std::vector<AcceptRequest> others(6, request);
  others[0].labels.serial = "EFC-2";
  others[1].files[0].name = "b.csv";
  others[2].files[0].test = "sweep";
  others[3].options_json = R"({"sample_rate_hz":200})";
  others[4].files.push_back(upload("a.csv", "more"));
  others[5].alone = true;
  for (const AcceptRequest& other : others) EXPECT_NE(request_sha256(other), request_sha256(request));
}

TEST_F(Accept, AdmitsUntilTheQueueOrTheDiskIsFull) {
  EXPECT_TRUE(admit(*store_, *blobs_, {.max_queued_jobs = 1, .min_free_bytes = 0}));
  ASSERT_TRUE(accept_submission(*store_, {.labels = {}, .files = {upload("a.csv", "x")}}));
  EXPECT_EQ(admit(*store_, *blobs_, {.max_queued_jobs = 1, .min_free_bytes = 0}).error().code, "overloaded");
  EXPECT_TRUE(admit(*store_, *blobs_, {.max_queued_jobs = 2, .min_free_bytes = 0}));
  EXPECT_EQ(admit(*store_, *blobs_, {.max_queued_jobs = 2, .min_free_bytes = INT64_MAX}).error().code, "no_space");
}

TEST(RetryAfter, IsAQuarterOfTheQueueWithinItsBounds) {
  EXPECT_EQ(retry_after_s(0, 2, 1.0), 1);
  EXPECT_EQ(retry_after_s(80, 2, 1.0), 10);
  EXPECT_EQ(retry_after_s(1'000'000, 2, 1.0), 300);
  EXPECT_EQ(retry_after_s(80, 0, 1.0), 20);
}

}  // namespace
}  // namespace valvetriage
