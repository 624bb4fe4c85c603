#include "server/http/access.h"

#include <gtest/gtest.h>

#include <set>

namespace valvetriage::http {
namespace {

TEST(Token, HasTwoHundredAndFiftySixBitsAndNeverRepeats) {
  std::set<std::string> secrets;
  for (int i = 0; i < 1000; ++i) secrets.insert(new_token_secret());
  EXPECT_EQ(secrets.size(), 1000u);
  EXPECT_EQ(secrets.begin()->size(), 3u + 43u);  // "vt_" and 256 bits, six to a character
  EXPECT_EQ(token_sha256(*secrets.begin()).size(), 64u);
}

TEST(Scopes, AreReadFromAListAndNothingElse) {
  EXPECT_EQ(*parse_scopes("submit, read,submit"), (std::vector<std::string>{"submit", "read"}));
  for (const char* bad : {"", "read,", "write", "READ"}) EXPECT_FALSE(parse_scopes(bad)) << bad;
}

TEST(Routes, MatchSegmentBySegment) {
  const auto captures_of = [](std::string_view pattern,
                              std::vector<std::string> path) -> std::optional<std::vector<std::string>> {
    std::vector<std::string> captures;
    return matches(pattern, path, captures) ? std::optional(captures) : std::nullopt;
  };
  using Captures = std::vector<std::string>;
  EXPECT_EQ(captures_of("/", {}), Captures{});
  EXPECT_EQ(captures_of("/v1/lots/{lot}/history", {"v1", "lots", "a/b", "history"}), Captures{"a/b"});
  EXPECT_EQ(captures_of("/v1/lots/{lot}", {"v1", "lots", ""}), std::nullopt);
  EXPECT_EQ(captures_of("/v1/lots/{lot}", {"v1", "lots"}), std::nullopt);
  EXPECT_EQ(captures_of("/v1/lots", {"v1", "lots", "a"}), std::nullopt);
  EXPECT_EQ(captures_of("/v1/lots", {}), std::nullopt);
}

}  // namespace
}  // namespace valvetriage::http
