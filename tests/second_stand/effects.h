#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/second_stand/command.h"
#include "tests/second_stand/faults.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// What can be hidden: its name, and the sizes between which it is drawn (log-uniform). Family `outside`: no cause of
/// the contract explains it.
struct EffectKind {
  std::string name, origin, family;
  double smallest, largest;
  std::string size_meaning;
};

/// The contract's causes first, then those outside.
const std::vector<EffectKind>& effect_kinds();

struct Parameter {
  std::string name;
  double value;
  std::string unit;
};

/// One hidden effect as the truth tells it.
struct HiddenEffect {
  EffectKind kind;
  double size = 0;
  std::vector<Parameter> parameters;
  std::string recording;  ///< where it is in one recording only
};

/// Name and size of what is asked for.
struct Asked {
  std::string name;
  double size = 0;
};

/// The faults of each recording, and the truth about them.
struct Spoiled {
  std::vector<Faults> faults;
  std::vector<HiddenEffect> truth;
};

/// Hides effects in a valve that plays these commands. What an effect needs beside its size comes from `seed` and its
/// name. Size 0 changes nothing. Throws std::invalid_argument for an unknown name, one asked for twice, or a size that
/// physics does not allow.
Spoiled hide(const std::vector<Asked>& asked, const Unit& unit, const std::vector<Command>& commands,
             std::uint64_t seed);

}  // namespace valvetriage::second_stand
