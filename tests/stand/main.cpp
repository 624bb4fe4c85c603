#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/stand/files.h"
#include "tests/stand/fleets.h"
#include "tests/stand/motion.h"
#include "tests/stand/random.h"
#include "tests/stand/session.h"

namespace valvetriage::stand {
namespace {

constexpr const char* kUsage =
    "usage: valvetriage_stand session    --out DIR --serial S --lot L [SESSION] [--truth FILE] [--clean DIR]\n"
    "       valvetriage_stand signature  --out DIR [SESSION]        noise-free, with and without the effects\n"
    "       valvetriage_stand motion     --out DIR [SESSION] [--truth FILE] [--clean DIR]   a unitless bipolar plant\n"
    "       valvetriage_stand population --out DIR [--valves 8] [--seed N] [--tests T,T...]\n"
    "       valvetriage_stand lot        --out DIR --lot L [--valves 15] [--seed N] [--tests T,T...] [--truth FILE]\n"
    "       valvetriage_stand labelled   --out DIR [--valves 36] [--seed N] [--tests T,T...]\n"
    "       valvetriage_stand effects                               what can be hidden, and what its size means\n"
    "SESSION: [--serial S] [--lot L] [--valve-type T] [--stand NAME] [--condition C] [--unit-seed N] [--noise-seed N]\n"
    "         [--tests T,T...|full|none] [--input CSV]... [--effect NAME=SIZE]... [--decoy NAME[=SIZE]]...\n"
    "         [--noise-psi X]\n";

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

std::pair<std::string, double> decoy_of(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) return {text, 0};
  return {text.substr(0, equals), number(text.substr(equals + 1))};
}

std::vector<std::string> tests_of(const std::string& text) {
  if (text == "full") return full_session();
  if (text == "none") return {};
  return split(text);
}

SessionOptions session_options(const Arguments& arguments) {
  SessionOptions options;
  options.serial = arguments.text("serial", options.serial);
  options.lot = arguments.text("lot", options.lot);
  options.valve_type = arguments.text("valve-type", options.valve_type);
  options.stand = arguments.text("stand", options.stand);
  options.condition = arguments.text("condition", options.condition);
  options.unit_seed =
      arguments.has("unit-seed") ? seed_of(arguments.text("unit-seed", "")) : Random::hash(options.serial);
  options.noise_seed = seed_of(arguments.text("noise-seed", "1"));
  if (arguments.has("tests")) options.tests = tests_of(arguments.text("tests", ""));
  if (arguments.has("noise-psi")) options.noise_psi = number(arguments.text("noise-psi", ""));
  for (const std::string& path : arguments.all("input")) options.inputs.push_back(read_command(path));
  for (const std::string& effect : arguments.all("effect")) options.effects.push_back(effect_of(effect));
  for (const std::string& decoy : arguments.all("decoy")) options.decoys.push_back(decoy_of(decoy));
  if (options.tests.empty() && options.inputs.empty()) throw std::invalid_argument("nothing to play");
  return options;
}

void write_session(const Arguments& arguments, const Session& session, Columns columns) {
  write_recordings(arguments.required("out"), session, columns);
  if (arguments.has("truth")) write_file(arguments.text("truth", ""), truth_json(session));
  if (arguments.has("clean")) write_clean(arguments.text("clean", ""), session);
}

void play_session(const Arguments& arguments) {
  for (const char* key : {"serial", "lot"}) arguments.required(key);
  write_session(arguments, run_session(session_options(arguments)), Columns::kValve);
}

void play_motion(const Arguments& arguments) {
  SessionOptions options = session_options(arguments);
  if (!arguments.has("noise-psi")) options.noise_psi = 0.01;
  write_session(arguments, run_motion(options), Columns::kUnitless);
}

void play_signature(const Arguments& arguments) {
  const Signature signature = signature_of(session_options(arguments));
  const std::filesystem::path folder = arguments.required("out");
  for (std::size_t i = 0; i < signature.healthy.recordings.size(); ++i) {
    const StandRecording& healthy = signature.healthy.recordings[i];
    write_file(folder / (healthy.name + ".csv"), signature_csv(healthy, signature.spoiled.recordings[i]));
  }
}

/// Plays every valve into DIR/<serial>/ and returns the sealed truth of all, one JSON array.
std::string play_fleet(std::vector<FleetValve> fleet, const Arguments& arguments) {
  const std::filesystem::path folder = arguments.required("out");
  std::string truth = "[";
  for (FleetValve& valve : fleet) {
    if (arguments.has("tests")) valve.options.tests = tests_of(arguments.text("tests", ""));
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
  std::printf("effects: name, origin, family, range of sizes, meaning of the size\n");
  for (const EffectInfo& info : effect_table())
    std::printf("  %-20s %-6s %-11s %7g to %-7g %s\n", info.effect.c_str(), info.origin.c_str(), info.family.c_str(),
                info.smallest, info.largest, info.size_meaning.c_str());
  std::printf("decoys: name, usual size, meaning of the size\n");
  for (const DecoyInfo& info : decoy_table())
    std::printf("  %-20s %7g %s\n", info.decoy.c_str(), info.usual_size, info.size_meaning.c_str());
  std::printf("tests:");
  for (const std::string& name : repertoire()) std::printf(" %s", name.c_str());
  std::printf("\n");
}

Arguments session_arguments(int argc, char** argv) {
  return {argc,
          argv,
          {"out", "serial", "lot", "valve-type", "stand", "condition", "unit-seed", "noise-seed", "tests", "input",
           "effect", "decoy", "noise-psi", "truth", "clean"}};
}

void run(int argc, char** argv) {
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "session") {
    play_session(session_arguments(argc, argv));
  } else if (verb == "signature") {
    play_signature(session_arguments(argc, argv));
  } else if (verb == "motion") {
    play_motion(session_arguments(argc, argv));
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
