#include "tests/stand/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage::stand {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;

double day_mean(std::uint64_t seed, const char* channel, double mean, double sd) {
  return mean + sd * Random(seed, std::string("day ") + channel).tolerance();
}

}  // namespace

Wander::Wander(Random random, double mean, double amplitude, double fastest_hz) : mean_(mean) {
  double hz = fastest_hz;
  for (Wave& wave : wave_) {
    wave = {amplitude * random.uniform(0.5, 1.0) / 3, kTwoPi * hz, kTwoPi * random.uniform()};
    hz *= 0.43;
  }
}

double Wander::at(double t_s) const {
  double sum = mean_;
  for (const Wave& wave : wave_) sum += wave.amplitude * std::sin(wave.rad_s * t_s + wave.phase);
  return sum;
}

Environment::Environment(std::uint64_t noise_seed, const std::string& recording)
    : history_seed(Random(noise_seed, "history " + recording).next()),
      day_temperature_c(day_mean(noise_seed, "temperature", 40, 2)),
      day_supply_psi(day_mean(noise_seed, "supply", 480, 3)),
      temperature_c({noise_seed, "temperature " + recording}, day_temperature_c, 1.5, 0.05),
      supply_psi({noise_seed, "supply " + recording}, day_supply_psi, 6, 0.3),
      tone_phase(kTwoPi * Random(noise_seed, "tone " + recording).uniform()) {
  constexpr double kMeanDwellS = 1.0, kHorizonS = 600;
  Random random(noise_seed, "telegraph " + recording);
  for (double t = 0; t < kHorizonS;) telegraph_s.push_back(t -= kMeanDwellS * std::log(1 - random.uniform()));
}

double Environment::telegraph(double t_s) const {
  const auto passed = std::upper_bound(telegraph_s.begin(), telegraph_s.end(), t_s) - telegraph_s.begin();
  return static_cast<double>(passed % 2);
}

}  // namespace valvetriage::stand
