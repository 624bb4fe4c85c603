#include "server/wire/model_json.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/unit/wire/generate.h"

namespace valvetriage {
namespace {

Json linear_model() {
  return Json{{"schema", "valvetriage.model/1"},
              {"kind", "linear"},
              {"input_unit", "A"},
              {"output_unit", "psi"},
              {"map", nullptr},
              {"transfer_function",
               {{"domain", "z"},
                {"sample_time_s", 0.005},
                {"zeros", Json::array()},
                {"poles", {{0.9, 0.1}, {0.9, -0.1}}},
                {"gain", 2.5},
                {"delay_s", 0.01}}},
              {"input_offset", 1.0},
              {"output_offset", 3.0}};
}

Error refused(const Json& document) {
  const auto read = model_from_json(document);
  EXPECT_FALSE(read.has_value()) << dump_json(document);
  return read ? Error{} : read.error();
}

RC_GTEST_PROP(ModelJson, ReadsBackWhatItWrote, ()) {
  const Json written = to_json(generate::model(generate::small(0, 1) == 1));
  const auto read = model_from_json(generate::through_text(written));
  RC_ASSERT(read.has_value());
  RC_ASSERT(to_json(*read) == written);
}

RC_GTEST_PROP(ModelJson, NumbersKeepTheirLastBit, ()) {
  const Model model = generate::model(true);
  const auto read = model_from_json(generate::through_text(to_json(model)));
  RC_ASSERT(read.has_value());
  RC_ASSERT(read->dynamics.poles == model.dynamics.poles);
  RC_ASSERT(read->map->input == model.map->input);
  RC_ASSERT(read->input_offset == model.input_offset);
}

TEST(ModelJson, AWholeIdentifyResultIsAModel) {
  Json identify{
      {"method", "oe"}, {"order", 2}, {"transfer_function", linear_model()["transfer_function"]}, {"stable", true}};
  const auto model = model_from_json(identify);
  ASSERT_TRUE(model.has_value()) << model.error().message;
  EXPECT_EQ(model->kind, "linear");
  EXPECT_EQ(model->dynamics.poles.size(), 2u);
  EXPECT_EQ(model->input_offset, 0.0);
}

TEST(ModelJson, AWholeAnalysisIsRefusedWithTheFieldToTake) {
  const Error error = refused(Json{{"recordings", Json::array()}, {"baseline", Json::object()}});
  EXPECT_EQ(error.code, "not_a_model");
  EXPECT_NE(error.message.find("extended_model"), std::string::npos);
}

TEST(ModelJson, AnotherDocumentIsRefused) {
  EXPECT_EQ(refused(Json::object()).code, "not_a_model");
  EXPECT_EQ(refused(Json::array()).code, "not_a_model");
}

TEST(ModelJson, AComplexPoleNeedsItsConjugate) {
  Json document = linear_model();
  document["transfer_function"]["poles"] = Json::array({{0.9, 0.1}, {0.9, 0.1}});
  EXPECT_EQ(refused(document).field, "/transfer_function/poles");
}

TEST(ModelJson, MoreZerosThanPolesAreRefused) {
  Json document = linear_model();
  document["transfer_function"]["zeros"] = Json::array({{0.1, 0}, {0.2, 0}});
  EXPECT_TRUE(model_from_json(document).has_value());
  document["transfer_function"]["zeros"].push_back({0.3, 0});
  EXPECT_EQ(refused(document).field, "/transfer_function/zeros");
}

TEST(ModelJson, TheNumberOfRootsIsBounded) {
  Json document = linear_model();
  Json& poles = document["transfer_function"]["poles"];
  poles = Json::array();
  for (std::size_t i = 0; i < kMaxModelRoots; ++i) poles.push_back({0.5, 0});
  EXPECT_TRUE(model_from_json(document).has_value());
  poles.push_back({0.5, 0});
  EXPECT_EQ(refused(document).field, "/transfer_function/poles");
}

TEST(ModelJson, ADelayInZIsAWholeNumberOfSamples) {
  Json document = linear_model();
  document["transfer_function"]["delay_s"] = 0.0125;
  EXPECT_EQ(refused(document).field, "/transfer_function/delay_s");
  document["transfer_function"]["delay_s"] = -0.005;
  EXPECT_EQ(refused(document).field, "/transfer_function/delay_s");
}

TEST(ModelJson, TheSampleTimeFitsTheDomain) {
  Json document = linear_model();
  document["transfer_function"]["sample_time_s"] = 0;
  EXPECT_EQ(refused(document).field, "/transfer_function/sample_time_s");
  document["transfer_function"]["domain"] = "s";
  EXPECT_TRUE(model_from_json(document).has_value());
  document["transfer_function"]["sample_time_s"] = 0.1;
  EXPECT_EQ(refused(document).field, "/transfer_function/sample_time_s");
}

TEST(ModelJson, AValveNeedsAMapThatOnlyRisesOrOnlyFalls) {
  Json document = linear_model();
  document["kind"] = "valve";
  EXPECT_EQ(refused(document).field, "/map");
  document["map"] = Json{{"input", {1, 2, 3}}, {"output", {3, 2, 1}}};
  EXPECT_TRUE(model_from_json(document).has_value());
  document["map"]["output"] = Json::array({1, 3, 2});
  EXPECT_EQ(refused(document).field, "/map/output");
  document["map"]["output"] = Json::array({1, 2});
  EXPECT_EQ(refused(document).field, "/map");
  document["map"] = Json{{"input", {1, 1, 3}}, {"output", {1, 2, 3}}};
  EXPECT_EQ(refused(document).field, "/map/input");
}

Json valve_model() {
  Json document = linear_model();
  document["kind"] = "valve";
  document["map"] = {{"input", {1.0, 2.0}}, {"output", {0.0, 200.0}}};
  document["transfer_function"] = {{"domain", "s"},
                                   {"zeros", Json::array()},
                                   {"poles", {{-1600, 0}, {-1600, 0}}},
                                   {"gain", 2.56e6},
                                   {"delay_s", 0.0072}};
  return document;
}

TEST(ModelJson, AModeStandsBehindTheMapOfAValve) {
  Json document = valve_model();
  document["mode"] = {{"natural_frequency_rad_s", 40}, {"damping_ratio", 0.6}};
  const auto model = model_from_json(document);
  ASSERT_TRUE(model.has_value()) << model.error().message;
  EXPECT_EQ(model->mode, (Mode{40, 0.6}));
  EXPECT_EQ(to_json(*model)["mode"], document["mode"]);
  EXPECT_FALSE(to_json(*model_from_json(valve_model())).contains("mode"));

  for (const char* name : {"natural_frequency_rad_s", "damping_ratio"}) {
    Json wrong = document;
    wrong["mode"][name] = 0;
    EXPECT_EQ(refused(wrong).field, std::string("/mode/") + name);
    wrong["mode"].erase(name);
    EXPECT_EQ(refused(wrong).field, std::string("/mode/") + name);
  }
  Json elsewhere = linear_model();
  elsewhere["mode"] = document["mode"];
  EXPECT_EQ(refused(elsewhere).field, "/mode");
  Json no_spool = document;
  no_spool["transfer_function"]["poles"] = {{-30, 0}};
  EXPECT_EQ(refused(no_spool).field, "/mode");
}

TEST(ModelJson, TheReachOfALoopIsWrittenWhereItIsNotOne) {
  Json valve = linear_model();
  valve["kind"] = "valve";
  valve["map"] = Json{{"input", {1, 2, 3}}, {"output", {1, 2, 3}}};
  Model model = model_from_json(valve).value();
  model.loop = MagneticLoop{.width_a = 0.002, .reach = 0.18};
  const Json written = to_json(model);
  EXPECT_EQ(written["loop"]["reach"], 0.18);
  EXPECT_EQ(model_from_json(written)->loop->reach, 0.18);
  model.loop->reach = 1;
  Json usual = to_json(model);
  EXPECT_FALSE(usual["loop"].contains("reach"));
  EXPECT_EQ(model_from_json(usual)->loop->reach, 1);
  usual["loop"]["reach"] = 0;
  EXPECT_EQ(refused(usual).field, "/loop/reach");
}

TEST(ModelJson, TheFirstThingWrongIsNamedByItsPointer) {
  Json document = linear_model();
  document["transfer_function"]["gain"] = "much";
  const Error error = refused(document);
  EXPECT_EQ(error.code, "wrong_type");
  EXPECT_EQ(error.message, "/transfer_function/gain: expected a number, found \"much\"");
}

Json sticking_model() {
  Json document = linear_model();
  document["mechanisms"] = Json::array({Json{
      {"cause", "friction"}, {"parameters", {{"breakaway_A", 0.03}, {"kinetic_A", 0.02}, {"stribeck_A_per_s", 0.3}}}}});
  return document;
}

TEST(ModelJson, APhysicalCauseIsReadByTheNamesOfItsParameters) {
  const auto model = model_from_json(sticking_model());
  ASSERT_TRUE(model.has_value()) << model.error().message;
  ASSERT_EQ(model->mechanisms.size(), 1u);
  EXPECT_EQ(model->mechanisms[0].parameters, (std::vector<double>{0.03, 0.02, 0.3, 0}));
}

TEST(ModelJson, AnExponentIsWrittenWholeAndNotAsWhatItHasBeyondTheValves) {
  const Json document =
      Json{{"schema", "valvetriage.model/1"},
           {"kind", "valve"},
           {"input_unit", "A"},
           {"output_unit", "psi"},
           {"map", {{"input", {1, 2}}, {"output", {0, 200}}}},
           {"volume", {{"time_constant_s", 0.06}, {"exponent", 0.5}, {"supply_psi", 480}, {"reference_psi", 105}}},
           {"transfer_function", linear_model()["transfer_function"]},
           {"mechanisms", Json::array({{{"cause", "orifice_flow"}, {"parameters", {{"exponent", 0.375}}}}})}};
  const auto model = model_from_json(document);
  ASSERT_TRUE(model.has_value()) << model.error().message;
  EXPECT_EQ(model->mechanisms.at(0).parameters, std::vector<double>{-0.125});
  EXPECT_EQ(to_json(*model)["mechanisms"], document["mechanisms"]);
}

TEST(ModelJson, AModelWithoutCausesIsWrittenAsBefore) {
  EXPECT_FALSE(to_json(model_from_json(linear_model()).value()).contains("mechanisms"));
}

TEST(ModelJson, AChannelActsFromZeroOnWhereNoReferenceIsGiven) {
  Json document = linear_model();
  document["mechanisms"] =
      Json::array({{{"cause", "side_input"}, {"parameters", {{"coefficient", 0.4}, {"channel", 0}}}}});
  const auto model = model_from_json(document);
  ASSERT_TRUE(model.has_value()) << model.error().message;
  EXPECT_EQ(model->mechanisms.front().parameters, (std::vector<double>{0.4, 0, 0}));
}

TEST(ModelJson, WhatALawDoesNotNeedMayBeLeftOutOfTheDocument) {
  Json document = sticking_model();
  document["mechanisms"][0] = Json{{"cause", "saturation"}, {"parameters", {{"level_psi", 150}}}};
  const auto model = model_from_json(document);
  ASSERT_TRUE(model.has_value());
  EXPECT_TRUE(std::isinf(model->mechanisms[0].parameters[1]));
  EXPECT_EQ(model->mechanisms[0].parameters[2], 0);
  document["mechanisms"][0]["parameters"]["spool_stops"] = 0;
  EXPECT_EQ(to_json(*model)["mechanisms"], document["mechanisms"]);
}

TEST(ModelJson, UnknownCausesAndParametersAreRefusedByName) {
  Json document = sticking_model();
  document["mechanisms"][0]["cause"] = "cosmic_rays";
  EXPECT_EQ(refused(document).field, "/mechanisms/0/cause");
  document = sticking_model();
  document["mechanisms"][0]["parameters"]["colour"] = 1;
  EXPECT_EQ(refused(document).code, "unknown_value");
  document["mechanisms"][0]["parameters"] = Json{{"breakaway_A", 0.03}};
  EXPECT_EQ(refused(document).code, "missing_field");
}

TEST(ModelJson, TheNumberOfCausesIsBounded) {
  Json document = sticking_model();
  for (std::size_t i = 0; i < kMaxModelMechanisms; ++i) document["mechanisms"].push_back(document["mechanisms"][0]);
  EXPECT_EQ(refused(document).code, "out_of_range");
}

}  // namespace
}  // namespace valvetriage
