#include "tests/stand/fleets.h"

#include <array>
#include <cstdio>

#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

std::string numbered(const std::string& prefix, int number, const char* format) {
  char buffer[24];
  std::snprintf(buffer, sizeof buffer, format, number);
  return prefix + buffer;
}

FleetValve valve_of(const std::string& serial, const std::string& lot, const std::string& condition,
                    std::uint64_t seed) {
  FleetValve valve;
  Random random(seed, "valve " + serial);
  valve.options.serial = serial;
  valve.options.lot = lot;
  valve.options.condition = condition;
  valve.options.unit_seed = random.next();
  valve.options.noise_seed = random.next();
  valve.kind = "good";
  valve.verdict = "Good";
  return valve;
}

struct Kind {
  const char *name, *effect;
};
constexpr std::array<Kind, 4> kKinds = {
    {{"sticking", "friction"}, {"leaking", "leakage"}, {"slow", "extra_lag"}, {"drifting", "thermal_drift"}}};

/// Sizes lie inside a verdict's range, away from its borders: nobody can tell a valve that sits on one.
void spoil(FleetValve& valve, const Kind& kind, bool severe, std::uint64_t seed) {
  const EffectInfo& info = effect_info(kind.effect);
  Random random(seed, "size " + valve.options.serial);
  const double size = severe ? random.log_uniform(info.severe_size, 2 * info.severe_size)
                             : random.log_uniform(info.malfunctioned_size, 0.6 * info.severe_size);
  valve.options.effects.push_back({kind.effect, size});
  valve.kind = kind.name;
  valve.verdict = severe ? "Severe" : "Malfunctioned";
}

}  // namespace

std::vector<FleetValve> good_population(int valves, std::uint64_t seed) {
  std::vector<FleetValve> fleet;
  for (int i = 1; i <= valves; ++i)
    fleet.push_back(valve_of(numbered("GOOD-", i, "%03d"), "reference", "new", Random(seed, "population").next()));
  return fleet;
}

std::vector<FleetValve> returned_lot(const std::string& lot, int valves, std::uint64_t seed) {
  const std::uint64_t lot_seed = Random(seed, "lot " + lot).next();
  std::vector<FleetValve> fleet;
  for (int i = 0; i < valves; ++i) {
    FleetValve valve = valve_of(numbered("EFC-", 104201 + i, "%d"), lot, "returned", lot_seed);
    // every third is good (no trouble found), the others take the kinds in turn, mild and severe
    if (i % 3 != 0) {
      const int faulty = i - i / 3 - 1;
      spoil(valve, kKinds[static_cast<std::size_t>(faulty % 4)], (faulty / 4) % 2 == 1, lot_seed);
    }
    fleet.push_back(valve);
  }
  return fleet;
}

std::vector<FleetValve> labelled_valves(int valves, std::uint64_t seed) {
  const std::uint64_t fleet_seed = Random(seed, "labelled").next();
  std::vector<FleetValve> fleet;
  for (int i = 0; i < valves; ++i) {
    FleetValve valve = valve_of(numbered("LAB-", i + 1, "%03d"), "labelled", "returned", fleet_seed);
    if (i % 3 != 0) spoil(valve, kKinds[static_cast<std::size_t>(i / 3 % 4)], i % 3 == 2, fleet_seed);
    fleet.push_back(valve);
  }
  return fleet;
}

}  // namespace valvetriage::stand
