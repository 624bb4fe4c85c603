#include "server/wire/machine_c.h"

#include <gtest/gtest.h>

#include <cmath>
#include <ostream>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/segments.h"
#include "server/wire/model_c.h"
#include "tests/unit/wire/c_program.h"

namespace valvetriage {
namespace {

constexpr double kMachinePeriod_s = 0.02;
constexpr std::size_t kMachineSamples = 10000;

/// Steps, triangles and a sweep about 0.5, and a side channel that rises.
const Recording& machine_motion() {
  static const Recording recording = [] {
    Recording r;
    r.sample_period_s = kMachinePeriod_s;
    Channel side{.name = "supply", .quantity = "", .unit = "", .file_unit = "", .values = {}};
    for (std::size_t i = 0; i < kMachineSamples; ++i) {
      const double t = static_cast<double>(i) * kMachinePeriod_s;
      constexpr double kLevels[] = {0.5, 1.6, -1.0, 1.8, 0.3, 2.0, -0.55, 0.7, -1.2, 0.9};
      const double triangle = 1.5 * std::abs(std::fmod(t, 6.0) / 3 - 1) - 0.5;
      const double sweep = 0.5 + 1.2 * std::sin(0.06 * t * t);
      r.input.values.push_back(t < 80 ? kLevels[static_cast<std::size_t>(t / 8)] : t < 140 ? triangle : sweep);
      r.output.values.push_back(0);
      side.values.push_back(3 + 0.01 * t);
    }
    r.segments = find_segments(r.input.values, kMachinePeriod_s);
    r.side.push_back(side);
    return r;
  }();
  return recording;
}

MachineBlock block(MachineLaw law, std::vector<double> parameters) {
  MachineBlock b;
  b.law = law;
  b.parameters = std::move(parameters);
  return b;
}

/// A motion that rings behind a lag, three states, behind a delay.
MachineBlock with_sections(MachineLaw law, std::vector<double> parameters, std::vector<double> feedback) {
  MachineBlock b = block(law, std::move(parameters));
  b.sections = {{.order = 2, .e = 0.12, .f = 0.02}, {.order = 1, .f = 0.2}};
  b.numerator = {0.7, 0.1, 0.4, -0.05};
  b.feedback = std::move(feedback);
  b.delay_samples = 3;
  return b;
}

Model chain(std::vector<MachineBlock> blocks) {
  Model model;
  model.kind = "machine";
  model.machine = Machine{.sample_period_s = kMachinePeriod_s, .interval_means = false, .blocks = std::move(blocks)};
  return model;
}

std::vector<double> simulated(const Model& model) {
  const auto y = simulate_extended(model, machine_motion(), {});
  EXPECT_TRUE(y.has_value()) << y.error().message;
  return y.value_or(std::vector<double>{});
}

std::vector<double> in_c(const Model& model) {
  const auto source = to_c(model, kMachinePeriod_s);
  EXPECT_TRUE(source.has_value()) << source.error().message;
  return source ? run_in_c(*source, machine_motion()) : std::vector<double>{};
}

double range(const std::vector<double>& y) {
  const auto [low, high] = std::minmax_element(y.begin(), y.end());
  return *high - *low;
}

struct LawCase {
  const char* name;
  MachineBlock block;

