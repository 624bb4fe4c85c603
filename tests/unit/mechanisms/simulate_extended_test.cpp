#include "core/mechanisms/simulate_extended.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/unit/mechanisms/example.h"

namespace valvetriage {
namespace {

Model valve() {
  Model model;
  model.kind = "valve";
  model.input_unit = "A";
  model.output_unit = "psi";
  model.loop = MagneticLoop{.width_a = 0.004};
  model.dynamics = to_transfer_function({.delay_s = 0.004, .natural_frequency_rad_s = 200, .damping_ratio = 0.8});
  model.map = StaticMap{.input = {1.0, 1.2, 1.4, 1.6, 1.8, 2.0}, .output = {0.84, 3.1, 26, 120, 160, 210}};
  model.volume = OrificeVolume{.time_constant_s = 0.06, .exponent = 0.55, .supply_psi = 300, .reference_psi = 105};
  return model;
}

Model machine() {
  Model model;
  model.kind = "linear";
  model.dynamics = {.domain = Domain::kS, .poles = {-20}, .gain = 20 * 100};
  model.input_offset = 1.5;
  model.output_offset = 90;
  return model;
}

Recording motion() {
  Recording r;
  r.name = "motion.csv";
  r.sample_period_s = example::kPeriod_s;
  r.input.values = example::motion(1.0, 2.0, example::stamps());
  r.output.values.assign(r.input.values.size(), 0);
  r.side = example::side();
  return r;
}

std::vector<double> run(const Model& model, const Recording& recording = motion()) {
  const auto y = simulate_extended(model, recording, {});
  EXPECT_TRUE(y.has_value()) << y.error().message;
  return y.value_or(std::vector<double>{});
}

Model with(Model model, const std::string& cause, const std::vector<double>& parameters,
           const std::string& channel = "") {
  model.mechanisms.push_back({cause, parameters, channel});
  return model;
}

TEST(SimulateExtended, IsThePlainSimulationWhereThereAreNoCauses) {
  for (const Model& model : {valve(), machine()}) EXPECT_EQ(run(model), simulate(model, motion(), {}).value());
}

TEST(SimulateExtended, NeutralCausesChangeNothing) {
  for (const Mechanism* law : all_mechanisms()) {
    if (law->parameters.empty()) continue;
    const auto start = law->bounds(example::scales()).starts.front();
    const Model neutral = with(valve(), std::string(law->cause), example::neutral(*law, start));
    if (law->cause == "saturation") continue;  // its lower level is one more size
    EXPECT_LT(example::largest_gap(run(neutral), run(valve())), 1e-9) << law->cause;
  }
}

TEST(SimulateExtended, EveryCauseChangesAValvesOutput) {
  for (const Mechanism* law : all_mechanisms()) {
    if (law->parameters.empty()) continue;
    auto start = law->bounds(example::scales()).starts.front();
    const Model spoiled = with(valve(), std::string(law->cause), start);
    EXPECT_GT(example::largest_gap(run(spoiled), run(valve())), 0.01) << law->cause;
  }
}

TEST(SimulateExtended, ActsOnALinearMachineWhereItMakesSense) {
  EXPECT_NEAR(run(with(machine(), "gain_loss", {0.5})).front(), 0.5 * run(machine()).front(), 1e-9);
  EXPECT_GT(example::largest_gap(run(with(machine(), "dead_band", {1.5, 0.2})), run(machine())), 5);
  const std::vector<double> free = run(machine());
  const double level = *std::max_element(free.begin(), free.end()) - 20;
  const auto clipped = run(with(machine(), "saturation", {level, -1e9, 0}));
  EXPECT_NEAR(*std::max_element(clipped.begin(), clipped.end()), level, 1e-9);
}

TEST(SimulateExtended, AFlowLawNeedsAVolume) {
  const auto y = simulate_extended(with(machine(), "leakage", {0.1}), motion(), {});
  ASSERT_FALSE(y.has_value());
  EXPECT_EQ(y.error().code, "needs_volume");
}

TEST(SimulateExtended, ALeakingValveBeginsWhereItSettles) {
  Recording rest = motion();
  std::fill(rest.input.values.begin(), rest.input.values.end(), 1.8);
  const auto y = run(with(valve(), "leakage", {0.2}), rest);
  EXPECT_NEAR(y.front(), y.back(), 1e-6);
  EXPECT_LT(y.front(), 155);
}

TEST(SimulateExtended, ASideInputIsFoundByItsName) {
  const auto y = run(with(valve(), "side_input", {2, 20, 7}, "temperature_C")), healthy = run(valve());
  const std::vector<double>& s = example::side()[0].values;
  EXPECT_NEAR((y[300] - healthy[300]) - (y[700] - healthy[700]), 2 * (s[300] - s[700]), 1e-9);
  const auto missing = simulate_extended(with(valve(), "side_input", {2, 20, 0}, "supply_psi"), motion(), {});
  ASSERT_FALSE(missing.has_value());
  EXPECT_EQ(missing.error().code, "missing_channel");
}

TEST(SimulateExtended, ASideInputIsNotDelayedByALagThatIsListedBehindIt) {
  const Model lagging = with(valve(), "extra_lag", {0.2, 0});
  Model both = with(valve(), "side_input", {2, 20, 0}, "temperature_C");
  both.mechanisms.push_back({.cause = "extra_lag", .parameters = {0.2, 0}, .channel = ""});
  const auto y = run(both), without = run(lagging);
  const std::vector<double>& s = example::side()[0].values;
  for (std::size_t i = 0; i < y.size(); ++i) ASSERT_NEAR(y[i] - without[i], 2 * (s[i] - 20), 1e-9) << i;
}

TEST(WithChannelsAt, IsTheModelInARecordingWhoseChannelStaysThere) {
  Model model = with(valve(), "side_input", {2, 20, 0}, "temperature_C");
  model.mechanisms.push_back({.cause = "leakage", .parameters = {0.1}, .channel = ""});
  model.mechanisms.push_back({.cause = "rectified_sensor", .parameters = {}, .channel = ""});
  model.mechanisms.push_back({.cause = "intermittent", .parameters = {1, -0.2, 0}, .channel = ""});
  Recording recording = motion();
  for (Channel& channel : recording.side) std::fill(channel.values.begin(), channel.values.end(), 23.5);
  const auto recorded = simulate_extended(model, recording, {});
  std::string asked;
  const Model alone = with_channels_at(
      [&](std::string_view channel) {
        asked = channel;
        return 23.5;
      },
      model);
  const auto to_come = simulate_extended(alone, input_between_samples(recording), recording.sample_period_s, {}, {});
  ASSERT_TRUE(recorded && to_come);
  EXPECT_EQ(asked, "temperature_C");
  for (std::size_t i = 0; i < recorded->size(); ++i) ASSERT_NEAR((*to_come)[i], (*recorded)[i], 1e-9) << i;
}

TEST(SimulateExtended, ABrokenContactBelongsToItsRecording) {
  const std::vector<double> parameters{3, -0.2, 4};
  EXPECT_EQ(run(with(valve(), "intermittent", parameters, "other.csv")), run(valve()));
  EXPECT_NE(run(with(valve(), "intermittent", parameters, "motion.csv")), run(valve()));
}

TEST(SimulateExtended, WrongParametersAreRefused) {
  const auto code = [](const Model& model) {
    const auto y = simulate_extended(model, motion(), {});
    return y ? std::string() : y.error().code;
  };
  EXPECT_EQ(code(with(valve(), "friction", {0.1})), "bad_parameter");
  EXPECT_EQ(code(with(valve(), "friction", {NAN, 0.1})), "bad_parameter");
  EXPECT_EQ(code(with(valve(), "cosmic_rays", {})), "unknown_cause");
}

TEST(SimulateExtended, TakesItsStartFromMeasuredOutputsThroughTheLaws) {
  const Model model = with(with(valve(), "gain_loss", {0.9}), "sensor_offset", {3});
  Recording late = motion();
  const std::vector<double> whole = run(model, late);
  // The same run from its middle: the state there is found from the outputs.
  Recording tail = late;
  tail.input.values.erase(tail.input.values.begin(), tail.input.values.begin() + 500);
  tail.output.values.assign(whole.begin() + 500, whole.end());
  const InitialState measured{.kind = InitialState::Kind::kMeasured, .samples = 40};
  const auto y = simulate_extended(model, tail, measured);
  ASSERT_TRUE(y.has_value());
  // The loop's memory is not part of the state: its 4 mA are what may be left of the start.
  EXPECT_LT(std::abs((*y)[39] - tail.output.values[39]), 4);
}

/// The outputs of a model that begins with other memories, as a gauge with noise reads them.
Recording recorded(const Model& model) {
  Recording r = motion();
  r.output.values = run(model);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.35);
  for (double& y : r.output.values) y += noise(random);
  return r;
}

constexpr InitialState kFirstSecond{.kind = InitialState::Kind::kMeasured, .samples = 200};

TEST(SimulateExtended, AStartFoundInNoiseStaysWhereTheValveIs) {
  const Model model = valve();
  const auto y = simulate_extended(model, recorded(model), kFirstSecond);
  ASSERT_TRUE(y);
  EXPECT_LT(example::largest_gap(*y, run(model)), 0.7);
}

TEST(SimulateExtended, FindsTheMagneticMemoryInTheFirstMeasuredOutputs) {
  Model before = valve();
  before.loop = MagneticLoop{.width_a = 0.02, .memory = -0.8};
  Model model = before;
  model.loop->memory = 0;
  const auto y = simulate_extended(model, recorded(before), kFirstSecond);
  ASSERT_TRUE(y);
  const double unknown = example::largest_gap(run(model), run(before));
  EXPECT_GT(unknown, 2);
  EXPECT_LT(example::largest_gap(*y, run(before)), 0.25 * unknown);
}

TEST(SimulateExtended, FindsTheMemoryOfACauseInTheFirstMeasuredOutputs) {
  for (const auto& [cause, parameters] : std::vector<std::pair<std::string, std::vector<double>>>{
           {"hysteresis", {0.05, 0.1, 0.7}}, {"backlash", {0.03, 0, -0.9}}}) {
    const Model before = with(valve(), cause, parameters);
    std::vector<double> forgotten = parameters;
    forgotten.back() = 0;
    const Model model = with(valve(), cause, forgotten);
    const auto y = simulate_extended(model, recorded(before), kFirstSecond);
    ASSERT_TRUE(y) << cause;
    const double unknown = example::largest_gap(run(model), run(before));
    EXPECT_GT(unknown, 2) << cause;
    EXPECT_LT(example::largest_gap(*y, run(before)), 0.25 * unknown) << cause;
  }
}

}  // namespace
}  // namespace valvetriage
