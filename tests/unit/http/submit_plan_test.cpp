#include "server/http/submit_plan.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/contract/mat_file.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage::http {
namespace {

class SubmitPlan : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& head) {
    const std::filesystem::path file = folder_.file(name);
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << head << "time_s,current_A,pressure_psi\n";
    return file.string();
  }
  static std::vector<std::size_t> sizes(const std::vector<PlannedSubmission>& plan) {
    std::vector<std::size_t> all;
    for (const PlannedSubmission& one : plan) all.push_back(one.files.size());
    return all;
  }

  test::TemporaryFolder folder_;
};

TEST_F(SubmitPlan, MakesOneSubmissionOfEveryFolderThatHoldsRecordings) {
  write("lot/valve-1/a.csv", "");
  write("lot/valve-1/b.csv.gz", "");
  write("lot/valve-1/notes.txt", "");
  write("lot/valve-2/a.json", "");
  const auto plan = plan_submissions({folder_.file("lot")}, {});
  ASSERT_TRUE(plan);
  EXPECT_EQ(sizes(*plan), (std::vector<std::size_t>{2, 1}));
}

TEST_F(SubmitPlan, WalksIntoNoLinkedFolderSoThatALinkUpwardsIsNoCircle) {
  write("lot/valve-1/a.csv", "");
  std::filesystem::create_directory_symlink(folder_.file("lot"), folder_.file("lot/valve-1/up"));
  const auto plan = plan_submissions({folder_.file("lot")}, {});
  ASSERT_TRUE(plan) << plan.error().message;
  EXPECT_EQ(sizes(*plan), std::vector<std::size_t>{1});
}

TEST_F(SubmitPlan, ANameThatNoFileCanHaveIsAFileThatCannotBeRead) {
  EXPECT_FALSE(plan_submissions({std::string(300, 'x')}, {}));
}

TEST_F(SubmitPlan, GroupsFilesByLotAndSerialOfTheirHeads) {
  const auto plan =
      plan_submissions({write("1.csv", "# serial: A\n# lot: x\n"), write("2.csv", "# serial: B\n# lot: x\n"),
                        write("3.csv", "# lot: x\n# serial: A\n"), write("4.csv", "# serial: A\n# lot: y\n"),
                        write("5.csv", ""), write("6.csv", "")},
                       {});
  ASSERT_TRUE(plan);
  EXPECT_EQ(sizes(*plan), (std::vector<std::size_t>{2, 1, 1, 1, 1}));
  EXPECT_EQ((*plan)[0].title, "x A");
}

TEST_F(SubmitPlan, GroupsMatFilesByTheLabelsInsideThem) {
  std::vector<std::string> files;
  for (const char* serial : {"A", "B", "A"}) {
    files.push_back(folder_.file(std::to_string(files.size()) + ".mat"));
    std::ofstream(files.back(), std::ios::binary) << test::good_mat({{"serial", serial}, {"lot", "x"}});
  }
  files.push_back(write("damaged.mat", "MATLAB 5.0"));
  const auto plan = plan_submissions(files, {});
  ASSERT_TRUE(plan);
  EXPECT_EQ(sizes(*plan), (std::vector<std::size_t>{2, 1, 1}));
  EXPECT_EQ((*plan)[0].title, "x A");
}

TEST_F(SubmitPlan, TakesTheCommandLinesSerialWhereFilesSayNone) {
  Metadata labels;
  labels.serial = "A";
  const auto plan = plan_submissions({write("1.csv", ""), write("2.csv", "")}, labels);
  ASSERT_TRUE(plan);
  EXPECT_EQ(sizes(*plan), std::vector<std::size_t>{2});
}

TEST_F(SubmitPlan, NamesTheFileOrFolderThatCannotBeSent) {
  EXPECT_EQ(plan_submissions({folder_.file("none.csv")}, {}).error().file, folder_.file("none.csv"));
  EXPECT_EQ(plan_submissions({folder_.path()}, {}).error().code, "no_recordings");
}

TEST_F(SubmitPlan, KeysAnUploadByItsRouteAndContent) {
  const std::string a = write("a.csv", "# serial: A\n"), b = write("b.csv", "# serial: B\n");
  EXPECT_EQ(*content_key("/v1/recordings", {a}), *content_key("/v1/recordings", {a}));
  EXPECT_NE(*content_key("/v1/recordings", {a}), *content_key("/v1/recordings", {b}));
  EXPECT_NE(*content_key("/v1/recordings", {a}), *content_key("/v1/recordings?lot=x", {a}));
}

}  // namespace
}  // namespace valvetriage::http