  friend void PrintTo(const LawCase& law, std::ostream* out) { *out << law.name; }
};

/// One of every law, each with something to do.
std::vector<LawCase> every_law() {
  using L = MachineLaw;
  MachineBlock side = block(L::kSide, {0.7, 3.2});
  side.channel = "supply";
  MachineBlock motion_block = block(L::kMotion, {2, -0.5, 0.1, 3, 0.8, 0.3, 0.5, 0});
  motion_block.delay_samples = 2;
  MachineBlock tanks = block(L::kTanks, {2, 1.1, -1.4, 0.9, 0.7, 0.5, 3.5, 0.4, 4.5, -0.3, 0.62});
  tanks.delay_samples = 1;
  return {{"linear", with_sections(L::kLinear, {}, {})},
          {"affine", block(L::kAffine, {-2.5, 0.75})},
          {"play", block(L::kPlay, {0.4})},
          {"stick_slip", block(L::kStickSlip, {0.3, 0.1})},
          {"loop", block(L::kLoop, {0.2, 0.9})},
          {"dead_band", block(L::kDeadBand, {0.1, 0.5})},
          {"upper_limit", block(L::kUpperLimit, {0.8, 0.05})},
          {"lower_limit", block(L::kLowerLimit, {-0.4, 0})},
          {"curve", block(L::kCurve, {0.3, -1, 3})},
          {"magnitude", block(L::kMagnitude, {0.2})},
          {"rate_limit", block(L::kRateLimit, {0.6})},
          {"lag", block(L::kLag, {0.3, 0.9})},
          {"spring", with_sections(L::kSpring, {-0.1}, {-0.05, -0.02})},
          {"restoring_loop", with_sections(L::kRestoringLoop, {1.5, -0.4}, {-0.3, 0.1})},
          {"motion", motion_block},
          {"motion_speed", block(L::kMotion, {2, 0.5, 0, 0, 0.8, 0.3, 0.3, 1})},
          {"tanks", tanks},
          {"one_tank", block(L::kTanks, {1, 1.1, -1.4, 1, 0.7, 0.5, 1e9, 0, 1e9, 0.2, 0.5})},
          {"tone", block(L::kTone, {0.2, -0.1, 3.3})},
          {"drift", block(L::kDrift, {-0.004})},
          {"warming", block(L::kWarming, {-0.2, 40, 0.5})},
          {"gain_step", block(L::kGainStep, {0.3, 91, 0.4})},
          {"side", side}};
}

std::string name_of_case(const testing::TestParamInfo<LawCase>& of) {
  return of.param.name;
}

class MachineCLaw : public testing::TestWithParam<LawCase> {};

TEST_P(MachineCLaw, RunsAsTheMachineDoes) {
  const Model model = chain({GetParam().block});
  const auto expected = simulated(model);
  ASSERT_NE(expected, machine_motion().input.values) << "the law does nothing";
  const auto y = in_c(model);
  ASSERT_EQ(y.size(), kMachineSamples);
  for (std::size_t i = 0; i < kMachineSamples; ++i)
    ASSERT_NEAR(y[i], expected[i], 1e-9 * range(expected)) << "at " << i;
}

INSTANTIATE_TEST_SUITE_P(Every, MachineCLaw, testing::ValuesIn(every_law()), name_of_case);

TEST(MachineC, EveryLawOfMachinesIsAsked) {
  std::vector<bool> asked(kMachineLaws);
  for (const LawCase& law : every_law()) asked[static_cast<std::size_t>(law.block.law)] = true;
  for (std::size_t i = 0; i < kMachineLaws; ++i) EXPECT_TRUE(asked[i]) << name_of(static_cast<MachineLaw>(i));
}

TEST(MachineC, TwoOfOneLawInAChainKeepTheirOwnMemories) {
  const Model model = chain({block(MachineLaw::kPlay, {0.4}), with_sections(MachineLaw::kLinear, {}, {}),
                             block(MachineLaw::kPlay, {0.1}), with_sections(MachineLaw::kLinear, {}, {})});
  const auto expected = simulated(model);
  const auto y = in_c(model);
  ASSERT_EQ(y.size(), kMachineSamples);
  for (std::size_t i = 0; i < kMachineSamples; ++i)
    ASSERT_NEAR(y[i], expected[i], 1e-9 * range(expected)) << "at " << i;
}

TEST(MachineC, OfMeansOverIntervalsAStepGivesTheSampleBefore) {
  Model model = chain({with_sections(MachineLaw::kLinear, {}, {}), block(MachineLaw::kStickSlip, {0.3, 0.1})});
  model.machine->interval_means = true;
  const auto expected = simulated(model);
  const auto y = in_c(model);
  ASSERT_EQ(y.size(), kMachineSamples);
  for (std::size_t i = 1; i < kMachineSamples; ++i) {
    ASSERT_NEAR(y[i], expected[i - 1], 1e-9 * range(expected)) << "at " << i;
  }
}

TEST(MachineC, ARunThatLeavesItsRangeEndsInNoNumber) {
  MachineBlock unstable = with_sections(MachineLaw::kSpring, {0}, {8});
  const auto y = in_c(chain({unstable}));
  ASSERT_EQ(y.size(), kMachineSamples);
  EXPECT_TRUE(std::isnan(y.back()));
}

TEST(MachineC, AMachineOfNoBlocksPassesItsInputOn) {
  EXPECT_EQ(in_c(chain({})), machine_motion().input.values);
}

TEST(MachineC, WhatCannotBeToldIsRefused) {
  EXPECT_EQ(to_c(chain({block(MachineLaw::kPlay, {0.4})}), 0.021).error().code, "own_period");
  EXPECT_EQ(to_c(chain({block(MachineLaw::kPlay, {})}), kMachinePeriod_s).error().code, "machine_malformed");
  MachineBlock one = block(MachineLaw::kSide, {0.7, 3}), other = one;
  one.channel = "supply";
  other.channel = "temperature";
  EXPECT_EQ(to_c(chain({one, other}), kMachinePeriod_s).error().code, "too_many");
}

TEST(MachineC, AChannelsNameCannotEndTheComment) {
  MachineBlock side = block(MachineLaw::kSide, {0.7, 3});
  side.channel = "*/ int x; /*";
  const auto source = to_c(chain({side}), kMachinePeriod_s).value();
  EXPECT_EQ(source.find("*/ int x"), std::string::npos);
}

TEST(MachineC, NothingIsAllocated) {
  const std::string source = to_c(chain({with_sections(MachineLaw::kLinear, {}, {})}), kMachinePeriod_s).value();
  for (const char* word : {"malloc", "calloc", "stdlib", "free("}) {
    EXPECT_EQ(source.find(word), std::string::npos) << word;
  }
}

}  // namespace
}  // namespace valvetriage
