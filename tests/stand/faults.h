#pragma once

#include <limits>
#include <string>
#include <vector>

#include "tests/stand/unit.h"

namespace valvetriage::stand {

/// What is wrong with a unit or its stand, in physical numbers; every default is neutral. All are excesses over the
/// healthy unit. Currents are input equivalents at 1.6 A.
struct Faults {
  double breakaway_a = 0, kinetic_a = 0;
  double leak_fraction = 0;
  double extra_lag_s = 0;
  double warming_gain_change = 0, warming_time_constant_s = 1;
  double offset_psi = 0, drift_psi_per_s = 0;
};

/// Effects asked for by name, each with its one size.
struct EffectRequest {
  std::string effect;
  double size = 0;
};

struct EffectParameter {
  std::string name;
  double value = 0;
  std::string unit;
};

/// One hidden effect as the truth file tells it.
struct HiddenEffect {
  std::string effect, origin, family;
  double size = 0;
  std::string size_meaning;
  bool in_vocabulary = true;
  std::vector<EffectParameter> parameters;
};

/// One row of the table of effects (README): name, the meaning of its size, and the sizes at which a valve counts as
/// malfunctioned and as severe.
struct EffectInfo {
  std::string effect, origin, family, size_meaning;
  bool in_vocabulary = true;
  double malfunctioned_size = 0, severe_size = 0;
};

const std::vector<EffectInfo>& effect_table();

/// Puts an effect of the given size on `faults`; what else it needs (a ratio, an instant) is drawn from `seed`.
/// A size of zero changes nothing. Throws std::invalid_argument for an unknown effect or a negative size.
HiddenEffect apply_effect(const EffectRequest& request, const Unit& unit, std::uint64_t seed, Faults& faults);

}  // namespace valvetriage::stand
