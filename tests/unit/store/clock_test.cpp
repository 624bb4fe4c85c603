#include "server/store/clock.h"

#include <gtest/gtest.h>

#include "server/store/id.h"

namespace valvetriage {
namespace {

TEST(Rfc3339, WritesUtcWithMilliseconds) {
  EXPECT_EQ(format_rfc3339(0), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(format_rfc3339(1'785'748'364'005), "2026-08-03T09:12:44.005Z");
  EXPECT_EQ(format_rfc3339(-1), "1969-12-31T23:59:59.999Z");
}

TEST(Rfc3339, ReadsWhatItWritesAndWhatOthersWrite) {
  EXPECT_EQ(parse_rfc3339("2026-08-03T09:12:44.005Z"), 1'785'748'364'005);
  EXPECT_EQ(parse_rfc3339("2026-08-03T11:12:44.0059+02:00"), 1'785'748'364'005);
  EXPECT_EQ(parse_rfc3339("2026-08-03t09:12:44z"), 1'785'748'364'000);
  EXPECT_EQ(parse_rfc3339("2024-02-29T00:00:00Z"), 1'709'164'800'000);
}

TEST(Rfc3339, ReadsNothingElse) {
  for (const char* text :
       {"", "2026", "2026-08-03", "2026-08-03T09:12:44", "2026-08-03T09:12Z", "2026-13-01T00:00:00Z",
        "2026-02-30T00:00:00Z", "2026-08-03T24:00:00Z", "2026-08-03T09:60:00Z", "2026-08-03T09:12:44.Z",
        "2026-08-03T09:12:44Zx", "2026-08-03T09:12:44+0200", "-026-08-03T09:12:44Z"}) {
    EXPECT_FALSE(parse_rfc3339(text)) << text;
  }
}

TEST(Id, IsThirtyCharactersSortsByTimeAndDoesNotRepeat) {
  EXPECT_EQ(new_id("rec_", 0).size(), 30u);
  EXPECT_LT(new_id("rec_", 1'785'748'364'005), new_id("rec_", 1'785'748'364'006));
  EXPECT_NE(new_id("rec_", 1), new_id("rec_", 1));
}

}  // namespace
}  // namespace valvetriage
