#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

#include "tests/stand/files.h"
#include "tests/unit/stand/played.h"

namespace valvetriage::stand {
namespace {

/// A reader of its own for the contract's CSV: metadata lines, header, rows of numbers.
struct ReadBack {
  std::map<std::string, std::string> metadata;
  std::vector<std::string> header;
  std::vector<std::vector<double>> rows;
};

ReadBack read_back(const std::string& text) {
  ReadBack back;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("# ")) {
      const std::size_t colon = line.find(": ");
      back.metadata[line.substr(2, colon - 2)] = line.substr(colon + 2);
      continue;
    }
    std::istringstream cells(line);
    std::vector<double> row;
    for (std::string cell; std::getline(cells, cell, ',');) {
      if (back.rows.empty() && std::isalpha(static_cast<unsigned char>(cell[0]))) {
        back.header.push_back(cell);
      } else {
        row.push_back(std::stod(cell));
      }
    }
    if (!row.empty()) back.rows.push_back(row);
  }
  return back;
}

std::filesystem::path scratch_folder() {
  return std::filesystem::path(testing::TempDir()) /
         ("stand_" + std::to_string(testing::UnitTest::GetInstance()->random_seed()));
}

TEST(Files, RecordingIsACsvOfTheContract) {
  const Session session = run_session(session_of({"step", "sweep"}));
  for (const StandRecording& recording : session.recordings) {
    const ReadBack back = read_back(recording_csv(session.options, recording));
    for (const char* key : {"serial", "lot", "valve_type", "condition", "test", "stand", "tested_at"})
      EXPECT_FALSE(back.metadata.at(key).empty()) << key;
    EXPECT_EQ(back.metadata.at("test"), recording.test);
    EXPECT_EQ(back.header,
              (std::vector<std::string>{"time_s", "current_A", "pressure_psi", "temperature_C", "supply_psi"}));
    ASSERT_EQ(back.rows.size(), recording.time_s.size());
    for (std::size_t k = 0; k < back.rows.size(); ++k) {
      ASSERT_EQ(back.rows[k].size(), 5u);
      if (k > 0) {
        EXPECT_GT(back.rows[k][0], back.rows[k - 1][0]);
      }
      EXPECT_NEAR(back.rows[k][2], recording.pressure_psi[k], 0.5e-4 + 1e-12);
    }
  }
}

TEST(Files, TestNamesAreTheContractsWords) {
  for (const std::string& test : repertoire())
    for (const Command& command : commands_of(test)) {
      const std::string& word = command.test;
      EXPECT_TRUE(word == "step" || word == "staircase" || word == "triangle" || word == "sweep" || word == "other")
          << word;
    }
}

TEST(Files, EqualSeedsGiveEqualBytes) {
  const Session a = run_session(session_of({"steps"})), b = run_session(session_of({"steps"}));
  EXPECT_EQ(recording_csv(a.options, a.recordings[0]), recording_csv(b.options, b.recordings[0]));
  EXPECT_EQ(truth_json(a), truth_json(b));
}

TEST(Files, AnotherDayIsTheSameValveWithOtherNoise) {
  SessionOptions other = session_of({"steps"});
  other.noise_seed = 2;
  const Session a = run_session(session_of({"steps"})), b = run_session(other);
  EXPECT_NE(a.recordings[0].pressure_psi, b.recordings[0].pressure_psi);
  EXPECT_EQ(a.unit.map_shift_a, b.unit.map_shift_a);
}

TEST(Files, RecordingDoesNotTellTheTruth) {
  const Session session = run_session(session_of({"step_up"}, {{"friction", 0.02}}));
  EXPECT_EQ(recording_csv(session.options, session.recordings[0]).find("friction"), std::string::npos);
  EXPECT_NE(truth_json(session).find("\"breakaway_A\": {\"value\": 0.02"), std::string::npos);
}

TEST(Files, GivenCurrentIsPlayedAsItStands) {
  const auto path = scratch_folder() / "current.csv";
  write_file(path, "# test: other\ntime_s,current_A\n0,1.0\n0.005,1.0\n0.010,1.4\n0.015,1.4\n0.020,1.41\n");
  const Command command = read_command(path);
  EXPECT_EQ(command.value_a, (std::vector<double>{1.0, 1.0, 1.4, 1.4, 1.41}));
  EXPECT_NEAR(command.period_s, 0.005, 1e-12);
  EXPECT_EQ(command.is_step[2], 1);
  SessionOptions options = session_of({});
  options.inputs = {command};
  EXPECT_EQ(run_session(options).recordings.at(0).clean_psi.size(), 5u);
}

TEST(Files, BadCurrentIsRefusedWithItsPlace) {
  const auto path = scratch_folder() / "bad.csv";
  const auto refused = [&](const std::string& text) {
    write_file(path, text);
    EXPECT_THROW(read_command(path), std::invalid_argument) << text;
  };
  refused("time_s,pressure_psi\n0,1\n1,1\n");
  refused("time_s,current_A\n0,1\n0.005,n/a\n");
  refused("time_s,current_A\n0,1\n");
  refused("time_s,current_A\n0,1\n0.005,1\n0.006,1\n0.02,1\n");
}

}  // namespace
}  // namespace valvetriage::stand
