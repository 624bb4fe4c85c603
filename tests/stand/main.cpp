#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/stand/files.h"
#include "tests/stand/fleets.h"
#include "tests/stand/random.h"
#include "tests/stand/session.h"

namespace valvetriage::stand {
namespace {

constexpr const char* kUsage =
    "usage: valvetriage_stand session    --out DIR --serial S --lot L [--valve-type T] [--stand NAME] [--condition C]\n"
    "                                    [--unit-seed N] [--noise-seed N] [--tests step,staircase,triangle,sweep]\n"
    "                                    [--effect NAME=SIZE]... [--noise-psi X] [--truth FILE] [--clean DIR]\n"
    "       valvetriage_stand population --out DIR [--valves 8] [--seed N] [--tests ...]\n"
    "       valvetriage_stand lot        --out DIR --lot L [--valves 15] [--seed N] [--tests ...] [--truth FILE]\n"
    "       valvetriage_stand labelled   --out DIR [--valves 36] [--seed N] [--tests ...]\n"
    "       valvetriage_stand effects\n";

/// `--key value` pairs in order; a key may come again.
class Arguments {
 public:
  Arguments(int count, char** values, const std::vector<std::string>& known) {
    for (int i = 2; i < count; i += 2) {
      const std::string key = values[i];
      bool accepted = false;
      for (const std::string& name : known) accepted = accepted || key == "--" + name;
      if (!accepted) throw std::invalid_argument("unknown option '" + key + "'");
      if (i + 1 >= count) throw std::invalid_argument("option '" + key + "' needs a value");
      given_[key.substr(2)].push_back(values[i + 1]);
    }
  }
  std::string text(const std::string& key, const std::string& otherwise) const {
    const auto found = given_.find(key);
    return found == given_.end() ? otherwise : found->second.back();
  }
  std::string required(const std::string& key) const {
    if (!given_.contains(key)) throw std::invalid_argument("option '--" + key + "' is required");
    return text(key, "");
  }
  std::vector<std::string> all(const std::string& key) const {
    const auto found = given_.find(key);
    return found == given_.end() ? std::vector<std::string>{} : found->second;
  }
  bool has(const std::string& key) const { return given_.contains(key); }

 private:
  std::map<std::string, std::vector<std::string>> given_;
};

double number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') throw std::invalid_argument("'" + text + "' is not a number");
  return value;
}

std::uint64_t seed_of(const std::string& text) {
  char* end = nullptr;
  const std::uint64_t value = std::strtoull(text.c_str(), &end, 10);
  if (text.empty() || *end != '\0') throw std::invalid_argument("'" + text + "' is not a seed");
  return value;
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

EffectRequest effect_of(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) throw std::invalid_argument("effect '" + text + "' needs a size: NAME=SIZE");
  return {text.substr(0, equals), number(text.substr(equals + 1))};
}

SessionOptions session_options(const Arguments& arguments) {
  SessionOptions options;
  options.serial = arguments.required("serial");
  options.lot = arguments.required("lot");
  options.valve_type = arguments.text("valve-type", options.valve_type);
  options.stand = arguments.text("stand", options.stand);
  options.condition = arguments.text("condition", options.condition);
  options.unit_seed =
      arguments.has("unit-seed") ? seed_of(arguments.text("unit-seed", "")) : Random::hash(options.serial);
  options.noise_seed = seed_of(arguments.text("noise-seed", "1"));
  if (arguments.has("tests")) options.tests = split(arguments.text("tests", ""));
  if (arguments.has("noise-psi")) options.noise_psi = number(arguments.text("noise-psi", ""));
  for (const std::string& effect : arguments.all("effect")) options.effects.push_back(effect_of(effect));
  return options;
}

void play_session(const Arguments& arguments) {
  const Session session = run_session(session_options(arguments));
  write_recordings(arguments.required("out"), session);
  if (arguments.has("truth")) write_file(arguments.text("truth", ""), truth_json(session));
  if (arguments.has("clean")) write_clean(arguments.text("clean", ""), session);
}

/// Plays every valve into DIR/<serial>/ and returns the sealed truth of all, one JSON array.
std::string play_fleet(std::vector<FleetValve> fleet, const Arguments& arguments) {
  const std::filesystem::path folder = arguments.required("out");
  std::string truth = "[";
  for (FleetValve& valve : fleet) {
    if (arguments.has("tests")) valve.options.tests = split(arguments.text("tests", ""));
    const Session session = run_session(valve.options);
    write_recordings(folder / valve.options.serial, session);
    truth += (truth.size() > 1 ? ",\n" : "") + ("{\"kind\": \"" + valve.kind + "\", \"verdict\": \"" + valve.verdict) +
             "\", \"session\": " + truth_json(session) + "}";
  }
  return truth + "]\n";
}

std::string labels_csv(const std::vector<FleetValve>& fleet) {
  std::string text = "serial,verdict\n";
  for (const FleetValve& valve : fleet) text += valve.options.serial + "," + valve.verdict + "\n";
  return text;
}

int count_of(const Arguments& arguments, const std::string& otherwise) {
  const double valves = number(arguments.text("valves", otherwise));
  if (!(valves >= 1 && valves <= 100000)) throw std::invalid_argument("--valves must lie in 1 to 100000");
  return static_cast<int>(valves);
}

void list_effects() {
  for (const EffectInfo& info : effect_table())
    std::printf("%-22s %-6s %-12s size: %s\n", info.effect.c_str(), info.origin.c_str(), info.family.c_str(),
                info.size_meaning.c_str());
}

void run(int argc, char** argv) {
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "session") {
    play_session({argc,
                  argv,
                  {"out", "serial", "lot", "valve-type", "stand", "condition", "unit-seed", "noise-seed", "tests",
                   "effect", "noise-psi", "truth", "clean"}});
  } else if (verb == "population") {
    const Arguments arguments(argc, argv, {"out", "valves", "seed", "tests"});
    play_fleet(good_population(count_of(arguments, "8"), seed_of(arguments.text("seed", "1"))), arguments);
  } else if (verb == "lot") {
    const Arguments arguments(argc, argv, {"out", "lot", "valves", "seed", "tests", "truth"});
    const auto fleet =
        returned_lot(arguments.required("lot"), count_of(arguments, "15"), seed_of(arguments.text("seed", "1")));
    const std::string truth = play_fleet(fleet, arguments);
    if (arguments.has("truth")) write_file(arguments.text("truth", ""), truth);
  } else if (verb == "labelled") {
    const Arguments arguments(argc, argv, {"out", "valves", "seed", "tests"});
    const auto fleet = labelled_valves(count_of(arguments, "36"), seed_of(arguments.text("seed", "1")));
    play_fleet(fleet, arguments);
    write_file(std::filesystem::path(arguments.required("out")) / "labels.csv", labels_csv(fleet));
  } else if (verb == "effects") {
    list_effects();
  } else {
    throw std::invalid_argument("no verb '" + verb + "'");
  }
}

}  // namespace
}  // namespace valvetriage::stand

int main(int argc, char** argv) {
  try {
    valvetriage::stand::run(argc, argv);
    return 0;
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "valvetriage_stand: %s\n%s", error.what(), valvetriage::stand::kUsage);
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "valvetriage_stand: %s\n", error.what());
    return 1;
  }
}
