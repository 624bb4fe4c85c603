#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "tests/stand/faults.h"

namespace valvetriage::stand {

/// What a session is made of. Equal values give equal bytes.
struct SessionOptions {
  std::string serial = "EFC-1", lot = "lot-1", valve_type = "type-1", stand = "stand-3", condition = "returned";
  std::string tested_at = "2026-08-03T09:12:44Z";
  std::uint64_t unit_seed = 1;   ///< which valve
  std::uint64_t noise_seed = 1;  ///< which day: noise, history, fluid temperature, supply
  std::vector<std::string> tests = {"step", "staircase", "triangle", "sweep"};
  std::vector<EffectRequest> effects;
  double noise_psi = 0.35, current_noise_a = 0.0005;
};

/// One recording; columns in the contract's units.
struct StandRecording {
  std::string name, test;
  std::vector<double> time_s, current_a, pressure_psi, temperature_c, supply_psi;
  std::vector<double> clean_psi;  ///< without noise, for the scorer only
};

struct Session {
  SessionOptions options;
  std::vector<StandRecording> recordings;
  std::vector<HiddenEffect> truth;
  Unit unit;
};

/// Plays the tests on the unit. Throws std::invalid_argument for what the stand does not have.
Session run_session(const SessionOptions& options);

}  // namespace valvetriage::stand
