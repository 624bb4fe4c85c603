#include "tests/second_stand/day.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage::second_stand {
namespace {

double of_the_day(std::uint64_t seed, const char* what, double mean, double rms) {
  return mean + rms * Random(seed, what).inspected();
}

}  // namespace

Wandering::Wandering(Random random, double mean, double rms, double memory_s) {
  constexpr double kHorizonS = 120;
  const double kept = std::exp(-kGridS / memory_s), fresh = std::sqrt(1 - kept * kept);
  double away = random.normal();
  for (double t = 0; t <= kHorizonS; t += kGridS) {
    value_.push_back(mean + rms * away);
    away = kept * away + fresh * random.normal();
  }
}

double Wandering::at(double t_s) const {
  const double place = std::clamp(t_s / kGridS, 0.0, static_cast<double>(value_.size()) - 1.001);
  const auto k = static_cast<std::size_t>(place);
  return value_[k] + (place - static_cast<double>(k)) * (value_[k + 1] - value_[k]);
}

Day::Day(std::uint64_t noise_seed, const std::string& recording, double supply_drift)
    : past_seed(Random(noise_seed, "past of " + recording).seed()),
      mean_temperature_c(of_the_day(noise_seed, "temperature of the day", 42, 2)),
      mean_supply_psi(of_the_day(noise_seed, "supply of the day", 450, 4)),
      temperature_c({noise_seed, "temperature during " + recording}, mean_temperature_c, 1.2, 8),
      supply_wander_psi({noise_seed, "supply during " + recording}, 0, 4, 1.5),
      supply_drift_psi(supply_drift * Random(noise_seed, "drift during " + recording).sign()),
      tone_phase(2 * std::numbers::pi * Random(noise_seed, "tone during " + recording).uniform()) {}

double Day::supply_psi_at(double t_s) const {
  return mean_supply_psi + supply_wander_psi.at(t_s) + supply_drift_psi * (t_s / 20 - 0.5);
}

}  // namespace valvetriage::second_stand
