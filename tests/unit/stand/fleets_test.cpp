#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tests/stand/fleets.h"

namespace valvetriage::stand {
namespace {

bool has(const std::vector<FleetValve>& fleet, std::string FleetValve::*member, const std::string& value) {
  return std::any_of(fleet.begin(), fleet.end(), [&](const FleetValve& valve) { return valve.*member == value; });
}

TEST(Fleets, LabelledValvesCarryEveryVerdict) {
  for (const char* verdict : {"Good", "Malfunctioned", "Severe"})
    EXPECT_TRUE(has(labelled_valves(36, 1), &FleetValve::verdict, verdict));
}

TEST(Fleets, ReturnedLotCarriesEveryKind) {
  for (const char* kind : {"good", "sticking", "leaking", "slow", "drifting"})
    EXPECT_TRUE(has(returned_lot("L", 12, 1), &FleetValve::kind, kind));
}

TEST(Fleets, GoodValvesAreDifferentUnitsWithoutFaults) {
  std::set<std::uint64_t> units;
  for (const FleetValve& valve : good_population(8, 1)) {
    EXPECT_TRUE(valve.options.effects.empty());
    units.insert(valve.options.unit_seed);
  }
  EXPECT_EQ(units.size(), 8u);
}

TEST(Fleets, SevereFaultsAreLargerThanMalfunctions) {
  for (const FleetValve& valve : labelled_valves(300, 1))
    for (const EffectRequest& effect : valve.options.effects) {
      const double border = effect_info(effect.effect).severe_size;
      EXPECT_EQ(valve.verdict == "Severe", effect.size >= border) << effect.effect;
    }
}

}  // namespace
}  // namespace valvetriage::stand
