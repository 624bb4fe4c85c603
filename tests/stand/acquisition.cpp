#include "tests/stand/acquisition.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

// Just off a multiple of the sampling rate, so that they alias into the band of the valve: 1.7 Hz and 2.7 Hz.
constexpr double kDitherHz = 201.7, kRippleHz = 997.3;
// The monitor's anti-alias filter at those frequencies.
constexpr double kMonitorGain = 0.1;
// Both channels have as many bits: ranges of 1000 psi and 4 A.
constexpr double kPsiPerA = 250;

struct Decoy {
  DecoyInfo info;
  void (*apply)(double size, Conditions&);
};

const std::vector<Decoy>& decoys() {
  static const std::vector<Decoy> table = {
      {{"coloured_noise", "correlation time [s]", 0.03}, [](double s, Conditions& c) { c.noise_correlation_s = s; }},
      {{"quantised_adc", "quantum of the pressure [psi]", 0.3}, [](double s, Conditions& c) { c.adc_psi = s; }},
      {{"jitter", "rms of the sampling instants [s]", 0.0007}, [](double s, Conditions& c) { c.jitter_s = s; }},
      {{"dropouts", "rows lost per recording", 60},
       [](double s, Conditions& c) { c.dropped_rows = static_cast<int>(s); }},
      {{"pwm_ripple", "amplitude at the driver [A]", 0.004}, [](double s, Conditions& c) { c.ripple_a = s; }},
      {{"dither", "amplitude on the command [A]", 0.006}, [](double s, Conditions& c) { c.dither_a = s; }},
      {{"moving_setpoint", "wander of the command [A]", 0.02},
       [](double s, Conditions& c) { c.setpoint_wander_a = s; }},
  };
  return table;
}

double quantised(double value, double quantum) {
  return quantum > 0 ? quantum * std::round(value / quantum) : value;
}

/// White or first-order coloured noise of unit variance.
class Noise {
 public:
  Noise(Random random, double correlation_s, double period_s)
      : random_(random),
        memory_(correlation_s > 0 ? std::exp(-period_s / correlation_s) : 0),
        value_(random_.normal()) {}
  double next() {
    value_ = memory_ * value_ + std::sqrt(1 - memory_ * memory_) * random_.normal();
    return value_;
  }

 private:
  Random random_;
  double memory_, value_;
};

std::vector<double> jittered_instants_s(const Command& command, double jitter_s, std::uint64_t noise_seed) {
  Random random(noise_seed, "jitter " + command.name);
  const double most = 0.45 * command.period_s;  // instants keep their order
  std::vector<double> instants_s;
  for (std::size_t k = 0; k < command.value_a.size(); ++k)
    instants_s.push_back(std::max(0.0, command.instant_s(k) + std::clamp(jitter_s * random.normal(), -most, most)));
  return instants_s;
}

/// Rows that stay after bursts of loss; the first and the last always do.
std::vector<char> kept_rows(std::size_t rows, int dropped, Random random) {
  constexpr int kBurst = 5;
  std::vector<char> kept(rows, 1);
  if (rows <= 2 * kBurst) return kept;
  for (; dropped > 0; dropped -= kBurst) {
    const auto begin = 1 + static_cast<std::size_t>(random.below(static_cast<int>(rows) - kBurst - 2));
    const auto end = begin + static_cast<std::size_t>(std::min(dropped, kBurst));
    std::fill(kept.begin() + static_cast<std::ptrdiff_t>(begin), kept.begin() + static_cast<std::ptrdiff_t>(end), 0);
  }
  return kept;
}

void keep(std::vector<double>& column, const std::vector<char>& kept) {
  std::size_t out = 0;
  for (std::size_t k = 0; k < column.size(); ++k)
    if (kept[k]) column[out++] = column[k];
  column.resize(out);
}

}  // namespace

const std::vector<DecoyInfo>& decoy_table() {
  static const std::vector<DecoyInfo> table = [] {
    std::vector<DecoyInfo> rows;
    for (const Decoy& decoy : decoys()) rows.push_back(decoy.info);
    return rows;
  }();
  return table;
}

void apply_decoy(const std::string& decoy, double size, Conditions& conditions) {
  for (const Decoy& row : decoys())
    if (row.info.decoy == decoy) return row.apply(size > 0 ? size : row.info.usual_size, conditions);
  throw std::invalid_argument("the stand has no decoy '" + decoy + "' (see `valvetriage_stand effects`)");
}

Command as_played(const Command& command, const Conditions& conditions, std::uint64_t noise_seed) {
  Command played = command;
  played.dither_a = conditions.dither_a;
  played.dither_hz = kDitherHz;
  if (conditions.setpoint_wander_a > 0) {
    const Wander wander({noise_seed, "setpoint " + command.name}, 0, conditions.setpoint_wander_a, 0.15);
    for (std::size_t k = 0; k < played.value_a.size(); ++k)
      played.value_a[k] += wander.at(static_cast<double>(k) * played.period_s);
  }
  if (conditions.jitter_s > 0) played.tick_s = jittered_instants_s(command, conditions.jitter_s, noise_seed);
  return played;
}

std::vector<double> sample_times_s(const Command& command) {
  std::vector<double> times_s;
  for (std::size_t k = 0; k < command.value_a.size(); ++k) times_s.push_back(command.instant_s(k));
  return times_s;
}

StandRecording log_recording(const Command& command, const Conditions& conditions, const Environment& environment,
                             std::uint64_t noise_seed, std::vector<double> times_s, std::vector<double> clean_psi) {
  StandRecording log;
  log.name = command.name;
  log.test = command.test;
  Noise pressure_noise({noise_seed, "pressure noise " + command.name}, conditions.noise_correlation_s,
                       command.period_s);
  Random current_noise(noise_seed, "current noise " + command.name);
  Random side_noise(noise_seed, "side noise " + command.name);
  for (std::size_t k = 0; k < times_s.size(); ++k) {
    const double t = times_s[k];
    const double ripple_a = conditions.ripple_a * std::sin(2 * std::numbers::pi * kRippleHz * t);
    const double seen_a = command.at(t) + kMonitorGain * (ripple_a + command.dither_at(t));
    log.command_a.push_back(command.at(t));
    log.current_a.push_back(
        quantised(seen_a + conditions.current_noise_a * current_noise.normal(), conditions.adc_psi / kPsiPerA));
    log.pressure_psi.push_back(
        quantised(clean_psi[k] + conditions.noise_psi * pressure_noise.next(), conditions.adc_psi));
    log.temperature_c.push_back(environment.temperature_c.at(t) + 0.02 * side_noise.normal());
    log.supply_psi.push_back(environment.supply_psi.at(t) + 0.2 * side_noise.normal());
  }
  log.time_s = std::move(times_s);
  log.clean_psi = std::move(clean_psi);
  const auto kept =
      kept_rows(log.time_s.size(), conditions.dropped_rows, Random(noise_seed, "dropouts " + command.name));
  for (auto* column : {&log.time_s, &log.current_a, &log.pressure_psi, &log.temperature_c, &log.supply_psi,
                       &log.command_a, &log.clean_psi})
    keep(*column, kept);
  return log;
}

}  // namespace valvetriage::stand
