#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/second_stand/distance.h"
#include "tests/second_stand/files.h"
#include "tests/second_stand/random.h"
#include "tests/second_stand/session.h"

namespace valvetriage::second_stand {
namespace {

std::vector<std::string> parts_of(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

std::vector<std::string> tests_of(const std::string& text) {
  if (text == "none") return {};
  return text == "full" ? full_session() : parts_of(text, ',');
}

/// NAME=SIZE; without a size 0.
Asked asked_of(const std::string& text) {
  const auto parts = parts_of(text, '=');
  std::size_t used = 0;
  Asked asked{parts.empty() ? "" : parts[0], 0};
  if (parts.size() == 1 && text.find('=') == std::string::npos) return asked;
  if (parts.size() == 2) {
    try {
      asked.size = std::stod(parts[1], &used);
    } catch (const std::logic_error&) {
      used = 0;
    }
  }
  if (used == 0 || used != parts[1].size()) throw std::invalid_argument("'" + text + "' is not NAME=SIZE");
  return asked;
}

/// What `session` is told.
struct SessionLine {
  Order order;
  std::string tests = "full", out, truth, clean, unit_seed;
  std::vector<std::string> inputs, effects, decoys;

  void options_of(CLI::App& app) {
    app.add_option("--out", out)->required();
    app.add_option("--serial", order.serial)->required();
    app.add_option("--lot", order.lot)->required();
    app.add_option("--valve-type", order.valve_type);
    app.add_option("--stand", order.stand);
    app.add_option("--condition", order.condition);
    app.add_option("--unit-seed", unit_seed, "which valve (default: from the serial)");
    app.add_option("--noise-seed", order.noise_seed, "which day");
    app.add_option("--tests", tests, "TEST,TEST... of the repertoire, full or none");
    app.add_option("--input", inputs, "a current to play: time_s,current_A");
    app.add_option("--effect", effects, "NAME=SIZE");
    app.add_option("--decoy", decoys, "NAME[=SIZE]");
    app.add_option("--noise-psi", order.noise_psi);
    app.add_option("--truth", truth, "where the sealed truth goes");
    app.add_option("--clean", clean, "where the noise-free outputs go");
  }

  void run() {
    order.unit_seed = unit_seed.empty() ? Random::digest(order.serial) : std::stoull(unit_seed);
    order.tests = tests_of(tests);
    for (const std::string& input : inputs) order.inputs.push_back(read_command(input));
    for (const std::string& effect : effects) {
      order.effects.push_back(asked_of(effect));
      if (effect.find('=') == std::string::npos) throw std::invalid_argument("effect '" + effect + "' needs a size");
    }
    for (const std::string& decoy : decoys) order.decoys.push_back(asked_of(decoy));
    const Session session = play(order);
    write_recordings(out, session);
    if (!truth.empty()) write_truth(truth, session);
    if (!clean.empty()) write_clean(clean, session);
  }
};

/// What `population` is told.
struct PopulationLine {
  std::string out, tests = "full";
  int valves = 8;
  std::uint64_t seed = 1;

  void options_of(CLI::App& app) {
    app.add_option("--out", out)->required();
    app.add_option("--valves", valves)->check(CLI::Range(1, 100000));
    app.add_option("--seed", seed);
    app.add_option("--tests", tests);
  }

  void run() const {
    for (const Order& order : good_population(valves, seed, tests_of(tests)))
      write_recordings(std::filesystem::path(out) / order.serial, play(order));
  }
};

/// Answers every line `KIND TESTS UNIT_SEED NOISE_SEED NAME=SIZE,NAME=SIZE...` by `d d_name oracle_set rival`, as the
/// first stand's program of distances does; only d is known here.
void answer_distances() {
  std::map<std::string, std::unique_ptr<Distance>> by_tests;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string kind, tests, effects;
    Order order;
    if (!(words >> kind >> tests >> order.unit_seed >> order.noise_seed >> effects))
      throw std::invalid_argument("a line is KIND TESTS UNIT_SEED NOISE_SEED EFFECTS");
    order.tests = tests_of(tests);
    for (const std::string& effect : parts_of(effects, ',')) order.effects.push_back(asked_of(effect));
    std::unique_ptr<Distance>& distance = by_tests[tests];
    if (!distance) distance = std::make_unique<Distance>(order.tests);
    fmt::print("{:.6g} nan nan -\n", distance->measure(order).d);
    std::cout.flush();
    std::fflush(stdout);
  }
}

void list_repertoire() {
  fmt::print("effects: name, origin, family, range of sizes, meaning of the size\n");
  for (const EffectKind& kind : effect_kinds())
    fmt::print("  {:<20} {:<6} {:<11} {:>7} to {:<7} {}\n", kind.name, kind.origin, kind.family, kind.smallest,
               kind.largest, kind.size_meaning);
  fmt::print("decoys: name, usual size, meaning of the size\n");
  for (const Decoy& decoy : decoys())
    fmt::print("  {:<20} {:>7} {}\n", decoy.name, decoy.usual_size, decoy.size_meaning);
  fmt::print("tests:");
  for (const std::string& name : repertoire()) fmt::print(" {}", name);
  fmt::print("\n");
}

void run(int argc, char** argv) {
  CLI::App app("The second virtual test stand: another valve, another day, another truth (README).");
  app.require_subcommand(1);
  SessionLine session;
  PopulationLine population;
  CLI::App* playing = app.add_subcommand("session", "one valve's recordings");
  CLI::App* good = app.add_subcommand("population", "good valves in folders by serial");
  CLI::App* measuring = app.add_subcommand("distance", "d of cases, a line each on standard input");
  app.add_subcommand("effects", "every effect, decoy and test by name");
  session.options_of(*playing);
  population.options_of(*good);
  app.parse(argc, argv);
  if (*playing)
    session.run();
  else if (*good)
    population.run();
  else if (*measuring)
    answer_distances();
  else
    list_repertoire();
}

}  // namespace
}  // namespace valvetriage::second_stand

int main(int argc, char** argv) {
  try {
    valvetriage::second_stand::run(argc, argv);
    return 0;
  } catch (const CLI::CallForHelp&) {
    fmt::print("valvetriage_second_stand session|population|distance|effects [options]; see README.md\n");
    return 0;
  } catch (const CLI::ParseError& error) {
    fmt::print(stderr, "valvetriage_second_stand: {}\n", error.what());
    return 2;
  } catch (const std::logic_error& error) {
    fmt::print(stderr, "valvetriage_second_stand: {}\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    fmt::print(stderr, "valvetriage_second_stand: {}\n", error.what());
    return 1;
  }
}
