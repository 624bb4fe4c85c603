#include "tests/stand/session.h"

#include "tests/stand/environment.h"
#include "tests/stand/random.h"
#include "tests/stand/valve.h"

namespace valvetriage::stand {
namespace {

Conditions conditions_of(const SessionOptions& options) {
  Conditions conditions;
  conditions.noise_psi = options.noise_psi;
  for (const auto& [decoy, size] : options.decoys) apply_decoy(decoy, size, conditions);
  return conditions;
}

StandRecording record(const SessionOptions& options, const Unit& unit, const Faults& faults,
                      const Conditions& conditions, const Command& command) {
  const Environment environment(options.noise_seed, command.name);
  const Command played = as_played(command, conditions, options.noise_seed);
  std::vector<double> times_s = sample_times_s(played);
  std::vector<double> clean_psi = run_valve(unit, faults, played, environment, times_s, options.tolerance);
  return log_recording(played, conditions, environment, options.noise_seed, std::move(times_s), std::move(clean_psi));
}

}  // namespace

std::vector<std::string> full_session() {
  return {"steps", "staircase", "triangle", "triangle_fast", "sweep", "multisine"};
}

std::vector<Command> commands_of_session(const SessionOptions& options) {
  std::vector<Command> commands;
  for (const std::string& test : options.tests)
    for (Command& command : commands_of(test)) commands.push_back(std::move(command));
  commands.insert(commands.end(), options.inputs.begin(), options.inputs.end());
  return commands;
}

std::uint64_t effect_seed(const SessionOptions& options) {
  return Random(options.unit_seed, "effects").next() ^ options.noise_seed;
}

Session run_session(const SessionOptions& options) {
  Session session;
  session.options = options;
  session.unit = draw_unit(options.unit_seed);
  const std::vector<Command> commands = commands_of_session(options);
  const Conditions conditions = conditions_of(options);
  SpoiledSession spoiled = hide_effects(options.effects, session.unit, commands, effect_seed(options));
  for (std::size_t i = 0; i < commands.size(); ++i)
    session.recordings.push_back(record(options, session.unit, spoiled.faults[i], conditions, commands[i]));
  session.truth = std::move(spoiled.truth);
  return session;
}

Signature signature_of(const SessionOptions& options) {
  SessionOptions healthy = options;
  healthy.effects.clear();
  return {run_session(healthy), run_session(options)};
}

}  // namespace valvetriage::stand
