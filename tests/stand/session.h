#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tests/stand/acquisition.h"
#include "tests/stand/command.h"
#include "tests/stand/effects.h"
#include "tests/stand/integration.h"
#include "tests/stand/unit.h"

namespace valvetriage::stand {

/// What a session is made of. Equal values give equal bytes.
struct SessionOptions {
  std::string serial = "EFC-1", lot = "lot-1", valve_type = "type-1", stand = "stand-3", condition = "returned";
  std::string tested_at = "2026-08-03T09:12:44Z";
  std::uint64_t unit_seed = 1;   ///< which valve
  std::uint64_t noise_seed = 1;  ///< which day: noise, history, fluid temperature, supply
  std::vector<std::string> tests = {"step", "staircase", "triangle", "sweep"};  ///< of the repertoire
  std::vector<Command> inputs;                                                  ///< played after the tests
  std::vector<EffectRequest> effects;
  std::vector<std::pair<std::string, double>> decoys;  ///< name and size (0: usual)
  double noise_psi = 0.35;
  Tolerance tolerance;
};

struct Session {
  SessionOptions options;
  std::vector<StandRecording> recordings;
  std::vector<HiddenEffect> truth;
  Unit unit;
};

/// The six recordings of 4,000 samples that a full session consists of.
std::vector<std::string> full_session();

/// The commands that a session plays, in order.
std::vector<Command> commands_of_session(const SessionOptions& options);

/// What the effects draw from beside their sizes (see `hide_effects`).
std::uint64_t effect_seed(const SessionOptions& options);

/// Plays the tests on the unit. Throws std::invalid_argument for what the stand does not have.
Session run_session(const SessionOptions& options);

/// The session and its twin without the effects: same unit, same day. The difference of their noise-free outputs is the
/// signature of the effects.
struct Signature {
  Session healthy, spoiled;
};
Signature signature_of(const SessionOptions& options);

}  // namespace valvetriage::stand
