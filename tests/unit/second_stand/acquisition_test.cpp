#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

Log logged(const std::vector<Asked>& decoys = {}) {
  return play(order_of({"sweep"}, {}, decoys)).logs[0];
}

std::vector<double> noise_of(const Log& log) {
  std::vector<double> noise;
  for (std::size_t k = 0; k < log.clean_psi.size(); ++k) noise.push_back(log.pressure_psi[k] - log.clean_psi[k]);
  return noise;
}

double rms(const std::vector<double>& values) {
  double squares = 0;
  for (const double value : values) squares += value * value;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

double correlation_at(const std::vector<double>& noise, std::size_t lag) {
  double products = 0, squares = 0;
  for (std::size_t k = lag; k < noise.size(); ++k) {
    products += noise[k] * noise[k - lag];
    squares += noise[k] * noise[k];
  }
  return products / squares;
}

TEST(Noise, IsAsLargeAsAskedForAndRemembersALittleForLong) {
  const auto noise = noise_of(logged());
  // The slowest parts of its flicker move little within a record: a tenth of its energy may be missing or too much.
  EXPECT_NEAR(rms(noise), Conditions{}.noise_psi, 0.08 * Conditions{}.noise_psi);
  EXPECT_GT(correlation_at(noise, 40), 0.01);
  EXPECT_LT(correlation_at(noise, 1), 0.3);
}

TEST(Noise, ColourIsThatOfTheDecoy) {
  EXPECT_NEAR(correlation_at(noise_of(logged({{"coloured_noise", 0.04}})), 1), std::exp(-0.005 / 0.04), 0.05);
}

TEST(Decoys, CoarseConverterShowsWholeSteps) {
  for (const double pressure : logged({{"coarse_adc", 0.25}}).pressure_psi)
    ASSERT_EQ(pressure, 0.25 * std::round(pressure / 0.25));
}

TEST(Decoys, JitteredStampsAreInOrderAndTheCommandIsPlayedAtThem) {
  const Log log = logged({{"jitter", 0}});
  const Command command = commands_of("sweep").front();
  for (std::size_t k = 1; k < log.time_s.size(); ++k) ASSERT_GT(log.time_s[k], log.time_s[k - 1]);
  EXPECT_GT(rms_difference(log.time_s, command.instant_s), 0.0004);
  EXPECT_EQ(log.command_a, command.value_a);
}

TEST(Decoys, LostRowsAreWholeRows) {
  const Log log = logged({{"lost_rows", 50}});
  EXPECT_LT(log.time_s.size(), 4000u);
  EXPECT_GE(log.time_s.size(), 3950u);
  for (const auto* column : {&log.pressure_psi, &log.current_a, &log.clean_psi, &log.supply_psi})
    EXPECT_EQ(column->size(), log.time_s.size());
}

TEST(Decoys, RippleShowsInTheLoggedCurrentAlone) {
  const Log plain = logged(), rippled = logged({{"pwm_ripple", 0.012}});
  EXPECT_EQ(plain.clean_psi, rippled.clean_psi);
  EXPECT_NEAR(rms_difference(plain.current_a, rippled.current_a), 0.001 / std::numbers::sqrt2, 5e-5);
}

TEST(Decoys, SupplyDriftsInItsChannelAlone) {
  const Log plain = logged(), drifting = logged({{"supply_drift", 20}});
  EXPECT_EQ(plain.pressure_psi, drifting.pressure_psi);
  EXPECT_NEAR(std::abs(drifting.supply_psi.back() - plain.supply_psi.back()), 10, 0.1);
}

TEST(Decoys, SpikesAreRareAndLarge) {
  const auto noise = noise_of(logged({{"spikes", 0.003}}));
  int large = 0;
  for (const double value : noise) large += std::abs(value) > 5 * Conditions{}.noise_psi;
  // 12 of 4,000 samples are ten times as large, six in ten of these above five: 7.4, give or take 4 √7.4
  EXPECT_GT(large, 0);
  EXPECT_LT(large, 20);
}

TEST(Decoys, UnknownOneIsRefused) {
  EXPECT_THROW(logged({{"gremlin", 1}}), std::invalid_argument);
}

}  // namespace
}  // namespace valvetriage::second_stand
