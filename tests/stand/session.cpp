#include "tests/stand/session.h"

#include <cmath>
#include <numbers>

#include "tests/stand/command.h"
#include "tests/stand/random.h"
#include "tests/stand/valve.h"

namespace valvetriage::stand {
namespace {

/// A slowly wandering quantity: a few incommensurate sines of random phase.
class Wander {
 public:
  Wander(Random random, double mean, double amplitude, double fastest_hz) : mean_(mean) {
    double hz = fastest_hz;
    for (Wave& wave : wave_) {
      wave = {amplitude * random.uniform(0.5, 1.0) / 3, 2 * std::numbers::pi * hz,
              2 * std::numbers::pi * random.uniform()};
      hz *= 0.43;
    }
  }
  double at(double t) const {
    double sum = mean_;
    for (const Wave& wave : wave_) sum += wave.amplitude * std::sin(wave.rad_s * t + wave.phase);
    return sum;
  }

 private:
  struct Wave {
    double amplitude, rad_s, phase;
  };
  double mean_;
  Wave wave_[3];
};

StandRecording record(const SessionOptions& options, const Unit& unit, const Faults& faults, const Command& command) {
  StandRecording recording;
  recording.name = command.name;
  recording.test = command.test;
  const std::size_t n = command.value_a.size();
  for (std::size_t k = 0; k < n; ++k) recording.time_s.push_back(static_cast<double>(k) * command.period_s);
  recording.clean_psi = run_valve(unit, faults, command, options.noise_seed, recording.time_s);

  Random noise(options.noise_seed, "noise " + command.name);
  const Wander temperature({options.noise_seed, "temperature " + command.name}, 40 + 4 * noise.normal(), 0.8, 0.05);
  const Wander supply({options.noise_seed, "supply " + command.name}, 480 + 3 * noise.normal(), 4, 0.3);
  for (std::size_t k = 0; k < n; ++k) {
    const double t = recording.time_s[k];
    recording.current_a.push_back(command.value_a[k] + options.current_noise_a * noise.normal());
    recording.pressure_psi.push_back(recording.clean_psi[k] + options.noise_psi * noise.normal());
    recording.temperature_c.push_back(temperature.at(t) + 0.02 * noise.normal());
    recording.supply_psi.push_back(supply.at(t) + 0.2 * noise.normal());
  }
  return recording;
}

}  // namespace

Session run_session(const SessionOptions& options) {
  Session session;
  session.options = options;
  session.unit = draw_unit(options.unit_seed);
  Faults faults;
  const std::uint64_t effect_seed = Random(options.unit_seed, "effects").next() ^ options.noise_seed;
  for (const EffectRequest& request : options.effects)
    session.truth.push_back(apply_effect(request, session.unit, effect_seed, faults));
  for (const std::string& test : options.tests)
    for (const Command& command : commands_of(test))
      session.recordings.push_back(record(options, session.unit, faults, command));
  return session;
}

}  // namespace valvetriage::stand
