#include "server/wire/canonical_json.h"

#include <gtest/gtest.h>

namespace valvetriage {
namespace {

TEST(CanonicalJson, TheOrderOfKeysDoesNotMatter) {
  EXPECT_EQ(canonical_json(Json{{"b", 1}, {"a", {{"d", 2}, {"c", 3}}}}), R"({"a":{"c":3,"d":2},"b":1})");
}

TEST(CanonicalJson, TheOrderOfAListDoes) {
  EXPECT_NE(canonical_sha256(Json::array({1, 2})), canonical_sha256(Json::array({2, 1})));
}

TEST(CanonicalJson, AWholeNumberIsWrittenOneWay) {
  EXPECT_EQ(canonical_json(Json::array({1, 1.0, 1e0, -0.0, 1u})), "[1,1,1,0,1]");
}

TEST(CanonicalJson, OtherNumbersAreTheShortestThatReadBack) {
  EXPECT_EQ(canonical_json(Json::array({0.1, 1.5, 1e-7})), "[0.1,1.5,1e-07]");
}

TEST(CanonicalJson, NumbersTooLargeToBeExactStayAsTheyAre) {
  EXPECT_EQ(canonical_json(Json::array({1e300})), "[1e+300]");
}

}  // namespace
}  // namespace valvetriage
