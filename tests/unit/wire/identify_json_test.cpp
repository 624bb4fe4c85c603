#include "server/wire/identify_json.h"

#include <gtest/gtest.h>

#include "server/wire/live_rows.h"
#include "server/wire/model_json.h"
#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;

Identification of_a_valve(IdentificationMethod method) {
  const auto u = random_levels(1200, 40, 1);
  auto y = run(second_order_valve(), u);
  add_noise(y, 0.35, 2);
  const auto recording = recording_of(u, y, 1.0 / 200);
  const Recording* const all[] = {&recording};
  IdentifyOptions options;
  options.method = method;
  options.order = 2;
  return identify(all, options).value();
}

TEST(IdentifyJson, BeginsWithTheContractsFieldsInTheirOrder) {
  const Json json = to_json(of_a_valve(IdentificationMethod::kArx));
  std::vector<std::string> keys;
  for (const auto& [key, value] : json.items()) keys.push_back(key);
  keys.resize(6);
  EXPECT_EQ(keys, (std::vector<std::string>{"method", "order", "transfer_function", "stable", "fit_percent", "tried"}));
  EXPECT_EQ(json["method"], "arx");
  EXPECT_EQ(json["order"], json["transfer_function"]["poles"].size());
}

TEST(IdentifyJson, IsAModelThatSimulateTakes) {
  const Identification id = of_a_valve(IdentificationMethod::kOutputError);
  const auto model = model_from_json(to_json(id));
  ASSERT_TRUE(model.has_value());
  EXPECT_EQ(model->output_offset, id.output_offset());
  EXPECT_EQ(static_gain(model->dynamics), static_gain(id.transfer_function));
}

TEST(IdentifyJson, AnEstimateCarriesNamesAndCovariance) {
  auto rls = RecursiveLeastSquares::create({.form = RlsForm::kAbsolute, .order = 1, .input_terms = 1}).value();
  const auto u = random_levels(100, 5, 3);
  for (std::size_t t = 0; t < u.size(); ++t) ASSERT_TRUE(rls.update(u[t], 2 * u[t] + 1).has_value());
  const Json json = estimate_json(rls, 100, 0.5);
  EXPECT_TRUE(json["theta_hat"].contains("offset"));
  EXPECT_EQ(json["covariance"].size(), 3u);
  EXPECT_EQ(json["covariance"][2].size(), 3u);
}

TEST(LiveRows, ReadsMetadataHeaderAndConvertedRowsOneLineAtATime) {
  LiveRows rows{ColumnMapping{}};
  EXPECT_FALSE(rows.take("\xEF\xBB\xBF# serial: A")->has_value());
  EXPECT_FALSE(rows.take("time_ms;current_mA;pressure_psi\r")->has_value());
  const auto first = rows.take("0;1200,5;3,1").value();
  ASSERT_TRUE(first.has_value());
  EXPECT_DOUBLE_EQ(first->input, 1.2005);
  EXPECT_DOUBLE_EQ(first->output, 3.1);
  ASSERT_TRUE(rows.take("5;1200;3,2")->has_value());
  EXPECT_DOUBLE_EQ(rows.sample_period_s(), 0.005);
}

TEST(LiveRows, TellsWhereABadRowIsAndGoesOn) {
  LiveRows rows{ColumnMapping{}};
  ASSERT_TRUE(rows.take("time_s,current_A,pressure_psi").has_value());
  ASSERT_TRUE(rows.take("0,1,2").has_value());
  const auto bad = rows.take("1,n/a,2");
  ASSERT_FALSE(bad.has_value());
  EXPECT_EQ(bad.error().code, "not_a_number");
  EXPECT_EQ(bad.error().line, 3u);
  EXPECT_EQ(bad.error().column, 2u);
  EXPECT_EQ(rows.take("1,inf,2").error().code, "not_finite");
  EXPECT_EQ(rows.take("1,2").error().code, "ragged_row");
  EXPECT_EQ(rows.take("0,1,2").error().code, "time_not_increasing");
  EXPECT_TRUE(rows.take("1,1,2").has_value());
  EXPECT_EQ(rows.rows(), 2u);
}

TEST(LiveRows, RefusesMetadataThatContradictWhatStandsBesideThem) {
  Metadata given;
  given.serial = "B";
  LiveRows rows(ColumnMapping{}, given);
  ASSERT_TRUE(rows.take("# lot: L1"));
  const auto refused = rows.take("# serial: A");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "contradicting_metadata");
  EXPECT_EQ(refused.error().line, 2u);
  LiveRows agreeing(ColumnMapping{}, given);
  EXPECT_TRUE(agreeing.take("# serial: B"));
}

TEST(LiveRows, RefusesAHeaderWithoutItsColumns) {
  LiveRows rows{ColumnMapping{}};
  EXPECT_EQ(rows.take("time_s,pressure_psi").error().code, "missing_column");
}

}  // namespace
}  // namespace valvetriage
