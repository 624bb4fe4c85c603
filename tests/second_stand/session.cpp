#include "tests/second_stand/session.h"

#include <stdexcept>

#include "tests/second_stand/day.h"
#include "tests/second_stand/random.h"
#include "tests/second_stand/valve.h"

namespace valvetriage::second_stand {
namespace {

Conditions conditions_of(const Order& order) {
  Conditions conditions;
  conditions.noise_psi = order.noise_psi;
  for (const Asked& decoy : order.decoys) apply_decoy(decoy.name, decoy.size, conditions);
  return conditions;
}

Spoiled spoiled_by(const Order& order, const Unit& unit, const std::vector<Command>& commands) {
  return hide(order.effects, unit, commands, Random(order.unit_seed, "effects").seed() ^ order.noise_seed);
}

std::string numbered(const char* prefix, int number) {
  const std::string digits = std::to_string(number);
  return prefix + std::string(3 - std::min<std::size_t>(3, digits.size()), '0') + digits;
}

}  // namespace

std::vector<Command> commands_of(const Order& order) {
  std::vector<Command> commands;
  for (const std::string& test : order.tests)
    for (Command& command : commands_of(test)) commands.push_back(std::move(command));
  commands.insert(commands.end(), order.inputs.begin(), order.inputs.end());
  if (commands.empty()) throw std::invalid_argument("nothing to play");
  return commands;
}

Session play(const Order& order) {
  Session session{order, unit_of(draw_latents(order.unit_seed)), {}, {}};
  const Conditions conditions = conditions_of(order);
  const std::vector<Command> commands = commands_of(order);
  Spoiled spoiled = spoiled_by(order, session.unit, commands);
  for (std::size_t i = 0; i < commands.size(); ++i) {
    const Day day(order.noise_seed, commands[i].name, conditions.supply_drift_psi);
    const Command clocked = as_clocked(commands[i], conditions, order.noise_seed);
    auto clean_psi = play_valve(session.unit, spoiled.faults[i], clocked, day, conditions.dither_a);
    session.logs.push_back(log_of(clocked, conditions, day, order.noise_seed, std::move(clean_psi)));
  }
  session.truth = std::move(spoiled.truth);
  return session;
}

std::vector<double> clean_outputs(const Order& order, const Unit& unit) {
  const std::vector<Command> commands = commands_of(order);
  const Spoiled spoiled = spoiled_by(order, unit, commands);
  std::vector<double> all;
  for (std::size_t i = 0; i < commands.size(); ++i) {
    const auto clean_psi = play_valve(unit, spoiled.faults[i], commands[i], Day(order.noise_seed, commands[i].name, 0));
    all.insert(all.end(), clean_psi.begin(), clean_psi.end());
  }
  return all;
}

std::vector<Order> good_population(int valves, std::uint64_t seed, const std::vector<std::string>& tests) {
  std::vector<Order> orders;
  for (int i = 1; i <= valves; ++i) {
    Order order;
    order.serial = numbered("GOOD-", i);
    order.lot = "reference";
    order.condition = "new";
    Random random(seed, "valve " + order.serial);
    order.unit_seed = random.seed();
    order.noise_seed = random.seed();
    order.tests = tests;
    orders.push_back(order);
  }
  return orders;
}

}  // namespace valvetriage::second_stand
