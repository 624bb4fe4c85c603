#include "tests/second_stand/acquisition.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/second_stand/noise.h"
#include "tests/second_stand/valve.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kPeriodS = 0.005;
constexpr double kRippleHz = 1003.1;  // aliases to 3.1 Hz, the dither to 1.3 Hz
constexpr double kMonitorGain = 1.0 / 12;
constexpr double kPsiPerA = 250;  // 12 bits over 1000 psi and over 4 A
constexpr double kMainsPsi = 0.01;

double rounded_to(double value, double quantum) {
  return quantum > 0 ? quantum * std::round(value / quantum) : value;
}

/// Broad 94 %, flicker 34 % of the rms.
ChannelNoise pressure_noise(const Conditions& conditions, std::uint64_t seed, const std::string& recording) {
  const bool spikes = conditions.spike_share > 0;
  return {Random(seed, "pressure of " + recording),
          {.broad = 0.94 * conditions.noise_psi,
           .flicker = 0.34 * conditions.noise_psi,
           .colour_s = conditions.colour_s,
           .tail_share = spikes ? conditions.spike_share : 0.004,
           .tail_size = spikes ? 10.0 : 3.0},
          kPeriodS};
}

ChannelNoise current_noise(const Conditions& conditions, std::uint64_t seed, const std::string& recording) {
  return {Random(seed, "current of " + recording),
          {.broad = conditions.current_noise_a, .flicker = 0.2 * conditions.current_noise_a},
          kPeriodS};
}

/// Rows to drop: bursts of one to nine rows, never the first or the last of a recording.
std::vector<char> lost(std::size_t rows, int wanted, Random random) {
  std::vector<char> gone(rows, 0);
  while (wanted > 0 && rows > 20) {
    const int burst = std::min(wanted, 1 + random.below(9));
    const int begin = 1 + random.below(static_cast<int>(rows) - burst - 2);
    std::fill_n(gone.begin() + begin, burst, 1);
    wanted -= burst;
  }
  return gone;
}

void drop(std::vector<double>& column, const std::vector<char>& gone) {
  std::size_t row = 0;
  std::erase_if(column, [&](double) { return gone[row++] != 0; });
}

}  // namespace

const std::vector<Decoy>& decoys() {
  static const std::vector<Decoy> table = {
      {"coloured_noise", 0.04, "correlation time of the broad noise [s]",
       [](double s, Conditions& c) { c.colour_s = s; }},
      {"coarse_adc", 0.244, "quantum of the pressure [psi]; of the current 1/250 of it in A",
       [](double s, Conditions& c) { c.adc_psi = s; }},
      {"jitter", 0.0006, "rms of the instants of command and sample [s]; the stamps are true",
       [](double s, Conditions& c) { c.jitter_s = s; }},
      {"lost_rows", 50, "rows per recording, in bursts of 1 to 9",
       [](double s, Conditions& c) { c.lost_rows = static_cast<int>(s); }},
      {"pwm_ripple", 0.005, "amplitude at the driver [A], 1003.1 Hz; a twelfth aliases into the log at 3.1 Hz",
       [](double s, Conditions& c) { c.ripple_a = s; }},
      {"dither", 0.006, "amplitude on the command [A], 201.3 Hz; a twelfth aliases into the log at 1.3 Hz",
       [](double s, Conditions& c) { c.dither_a = s; }},
      {"supply_drift", 20, "drift of the logged supply over 20 s [psi]; the regulator lets none of it through",
       [](double s, Conditions& c) { c.supply_drift_psi = s; }},
      {"spikes", 0.003, "share of samples with ten times the noise",
       [](double s, Conditions& c) { c.spike_share = s; }},
  };
  return table;
}

void apply_decoy(const std::string& name, double size, Conditions& conditions) {
  for (const Decoy& decoy : decoys())
    if (decoy.name == name) return decoy.apply(size > 0 ? size : decoy.usual_size, conditions);
  throw std::invalid_argument("no decoy '" + name + "' (see `effects`)");
}

Command as_clocked(const Command& command, const Conditions& conditions, std::uint64_t noise_seed) {
  Command clocked = command;
  if (conditions.jitter_s <= 0) return clocked;
  Random random(noise_seed, "clock of " + command.name);
  for (std::size_t k = 1; k < clocked.instant_s.size(); ++k)
    clocked.instant_s[k] += std::clamp(conditions.jitter_s * random.normal(), -0.4 * kPeriodS, 0.4 * kPeriodS);
  return clocked;
}

Log log_of(const Command& command, const Conditions& conditions, const Day& day, std::uint64_t noise_seed,
           std::vector<double> clean_psi) {
  Log log;
  log.name = command.name;
  log.test = command.test;
  ChannelNoise pressure = pressure_noise(conditions, noise_seed, command.name);
  ChannelNoise current = current_noise(conditions, noise_seed, command.name);
  const MainsPickUp mains(Random(noise_seed, "mains"), kMainsPsi);
  Random side(noise_seed, "side channels of " + command.name);
  for (std::size_t k = 0; k < command.instant_s.size(); ++k) {
    const double t = command.instant_s[k];
    const double ripple_a = conditions.ripple_a * std::sin(2 * std::numbers::pi * kRippleHz * t) +
                            conditions.dither_a * std::sin(2 * std::numbers::pi * kDitherHz * t);
    log.current_a.push_back(
        rounded_to(command.value_a[k] + kMonitorGain * ripple_a + current.next(), conditions.adc_psi / kPsiPerA));
    log.pressure_psi.push_back(rounded_to(clean_psi[k] + pressure.next() + mains.at(t), conditions.adc_psi));
    log.temperature_c.push_back(day.temperature_c.at(t) + 0.02 * side.normal());
    log.supply_psi.push_back(day.supply_psi_at(t) + 0.3 * side.normal());
  }
  log.time_s = command.instant_s;
  log.command_a = command.value_a;
  log.clean_psi = std::move(clean_psi);
  const auto gone = lost(log.time_s.size(), conditions.lost_rows, Random(noise_seed, "rows lost of " + command.name));
  for (auto* column : {&log.time_s, &log.current_a, &log.pressure_psi, &log.temperature_c, &log.supply_psi,
                       &log.clean_psi, &log.command_a})
    drop(*column, gone);
  return log;
}

}  // namespace valvetriage::second_stand
