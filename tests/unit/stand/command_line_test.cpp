#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/stand/acquisition.h"
#include "tests/stand/effects.h"

namespace valvetriage::stand {
namespace {

namespace fs = std::filesystem;

class CommandLine : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              (std::string("stand_cli_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  int run(const std::string& arguments) const {
    const std::string command = "cd '" + folder_.string() + "' && '" VALVETRIAGE_STAND "' " + arguments + " >out 2>err";
    return WEXITSTATUS(std::system(command.c_str()));
  }
  std::string text(const std::string& name) const {
    std::ifstream file(folder_ / name);
    std::ostringstream all;
    all << file.rdbuf();
    return all.str();
  }
  fs::path folder_;
};

TEST_F(CommandLine, SessionWritesRecordingsTruthAndCleanOutputsApart) {
  ASSERT_EQ(
      run("session --out s --serial S --lot L --tests step_up --effect friction=0.02 --decoy jitter --truth t.json "
          "--clean c"),
      0);
  EXPECT_TRUE(fs::exists(folder_ / "s/step_up_1.6A.csv"));
  EXPECT_TRUE(fs::exists(folder_ / "c/step_up_1.6A.csv"));
  EXPECT_NE(text("t.json").find("\"effect\": \"friction\""), std::string::npos);
  EXPECT_EQ(text("s/step_up_1.6A.csv").find("friction"), std::string::npos);
}

TEST_F(CommandLine, SignatureHoldsBothTwins) {
  ASSERT_EQ(run("signature --out g --tests step_up --effect leakage=0.1"), 0);
  EXPECT_TRUE(text("g/step_up_1.6A.csv").starts_with("time_s,command_A,healthy_psi,effect_psi\n"));
}

TEST_F(CommandLine, FleetsAreFoldersBySerial) {
  ASSERT_EQ(run("population --out p --valves 3 --tests step_up"), 0);
  EXPECT_TRUE(fs::exists(folder_ / "p/GOOD-003/step_up_1.6A.csv"));
  ASSERT_EQ(run("lot --out l --lot X --valves 12 --tests step_up --truth t.json"), 0);
  EXPECT_TRUE(fs::exists(folder_ / "l/EFC-104212/step_up_1.6A.csv"));
  EXPECT_FALSE(fs::exists(folder_ / "l/t.json"));
  ASSERT_EQ(run("labelled --out b --valves 6 --tests step_up"), 0);
  EXPECT_TRUE(
      text("b/labels.csv").starts_with("serial,verdict\nLAB-001,Good\nLAB-002,Malfunctioned\nLAB-003,Severe\n"));
}

TEST_F(CommandLine, MotionIsUnitless) {
  ASSERT_EQ(run("motion --out m --effect rectified_sensor=1"), 0);
  EXPECT_NE(text("m/low.csv").find("\ntime_s,u,y\n"), std::string::npos);
}

TEST_F(CommandLine, GivenCurrentIsPlayed) {
  std::ofstream(folder_ / "plan.csv") << "time_s,current_A\n0,1.0\n0.005,1.0\n0.010,1.4\n0.015,1.4\n";
  ASSERT_EQ(run("session --out s --serial S --lot L --tests none --input plan.csv"), 0);
  EXPECT_TRUE(fs::exists(folder_ / "s/plan.csv"));
}

TEST_F(CommandLine, WrongUseIsSaidAndExitsWithTwo) {
  for (const char* arguments :
       {"", "dance", "session --out s --serial S", "session --out s --serial S --lot L --effect friction",
        "session --out s --serial S --lot L --effect rust=1", "session --out s --serial S --lot L --tests jump",
        "session --out s --serial S --lot L --tests none", "session --out", "population --out p --valves many",
        "lot --out l --colour red --lot L"}) {
    EXPECT_EQ(run(arguments), 2) << arguments;
    EXPECT_FALSE(text("err").empty()) << arguments;
  }
}

TEST_F(CommandLine, ReadmeTellsOfEveryEffectAndDecoy) {
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/tests/stand/README.md");
  std::ostringstream readme;
  readme << file.rdbuf();
  for (const EffectInfo& info : effect_table())
    EXPECT_NE(readme.str().find("| `" + info.effect + "` |"), std::string::npos) << info.effect;
  for (const DecoyInfo& info : decoy_table())
    EXPECT_NE(readme.str().find("| `" + info.decoy + "` |"), std::string::npos) << info.decoy;
}

}  // namespace
}  // namespace valvetriage::stand
