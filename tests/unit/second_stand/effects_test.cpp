#include <gtest/gtest.h>

#include <set>
#include <stdexcept>

#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

std::vector<double> clean(const std::vector<Asked>& effects,
                          const std::vector<std::string>& tests = {"steps", "triangle"}) {
  return clean_outputs(order_of(tests, effects), nominal_unit());
}

TEST(Effects, EveryCauseOfTheContractThatAPressureCanShowCanBeHiddenAndFourOthers) {
  const std::set<std::string> contract = {
      "friction",      "backlash",      "hysteresis",   "dead_band",         "saturation",       "gain_loss",
      "static_curve",  "extra_lag",     "resonance",    "transport_delay",   "rate_limit",       "asymmetric_response",
      "leakage",       "side_input",    "orifice_flow", "stiffening_spring", "self_oscillation", "periodic_disturbance",
      "thermal_drift", "sensor_offset", "sensor_drift", "intermittent"};
  std::set<std::string> inside, outside;
  for (const EffectKind& kind : effect_kinds()) (kind.family == "outside" ? outside : inside).insert(kind.name);
  EXPECT_EQ(inside, contract);
  EXPECT_GE(outside.size(), 4u);
}

TEST(Effects, SizeZeroChangesNoBit) {
  const auto healthy = clean({}, {"step_up"});
  for (const EffectKind& kind : effect_kinds()) EXPECT_EQ(clean({{kind.name, 0}}, {"step_up"}), healthy) << kind.name;
}

TEST(Effects, EachChangesTheOutputAndMoreSoTheLargerItIs) {
  const auto healthy = clean({});
  for (const EffectKind& kind : effect_kinds()) {
    const double small = rms_difference(clean({{kind.name, 0.5 * kind.largest}}), healthy);
    const double large = rms_difference(clean({{kind.name, kind.largest}}), healthy);
    EXPECT_GT(large, 0.02) << kind.name;
    EXPECT_GT(large, 1.2 * small) << kind.name;
  }
}

TEST(Effects, SmallestSizesAreBarelySeen) {
  const auto healthy = clean({});
  for (const EffectKind& kind : effect_kinds())  // 1.2 psi of trim is what good units differ by
    EXPECT_LT(rms_difference(clean({{kind.name, kind.smallest}}), healthy), 1.2) << kind.name;
}

TEST(Effects, OffsetIsTheOffsetOfTheTruth) {
  const Order order = order_of({"step_up"}, {{"sensor_offset", 3}});
  const double offset = play(order).truth[0].parameters[0].value;
  EXPECT_EQ(std::abs(offset), 3);
  const auto with = play(order).logs[0].pressure_psi, without = play(order_of({"step_up"})).logs[0].pressure_psi;
  for (std::size_t k = 0; k < with.size(); ++k) ASSERT_NEAR(with[k] - without[k], offset, 1e-9);
}

TEST(Effects, SaturationHoldsItsLevel) {
  const Session session = play(order_of({"staircase"}, {{"saturation", 10}}));
  const auto& pressure = session.logs[0].clean_psi;
  const double level = session.truth[0].parameters[0].value + session.unit.gauge_offset_psi;
  EXPECT_NEAR(*std::max_element(pressure.begin(), pressure.end()), level, 0.05);
}

TEST(Effects, ThoseOfOneRecordingLeaveTheOthersAlone) {
  for (const char* name : {"intermittent", "buffer_slip"}) {
    const Session session = play(order_of({"steps", "triangle", "sweep"}, {{name, 0.01}}));
    const Session healthy = play(order_of({"steps", "triangle", "sweep"}));
    for (std::size_t i = 0; i < session.logs.size(); ++i)
      EXPECT_EQ(session.logs[i].clean_psi == healthy.logs[i].clean_psi,
                session.logs[i].name != session.truth[0].recording);
  }
}

TEST(Effects, PairIsBoth) {
  const auto pair = clean({{"friction", 0.01}, {"sensor_offset", 5}});
  const auto one = clean({{"friction", 0.01}}), other = clean({{"sensor_offset", 5}});
  const auto healthy = clean({});
  for (std::size_t k = 0; k < pair.size(); ++k) ASSERT_NEAR(pair[k] - one[k], other[k] - healthy[k], 1e-9);
}

TEST(Effects, UnknownDoubledNegativeAndImpossibleAreRefused) {
  for (const std::vector<Asked>& asked : std::vector<std::vector<Asked>>{
           {{"rust", 1}}, {{"friction", 0.01}, {"friction", 0.02}}, {{"friction", -1}}, {{"gain_loss", 1.5}}})
    EXPECT_THROW(clean(asked, {"step_up"}), std::invalid_argument) << asked[0].name;
}

}  // namespace
}  // namespace valvetriage::second_stand
