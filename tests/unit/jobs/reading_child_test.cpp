#include "server/jobs/reading_child.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

/// What is taken over from a child that says this.
Result<RawRecording> said(const std::string& lines) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.file("answer")) << lines;
  return read_in_child({.path = "any.mat", .name = "any.mat"}, WhatToRead::kAll, [] { return true; },
                       {"/bin/cat", folder.file("answer")});
}

std::string channel(const std::string& role, const std::string& values) {
  return "{\"channel\":{\"role\":\"" + role +
         "\",\"name\":\"n\",\"quantity\":\"q\",\"unit\":\"A\",\"file_unit\":\"mA\",\"file_unit_scale\":0.001}}\n" +
         "{\"values\":[" + values + "]}\n";
}

TEST(ReadingChild, HandsOverLabelsAndChannelsAsTheyWereRead) {
  const auto raw = said("{\"metadata\":{\"serial\":\"S-7\"}}\n" + channel("time", "0,0.1") + channel("input", "1,2") +
                        "{\"values\":[]}\n" + channel("output", "3,4") + channel("side", "5,6"));
  ASSERT_TRUE(raw) << raw.error().message;
  EXPECT_EQ(raw->metadata.serial, "S-7");
  EXPECT_EQ(raw->time.values, (std::vector<double>{0, 0.1}));
  EXPECT_EQ(raw->input.values, (std::vector<double>{1, 2}));
  EXPECT_EQ(raw->output.file_unit, "mA");
  EXPECT_EQ(raw->output.file_unit_scale, 0.001);
  ASSERT_EQ(raw->side.size(), 1u);
  EXPECT_EQ(raw->side[0].values, (std::vector<double>{5, 6}));
}

TEST(ReadingChild, HandsOverTheRefusalWithItsPosition) {
  const auto raw = said(
      "{\"refused\":{\"code\":\"not_a_number\",\"message\":\"m\",\"file\":\"f\",\"field\":\"time_s\",\"found\":\"x\","
      "\"expected\":\"e\"}}\n");
  ASSERT_FALSE(raw);
  EXPECT_EQ(raw.error().code, "not_a_number");
  EXPECT_EQ(raw.error().field, "time_s");
}

TEST(ReadingChild, IsNotBelievedWhereItsAnswerIsNoWholeRecording) {
  const std::string metadata = "{\"metadata\":{}}\n";
  EXPECT_FALSE(said(""));
  EXPECT_FALSE(said("no JSON\n"));
  EXPECT_FALSE(said("{\"metadata\":{\"serial\":[1]}}\n" + channel("time", "1") + channel("input", "\"x\"")));
  EXPECT_FALSE(said(metadata + "{\"values\":[1]}\n"));
  EXPECT_FALSE(said(metadata + channel("time", "0,1") + channel("input", "1,2") + channel("output", "3")));
  EXPECT_FALSE(
      read_in_child({.path = "any.mat", .name = "any.mat"}, WhatToRead::kAll, [] { return true; }, {"/bin/false"}));
}

}  // namespace
}  // namespace valvetriage
