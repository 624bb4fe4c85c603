#include "core/recording/metadata.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/recording/limits.h"

namespace valvetriage {
namespace {

Metadata parsed(std::string_view line) {
  Metadata metadata;
  const auto result = parse_metadata_line(metadata, line);
  EXPECT_TRUE(result) << result.error().message;
  return metadata;
}

TEST(Metadata, ReadsSeveralPairsOfOneLineAndLeavesRemarksOut) {
  const Metadata line = parsed("# stand: stand-3               # tested_at: 2026-08-03T09:12:44Z    # hours: 4120");
  EXPECT_EQ(*line.stand, "stand-3");
  EXPECT_EQ(*line.tested_at, "2026-08-03T09:12:44Z");
  EXPECT_EQ(*line.hours, "4120");
  EXPECT_EQ(*parsed("# condition: returned          (new | returned | prototype | unknown; a label)").condition,
            "returned");
  EXPECT_EQ(*parsed("# lot: 2026-W31-B # as on the box").lot, "2026-W31-B");
}

TEST(Metadata, KeepsWhatOnlyLooksLikeARemark) {
  EXPECT_EQ(*parsed("# complaint: surges (second time), unit #4 at 30 %").complaint,
            "surges (second time), unit #4 at 30 %");
  EXPECT_EQ(*parsed("#claim:C-7").claim, "C-7");
  EXPECT_EQ(parsed("# Firmware: 1.2").others.at("firmware"), "1.2");
}

TEST(Metadata, TakesALineWithoutAPairAsAComment) {
  const Metadata comment = parsed("# Recorded by the stand at 12:30, all fine");
  EXPECT_TRUE(comment.others.empty());
  EXPECT_FALSE(parsed("# serial:").serial);
}

TEST(Metadata, RefusesWhatIsAboveItsLimitOrNoText) {
  Metadata metadata;
  EXPECT_TRUE(set_metadata(metadata, "a", std::string(kMaxMetadataValueBytes, 'x')));
  EXPECT_EQ(set_metadata(metadata, "b", std::string(kMaxMetadataValueBytes + 1, 'x')).error().code, "bad_metadata");
  EXPECT_TRUE(set_metadata(metadata, std::string(kMaxMetadataKeyBytes, 'k'), "x"));
  EXPECT_FALSE(set_metadata(metadata, std::string(kMaxMetadataKeyBytes + 1, 'k'), "x"));
  EXPECT_FALSE(set_metadata(metadata, "c", "\xC0\x80"));
  EXPECT_FALSE(set_metadata(metadata, "c", std::string("a\0b", 3)));
  EXPECT_FALSE(set_metadata(metadata, "condition", "broken"));
  for (std::size_t i = metadata.others.size(); i < kMaxMetadataPairs; ++i) {
    EXPECT_TRUE(set_metadata(metadata, fmt::format("k{}", i), "x"));
  }
  EXPECT_FALSE(set_metadata(metadata, "one-more", "x"));
}

TEST(Metadata, FindsTheHeadInTheFirstBytesOnly) {
  const auto head = read_metadata_head("\xEF\xBB\xBF# serial: 7\r\n\n# lot: L\n# stand: cut");
  ASSERT_TRUE(head);
  EXPECT_EQ(*head->serial, "7");
  EXPECT_EQ(*head->lot, "L");
  EXPECT_FALSE(head->stand);
  EXPECT_FALSE(read_metadata_head("time_s,u\n# serial: 7\n")->serial);
  EXPECT_TRUE(read_metadata_head("{\"metadata\": {}}"));
  EXPECT_EQ(read_metadata_head("# serial: 7\n# serial: 8\n").error().line, 2u);
}

TEST(Metadata, NeverChoosesBetweenTheFileAndAnOption) {
  Metadata file{.serial = "7"};
  EXPECT_TRUE(apply_metadata_options(file, Metadata{.serial = "7", .lot = "L"}));
  EXPECT_EQ(*file.lot, "L");
  const auto contradiction = apply_metadata_options(file, Metadata{.serial = "8"});
  ASSERT_FALSE(contradiction);
  EXPECT_EQ(contradiction.error().code, "contradicting_metadata");
  EXPECT_EQ(contradiction.error().field, "serial");
  EXPECT_EQ(contradiction.error().found, "7");
}

}  // namespace
}  // namespace valvetriage
