#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "tests/second_stand/acquisition.h"
#include "tests/second_stand/effects.h"

namespace valvetriage::second_stand {
namespace {

namespace fs = std::filesystem;

class Program : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              (std::string("second_stand_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  int run(const std::string& arguments) const {
    const std::string line =
        "cd '" + folder_.string() + "' && '" VALVETRIAGE_SECOND_STAND "' " + arguments + " >out 2>err";
    return WEXITSTATUS(std::system(line.c_str()));
  }
  std::string text(const fs::path& file) const {
    std::ifstream in(folder_ / file);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  fs::path folder_;
};

TEST_F(Program, SessionKeepsTheTruthApart) {
  ASSERT_EQ(run("session --out s --serial S --lot L --tests step_up --effect friction=0.02 --decoy jitter --truth "
                "t.json --clean c"),
            0);
  EXPECT_NE(text("t.json").find("\"effect\": \"friction\""), std::string::npos);
  EXPECT_EQ(text("s/step_up_1.6A.csv").find("friction"), std::string::npos);
  EXPECT_TRUE(text("c/step_up_1.6A.csv").starts_with("time_s,pressure_psi,command_A\n"));
}

TEST_F(Program, EqualArgumentsGiveEqualBytes) {
  for (const char* out : {"a", "b"})
    ASSERT_EQ(run(std::string("session --serial S --lot L --tests step_up --decoy spikes --out ") + out), 0);
  EXPECT_EQ(text("a/step_up_1.6A.csv"), text("b/step_up_1.6A.csv"));
  ASSERT_EQ(run("session --serial S --lot L --tests step_up --decoy spikes --noise-seed 2 --out c"), 0);
  EXPECT_NE(text("a/step_up_1.6A.csv"), text("c/step_up_1.6A.csv"));
}

TEST_F(Program, PopulationIsAFolderPerValve) {
  ASSERT_EQ(run("population --out p --valves 3 --tests step_up"), 0);
  EXPECT_TRUE(fs::exists(folder_ / "p/GOOD-003/step_up_1.6A.csv"));
}

TEST_F(Program, GivenCurrentIsPlayed) {
  std::ofstream(folder_ / "plan.csv") << "time_s,current_A\n0,1.0\n0.005,1.0\n0.010,1.4\n0.015,1.4\n";
  ASSERT_EQ(run("session --out s --serial S --lot L --tests none --input plan.csv"), 0);
  EXPECT_TRUE(fs::exists(folder_ / "s/plan.csv"));
}

TEST_F(Program, DistancesAreAnsweredLineByLine) {
  std::ofstream(folder_ / "cases") << "single step_up 1 2 sensor_offset=5\nsingle step_up 1 2 sensor_offset=10\n";
  ASSERT_EQ(run("distance < cases"), 0);
  std::istringstream answers(text("out"));
  double small = 0, large = 0;
  std::string rest;
  answers >> small;
  std::getline(answers, rest);
  answers >> large;
  EXPECT_EQ(rest, " nan nan -");
  EXPECT_NEAR(large / small, 2, 0.01);
}

TEST_F(Program, WrongUseIsSaidAndExitsWithTwo) {
  for (const char* arguments :
       {"", "dance", "session --out s --serial S", "session --out s --serial S --lot L --effect friction",
        "session --out s --serial S --lot L --effect rust=1",
        "session --out s --serial S --lot L --effect friction=much", "session --out s --serial S --lot L --tests jump",
        "session --out s --serial S --lot L --tests none", "population --out p --valves many"}) {
    EXPECT_EQ(run(arguments), 2) << arguments;
    EXPECT_FALSE(text("err").empty()) << arguments;
  }
}

TEST_F(Program, ReadmeTellsOfEveryEffectAndDecoy) {
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/tests/second_stand/README.md");
  const std::string readme{std::istreambuf_iterator<char>(file), {}};
  for (const EffectKind& kind : effect_kinds())
    EXPECT_NE(readme.find("| `" + kind.name + "` |"), std::string::npos) << kind.name;
  for (const Decoy& decoy : decoys())
    EXPECT_NE(readme.find("| `" + decoy.name + "` |"), std::string::npos) << decoy.name;
}

}  // namespace
}  // namespace valvetriage::second_stand
