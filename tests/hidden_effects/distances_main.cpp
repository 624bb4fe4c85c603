#include <cstdio>
#include <exception>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tests/hidden_effects/distances.h"
#include "tests/hidden_effects/learning_oracle.h"
#include "tests/hidden_effects/oracle.h"

namespace valvetriage::hidden_effects {
namespace {

stand::SessionOptions case_of(std::istringstream& words) {
  stand::SessionOptions options;
  std::string tests, effects;
  if (!(words >> tests >> options.unit_seed >> options.noise_seed >> effects))
    throw std::invalid_argument("a line is: KIND TESTS UNIT_SEED NOISE_SEED NAME=SIZE[,NAME=SIZE]");
  options.tests = tests == "full" ? stand::full_session() : std::vector<std::string>{tests};
  std::istringstream list(effects);
  for (std::string one; std::getline(list, one, ',');) {
    const std::size_t equals = one.find('=');
    if (equals == std::string::npos) throw std::invalid_argument("'" + one + "' is not NAME=SIZE");
    options.effects.push_back({one.substr(0, equals), std::stod(one.substr(equals + 1))});
  }
  if (options.effects.size() > 2) throw std::invalid_argument("distances are of one effect or of two");
  return options;
}

Wanted wanted_for(const std::string& kind) {
  if (kind == "single" || kind == "pair") return {8, 8, 1e9};
  if (kind == "close") return {6, 0, 4};
  if (kind == "step_up" || kind == "outside") return {6, 0, 1e9};
  if (kind == "detect") return {std::numeric_limits<double>::infinity(), 0, 0};
  return {};
}

void answer(const std::string& line, std::map<std::string, std::unique_ptr<DistanceMeter>>& meters) {
  std::istringstream words(line);
  std::string kind;
  words >> kind;
  const stand::SessionOptions options = case_of(words);
  auto& meter = meters[options.tests.front()];
  if (!meter) meter = std::make_unique<DistanceMeter>(options.tests);
  const Distances found = meter->measure(options, wanted_for(kind));
  std::printf("%.6g %.6g %g %s\n", found.d, found.d_name, found.oracle_set, found.rival.c_str());
  std::fflush(stdout);
}

void print_oracle(const std::vector<SearchOf>& searched) {
  std::printf("cause,threshold_1_percent,d90_1_percent,threshold_0.1_percent,d90_0.1_percent\n");
  for (const SearchOf& one : searched)
    std::printf("%s,%.3f,%.3f,%.3f,%.3f\n", one.cause.c_str(), one.threshold[0], one.d90[0], one.threshold[1],
                one.d90[1]);
}

}  // namespace
}  // namespace valvetriage::hidden_effects

/// Reads a case per line from standard input and answers `d d_name oracle_set rival`. KIND is the class that the case
/// is to belong to (a case that does not is left early), `detect` for d alone, or `any`.
/// With the argument `oracle`: what seeing each cause costs an observer who knows every law and the population, as CSV;
/// with `oracle N` one who learns the population from N good valves.
int main(int argc, char** argv) {
  try {
    if (argc > 1 && std::string(argv[1]) == "oracle") {
      const std::vector<std::string> tests = valvetriage::stand::full_session();
      valvetriage::hidden_effects::print_oracle(
          argc > 2 ? valvetriage::hidden_effects::learning_oracle(tests, std::stoi(argv[2]))
                   : valvetriage::hidden_effects::oracle(tests));
      return 0;
    }
    std::map<std::string, std::unique_ptr<valvetriage::hidden_effects::DistanceMeter>> meters;
    for (std::string line; std::getline(std::cin, line);) valvetriage::hidden_effects::answer(line, meters);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "valvetriage_distances: %s\n", error.what());
    return 1;
  }
}
