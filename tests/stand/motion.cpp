#include "tests/stand/motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/stand/bristles.h"
#include "tests/stand/environment.h"
#include "tests/stand/hysteresis.h"
#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

/// The linear machine and what is wrong with it.
struct Plant {
  double rad_s, damping_ratio, gain;
  double cubic = 0, breakaway = 0, kinetic = 0, play = 0, loop = 0, dead_width = 0, offset = 0;
  double ceiling = Faults::kNever;
  bool rectified = false;
};

Plant draw_plant(std::uint64_t seed) {
  Random random(seed, "motion");
  return {2 * std::numbers::pi * random.uniform(1.5, 4), random.uniform(0.15, 0.6), random.uniform(0.8, 1.2)};
}

using Parameters = std::vector<EffectParameter>;
struct MotionEffect {
  const char* name;
  const char* size_meaning;
  Parameters (*apply)(double size, Plant&);
};

const std::vector<MotionEffect>& table() {
  static const std::vector<MotionEffect> effects = {
      {"rectified_sensor", "1: magnitude only",
       [](double size, Plant& p) -> Parameters {
         p.rectified = size > 0;
         return {};
       }},
      {"stiffening_spring", "cubic coefficient [1/y2]",
       [](double size, Plant& p) -> Parameters {
         p.cubic = size;
         return {{"cubic_coefficient", size, ""}};
       }},
      {"friction", "breakaway [u]",
       [](double size, Plant& p) -> Parameters {
         p.breakaway = size;
         p.kinetic = 0.7 * size;
         return {{"breakaway_A", size, ""}, {"kinetic_A", 0.7 * size, ""}};
       }},
      {"backlash", "full width [u]",
       [](double size, Plant& p) -> Parameters {
         p.play = size;
         return {{"width_A", size, ""}};
       }},
      {"hysteresis", "full width of the major loop [u]",
       [](double size, Plant& p) -> Parameters {
         p.loop = size;
         return {{"width_A", size, ""}};
       }},
      {"dead_band", "width around zero [u]",
       [](double size, Plant& p) -> Parameters {
         p.dead_width = size;
         return {{"centre_A", 0, ""}, {"width_A", size, ""}};
       }},
      {"saturation", "1 / level [1/y], both sides",
       [](double size, Plant& p) -> Parameters {
         p.ceiling = 1 / size;
         return {{"level_psi", 1 / size, ""}, {"lower_level_psi", -1 / size, ""}};
       }},
      {"sensor_offset", "offset [y]",
       [](double size, Plant& p) -> Parameters {
         p.offset = size;
         return {{"offset_psi", size, ""}};
       }},
  };
  return effects;
}

HiddenEffect spoil(const EffectRequest& request, Plant& plant) {
  for (const MotionEffect& effect : table()) {
    if (request.effect != effect.name) continue;
    HiddenEffect hidden{effect_info(effect.name), request.size, {}, ""};
    hidden.info.size_meaning = effect.size_meaning;
    if (request.size > 0) hidden.parameters = effect.apply(request.size, plant);
    return hidden;
  }
  throw std::invalid_argument("the motion plant has no effect '" + request.effect + "'");
}

/// The plant in continuous time.
class Motion {
 public:
  using State = std::array<double, 3>;  // position [y], speed over ω [y], bristle force [u]

  Motion(const Plant& plant, const Command& command)
      : plant_(plant), command_(command), next_step_(command.step_after(0)), loop_(plant.loop, 1.5), play_(plant.play) {
    bristles_.breakaway = plant.breakaway;
    bristles_.kinetic = plant.kinetic;
    bristles_.stribeck_speed = 0.05 * plant.rad_s;
    bristles_.stiffness = 100;
    bristles_.damping = 20 / plant.rad_s;
    loop_.remember(command.value_a.front());
    play_.remember(command.value_a.front());
  }

