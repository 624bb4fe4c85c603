#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/stand/command.h"
#include "tests/stand/faults.h"
#include "tests/stand/unit.h"

namespace valvetriage::stand {

/// An effect asked for by name, with its one size.
struct EffectRequest {
  std::string effect;
  double size = 0;
};

/// A parameter of the contract's table of causes, or of the effect where the contract has none.
struct EffectParameter {
  std::string name;
  double value = 0;
  std::string unit;
};

/// One row of the table of effects (README): its size's meaning, the range over which the size is drawn (log-uniform;
/// on a full session the distance d of tests/hidden_effects then spans about 2 to 200, less where physics ends first:
/// gain_loss, hysteresis), and the sizes at which a valve counts as malfunctioned and as severe.
struct EffectInfo {
  std::string effect, origin, family, size_meaning;
  double smallest = 0, largest = 0;
  double malfunctioned_size = 0, severe_size = 0;
  bool in_vocabulary = true;
};

/// One hidden effect as the truth file tells it.
struct HiddenEffect {
  EffectInfo info;
  double size = 0;
  std::vector<EffectParameter> parameters;
  std::string recording;  ///< where it is in one recording only
};

/// The faults of each recording of a session.
struct SpoiledSession {
  std::vector<Faults> faults;
  std::vector<HiddenEffect> truth;
};

/// Every effect that can be hidden on the valve, the contract's causes first.
const std::vector<EffectInfo>& effect_table();
/// Throws std::invalid_argument for a name that the table does not have.
const EffectInfo& effect_info(const std::string& effect);

/// Hides effects on a unit that plays these commands; what an effect needs beside its size (a ratio, an instant, a
/// sign) is drawn from `seed` and its name. A size of zero changes nothing.
/// Throws std::invalid_argument for an unknown effect, a negative size, or one beyond what the physics allows.
SpoiledSession hide_effects(const std::vector<EffectRequest>& requests, const Unit& unit,
                            const std::vector<Command>& commands, std::uint64_t seed);

}  // namespace valvetriage::stand
