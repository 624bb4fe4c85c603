#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/stand/session.h"

namespace valvetriage::stand {

/// One valve of a fleet: what to play on it and what is said of it.
struct FleetValve {
  SessionOptions options;
  std::string kind;     ///< good sticking leaking slow drifting
  std::string verdict;  ///< Good Malfunctioned Severe, by the physical size of what is wrong
};

/// Good valves of one type, for `reference learn`.
std::vector<FleetValve> good_population(int valves, std::uint64_t seed);
/// The returned lot of the demonstration: good, sticking, leaking, slow and drifting valves.
std::vector<FleetValve> returned_lot(const std::string& lot, int valves, std::uint64_t seed);
/// Valves whose verdict is known from the size of their fault, for `rule-base learn`.
std::vector<FleetValve> labelled_valves(int valves, std::uint64_t seed);

}  // namespace valvetriage::stand
