#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "tests/second_stand/session.h"
#include "tests/second_stand/valve.h"

namespace valvetriage::second_stand {

inline Unit nominal_unit() {
  return unit_of(Latents(latent_names().size(), 0));
}

inline std::vector<double> played(const std::string& test, const Faults& faults = {}, const Unit& unit = nominal_unit(),
                                  std::uint64_t day = 7) {
  const Command command = commands_of(test).front();
  return play_valve(unit, faults, command, Day(day, command.name, 0));
}

inline double rms_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double squares = 0;
  for (std::size_t k = 0; k < a.size(); ++k) squares += (a[k] - b[k]) * (a[k] - b[k]);
  return std::sqrt(squares / static_cast<double>(a.size()));
}

inline Order order_of(std::vector<std::string> tests, std::vector<Asked> effects = {}, std::vector<Asked> decoys = {}) {
  Order order;
  order.tests = std::move(tests);
  order.effects = std::move(effects);
  order.decoys = std::move(decoys);
  return order;
}

}  // namespace valvetriage::second_stand
