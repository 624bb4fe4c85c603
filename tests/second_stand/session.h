#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/second_stand/acquisition.h"
#include "tests/second_stand/command.h"
#include "tests/second_stand/effects.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// What a session is made of; equal values give equal bytes.
struct Order {
  std::string serial = "EFC-2001", lot = "lot-1", valve_type = "type-1", stand = "stand-7", condition = "returned";
  std::uint64_t unit_seed = 1;   ///< which valve
  std::uint64_t noise_seed = 1;  ///< which day: noise, past, temperature, supply
  std::vector<std::string> tests;
  std::vector<Command> inputs;  ///< played after the tests
  std::vector<Asked> effects;
  std::vector<Asked> decoys;
  double noise_psi = Conditions{}.noise_psi;
};

struct Session {
  Order order;
  Unit unit;
  std::vector<HiddenEffect> truth;
  std::vector<Log> logs;
};

std::vector<Command> commands_of(const Order& order);

/// Throws std::invalid_argument for what the stand does not have, or where there is nothing to play.
Session play(const Order& order);

/// The noise-free outputs of an order on a given healthy unit, one recording after the other.
std::vector<double> clean_outputs(const Order& order, const Unit& unit);

/// `valves` good valves for `reference learn`.
std::vector<Order> good_population(int valves, std::uint64_t seed, const std::vector<std::string>& tests);

}  // namespace valvetriage::second_stand