  void rate(const State& s, State& r, double t) const {
    const double speed = s[1] * plant_.rad_s;
    r[2] = bristles_.rate(s[2], speed);
    r[0] = speed;
    const double drive = plant_.gain * (driven(input(t)) - bristles_.friction(s[2], r[2]));
    r[1] = plant_.rad_s * (drive - s[0] - plant_.cubic * s[0] * s[0] * s[0] - 2 * plant_.damping_ratio * s[1]);
  }
  double next_step_s() const { return command_.step_time_s(next_step_); }
  void pass_step() { next_step_ = command_.step_after(next_step_); }
  int switch_count() const { return plant_.loop > 0 || plant_.play > 0 ? 1 : 0; }
  /// Slope of the input, a kink of which is a sample: the input is linear between samples.
  double switch_value(int, const State&, double t) const { return slope(t); }
  void remember(const State&, double t) {
    play_.remember(loop_.at(live(input(t))));
    loop_.remember(live(input(t)));
  }
  double shown(const State& s) const {
    const double position = std::clamp(s[0], -plant_.ceiling, plant_.ceiling) + plant_.offset;
    return plant_.rectified ? std::abs(position) : position;
  }

 private:
  double input(double t) const { return command_.at(t, next_step_); }
  double slope(double t) const { return (input(t + 1e-6) - input(t)) / 1e-6; }
  double live(double u) const {
    if (plant_.dead_width <= 0) return u;
    const double half = 0.5 * plant_.dead_width;
    return u > half ? u - half : std::min(u + half, 0.0);
  }
  double driven(double u) const { return play_.at(loop_.at(live(u))); }

  const Plant& plant_;
  const Command& command_;
  std::size_t next_step_;
  Bristles bristles_;
  MagneticMemory loop_;
  Play play_;
};

Command motion_command(const std::string& name, double amplitude) {
  Command command;
  command.name = name;
  command.test = "other";
  for (const double value : multisine(command.period_s, 10, 8, 3)) command.value_a.push_back(amplitude * value);
  command.is_step.assign(command.value_a.size(), 0);
  return command;
}

Command random_steps() {
  Command command;
  command.name = "random_steps";
  command.test = "other";
  Random random(1, "motion steps");
  for (int level = 0; level < 20; ++level) {
    command.value_a.insert(command.value_a.end(), 300, random.uniform(-2, 2));
    command.is_step.insert(command.is_step.end(), 300, 0);
    command.is_step[command.is_step.size() - 300] = level > 0;
  }
  return command;
}

StandRecording record(const SessionOptions& options, const Plant& plant, const Command& command) {
  const Environment environment(options.noise_seed, command.name);
  Conditions conditions;
  conditions.noise_psi = options.noise_psi;
  for (const auto& [decoy, size] : options.decoys) apply_decoy(decoy, size, conditions);
  const Command played = as_played(command, conditions, options.noise_seed);
  const std::vector<double> times_s = sample_times_s(played);
  Motion motion(plant, played);
  Integration<Motion> integration(motion, {plant.gain * played.value_a.front(), 0, 0}, -10, options.tolerance);
  std::vector<double> clean;
  integration.run(times_s, [&](const Motion::State& state, double) { clean.push_back(motion.shown(state)); });
  return log_recording(played, conditions, environment, options.noise_seed, times_s, clean);
}

}  // namespace

const std::vector<std::string>& motion_effects() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const MotionEffect& effect : table()) all.emplace_back(effect.name);
    return all;
  }();
  return names;
}

Session run_motion(const SessionOptions& options) {
  Session session;
  session.options = options;
  Plant plant = draw_plant(options.unit_seed);
  for (const EffectRequest& request : options.effects) session.truth.push_back(spoil(request, plant));
  for (const Command& command : {motion_command("low", 0.4), motion_command("high", 1.2), random_steps()})
    session.recordings.push_back(record(options, plant, command));
  return session;
}

}  // namespace valvetriage::stand
