#include "core/identify/order.h"

#include <gtest/gtest.h>

#include <complex>
#include <numeric>

#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;
using Poles = std::vector<std::complex<double>>;

/// Static gain 470, two numerator coefficients.
Plant plant_with(const Poles& poles, int delay) {
  std::vector<std::complex<double>> a{1};
  for (const auto& pole : poles) {
    a.emplace_back(0);
    for (std::size_t i = a.size() - 1; i > 0; --i) a[i] -= pole * a[i - 1];
  }
  Plant plant;
  for (const auto& coefficient : a) plant.a.push_back(coefficient.real());
  const double sum = std::accumulate(plant.a.begin(), plant.a.end(), 0.0);
  plant.b = {0.6 * 470 * sum, 0.4 * 470 * sum};
  plant.delay = delay;
  return plant;
}

Recording noisy(const Plant& plant, std::size_t n, std::uint32_t seed) {
  const auto u = random_levels(n, 60, seed);
  auto y = run(plant, u);
  add_noise(y, 0.35, seed + 100);
  return recording_of({u.begin() + 40, u.end()}, {y.begin() + 40, y.end()}, 1.0 / 200);
}

TEST(Order, IsFoundForSecondThirdAndFifthOrderInNoise) {
  const std::vector<Poles> plants{{{0.95, 0.05}, {0.95, -0.05}},
                                  {0.9, {0.95, 0.1}, {0.95, -0.1}},
                                  {0.97, {0.95, 0.1}, {0.95, -0.1}, {0.9, 0.3}, {0.9, -0.3}}};
  for (const Poles& poles : plants) {
    for (std::uint32_t seed = 1; seed <= 3; ++seed) {
      const auto recording = noisy(plant_with(poles, 1), 6000, seed);
      const Recording* const all[] = {&recording};
      const auto choice = choose_order(all, {});
      ASSERT_TRUE(choice.has_value());
      EXPECT_EQ(choice->structure.order, static_cast<int>(poles.size())) << "seed " << seed << ": " << choice->reason;
    }
  }
}

TEST(Order, FindsTheDelay) {
  for (const int delay : {1, 4, 9, 30}) {
    const auto recording = noisy(plant_with({{0.95, 0.05}, {0.95, -0.05}}, delay), 5000, 11);
    const Recording* const all[] = {&recording};
    const auto choice = choose_order(all, {}).value();
    EXPECT_EQ(choice.structure.delay_samples, delay) << choice.reason;
  }
}

TEST(Order, HoldsOutRecordingsWhereThereAreSeveral) {
  std::vector<Recording> recordings;
  for (std::uint32_t seed = 1; seed <= 4; ++seed) {
    recordings.push_back(noisy(plant_with({0.9, {0.95, 0.1}, {0.95, -0.1}}, 2), 1500, seed));
  }
  const std::vector<const Recording*> all{&recordings[0], &recordings[1], &recordings[2], &recordings[3]};
  const auto choice = choose_order(all, {}).value();
  EXPECT_EQ(choice.structure.order, 3) << choice.reason;
  for (const auto& tried : choice.tried) {
    if (tried.structure.order != 3 || tried.structure.zeros != 2) continue;
    EXPECT_NEAR(tried.rmse_heldout, 0.35, 0.02);
  }
}

TEST(Order, WhatTheCallerFixesStaysFixed) {
  const auto recording = noisy(plant_with({{0.95, 0.05}, {0.95, -0.05}}, 3), 3000, 21);
  const Recording* const all[] = {&recording};
  OrderOptions options;
  options.order = 3;
  options.zeros = 1;
  options.delay_samples = 2;
  const auto choice = choose_order(all, options).value();
  EXPECT_EQ(choice.structure.order, 3);
  EXPECT_EQ(choice.structure.zeros, 1);
  EXPECT_EQ(choice.structure.delay_samples, 2);
  EXPECT_EQ(choice.tried.size(), 1u);
}

TEST(Order, DoesNotDependOnTheScaleOfTheData) {
  auto recording = noisy(plant_with({0.9, {0.95, 0.1}, {0.95, -0.1}}, 2), 3000, 31);
  const Recording* const all[] = {&recording};
  const auto choice = choose_order(all, {}).value();
  for (auto& value : recording.output.values) value = 1e-6 * value + 3;
  for (auto& value : recording.input.values) value = 1e3 * value - 7;
  const auto scaled = choose_order(all, {}).value();
  EXPECT_EQ(choice.structure.order, scaled.structure.order);
  EXPECT_EQ(choice.structure.delay_samples, scaled.structure.delay_samples);
}

TEST(Order, TooFewSamplesForAnyOrderIsAnError) {
  auto recording = noisy(plant_with({0.9}, 1), 40 + 39, 41);
  const Recording* const all[] = {&recording};
  EXPECT_EQ(choose_order(all, {}).error().code, "too_few_samples");
  recording = noisy(plant_with({0.9}, 1), 40 + 60, 41);
  EXPECT_TRUE(choose_order(all, {}).has_value());
}

}  // namespace
}  // namespace valvetriage
