#include "core/recording/columns.h"

#include <gtest/gtest.h>

#include <limits>

#include "core/recording/limits.h"

namespace valvetriage {
namespace {

TEST(Columns, ReadTheMappingOption) {
  const auto mapping = parse_column_mapping("time=t_s, input=u,output=y,side=temperature_C,supply_psi");
  ASSERT_TRUE(mapping) << mapping.error().message;
  EXPECT_EQ(mapping->time, "t_s");
  EXPECT_EQ(mapping->input, "u");
  EXPECT_EQ(mapping->output, "y");
  EXPECT_EQ(mapping->side, (std::vector<std::string>{"temperature_C", "supply_psi"}));
  EXPECT_TRUE(parse_column_mapping("")->input.empty());
}

TEST(Columns, RefuseAMappingThatIsNoneOrContradictsItself) {
  for (const char* text : {"u", "input", "input=", "speed=u", "input=u,input=v", "input=u,output=u",
                           "input=u,,output=y", "side=a,a", "input=\xFF"}) {
    const auto mapping = parse_column_mapping(text);
    ASSERT_FALSE(mapping) << text;
    EXPECT_EQ(mapping.error().code, "bad_columns") << text;
  }
  std::string sides = "side=s0";
  for (std::size_t i = 1; i < kMaxSideInputs; ++i) sides += ",s" + std::to_string(i);
  EXPECT_TRUE(parse_column_mapping(sides));
  EXPECT_FALSE(parse_column_mapping(sides + ",one_more"));
}

TEST(Columns, ConvertAMappedColumnWithAnAcceptedUnitAndLeaveAnyOtherAlone) {
  const auto mapping = parse_column_mapping("input=coil_mA,output=flow_lpm");
  const auto plan = plan_columns({"time_ms", "coil_mA", "flow_lpm"}, *mapping);
  ASSERT_TRUE(plan);
  EXPECT_EQ((*plan)[0].channel.file_unit_scale, 1e-3);
  EXPECT_EQ((*plan)[1].channel.unit, "A");
  EXPECT_EQ((*plan)[1].channel.quantity, "coil");
  EXPECT_EQ((*plan)[2].channel.unit, "");
  EXPECT_EQ((*plan)[2].channel.quantity, "flow_lpm");
}

TEST(Columns, SampleRatesHaveTwoEnds) {
  EXPECT_TRUE(check_sample_rate(kMinSampleRateHz));
  EXPECT_TRUE(check_sample_rate(kMaxSampleRateHz));
  EXPECT_FALSE(check_sample_rate(0.9 * kMinSampleRateHz));
  EXPECT_FALSE(check_sample_rate(1.1 * kMaxSampleRateHz));
  EXPECT_FALSE(check_sample_rate(std::numeric_limits<double>::quiet_NaN()));
}

}  // namespace
}  // namespace valvetriage
