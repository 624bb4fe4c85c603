#include "server/wire/reference_json.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/unit/wire/generate.h"

namespace valvetriage {
namespace {

Json through_text(const Json& document) {
  return parse_json(dump_json(document)).value();
}

RC_GTEST_PROP(ReferenceJson, ReadsBackWhatItWrote, ()) {
  const Json written = to_json(generate::reference());
  const auto read = reference_from_json(through_text(written));
  RC_ASSERT(read.has_value());
  RC_ASSERT(to_json(*read) == written);
  RC_ASSERT(read->sha256 == written["sha256"].get<std::string>());
}

RC_GTEST_PROP(ReferenceJson, TheHashIsOfTheContentNotOfTheVersion, ()) {
  Reference reference = generate::reference();
  const std::string before = reference_sha256(reference);
  reference.version += 1;
  RC_ASSERT(reference_sha256(reference) == before);
  reference.noise_floor *= 2;
  RC_ASSERT(reference_sha256(reference) != before);
}

RC_GTEST_PROP(ReferenceJson, SizesThatDoNotFitEachOtherAreRefused, ()) {
  Json document = to_json(generate::reference());
  document["covariance"].push_back(0);
  RC_ASSERT(reference_from_json(document).error().field == "/covariance");
  document = to_json(generate::reference());
  document["map_sd"].push_back(0);
  RC_ASSERT(reference_from_json(document).error().field == "/map_sd");
}

RC_GTEST_PROP(ReferenceJson, AKnownTestHasAResidualForEverySampleOfItsInput, ()) {
  Reference reference = generate::plain_reference();
  reference.on_known_tests.push_back({{{0.005, {1, 2}, {0.5, 0}}}, generate::plain_reference()});
  const Json good = to_json(reference);
  RC_ASSERT(reference_from_json(good)->on_known_tests.at(0).tests.at(0).residual.at(0) == 0.5);
  Json document = good;
  document["on_known_tests"]["tests"][0]["residual_psi"].push_back(0);
  RC_ASSERT(reference_from_json(document).error().field == "/on_known_tests/tests/0/residual_psi");
  document = good;
  document["on_known_tests"]["tests"][0]["sample_period_s"] = 0;
  RC_ASSERT(reference_from_json(document).error().field == "/on_known_tests/tests/0/sample_period_s");
  document = good;
  document["on_known_tests"]["reference"].erase("valves");
  RC_ASSERT(reference_from_json(document).error().field == "/on_known_tests/reference/valves");
  document = good;
  document["on_known_tests"]["tests"] = Json(kMaxKnownTests, good["on_known_tests"]["tests"][0]);
  RC_ASSERT(reference_from_json(document).has_value());
  document["on_known_tests"]["tests"].push_back(good["on_known_tests"]["tests"][0]);
  RC_ASSERT(reference_from_json(document).error().code == "too_large");
  document["on_known_tests"]["tests"] = Json::array();
  RC_ASSERT(!reference_from_json(document).has_value());
}

TEST(ReferenceJson, AnotherDocumentIsRefused) {
  EXPECT_EQ(reference_from_json(Json::object()).error().code, "not_a_reference");
  EXPECT_EQ(reference_from_json(Json(1)).error().code, "wrong_type");
}

TEST(ReferenceJson, AMissingFieldIsNamed) {
  Json document{{"schema", "valvetriage.reference/1"}, {"valve_type", "type-1"}};
  EXPECT_EQ(reference_from_json(document).error().field, "/valves");
}

}  // namespace
}  // namespace valvetriage
