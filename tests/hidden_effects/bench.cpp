#include "tests/hidden_effects/bench.h"

#include <algorithm>

#include "tests/stand/random.h"
#include "tests/stand/valve.h"

namespace valvetriage::hidden_effects {

TwinBench::TwinBench(const stand::SessionOptions& options) : TwinBench(options, stand::draw_unit(options.unit_seed)) {}

TwinBench::TwinBench(const stand::SessionOptions& options, const stand::Unit& unit)
    : options_(options), unit_(unit), commands_(stand::commands_of_session(options)), begin_(1, 0) {
  for (const stand::Command& command : commands_) {
    environments_.emplace_back(options.noise_seed, command.name);
    begin_.push_back(begin_.back() + static_cast<Eigen::Index>(command.value_a.size()));
  }
}

std::vector<stand::Faults> TwinBench::faults(const std::vector<stand::EffectRequest>& effects) const {
  return stand::hide_effects(effects, unit_, commands_, stand::effect_seed(options_)).faults;
}

Eigen::VectorXd TwinBench::output(const stand::Unit& unit, const std::vector<stand::Faults>& faults) const {
  Eigen::VectorXd all(samples());
  for (std::size_t i = 0; i < commands_.size(); ++i) {
    const std::vector<double> one = stand::run_valve(unit, faults[i], commands_[i], environments_[i],
                                                     stand::sample_times_s(commands_[i]), options_.tolerance);
    std::copy(one.begin(), one.end(), all.data() + begin_[i]);
  }
  return all;
}

Eigen::VectorXd TwinBench::output_after(int past) const {
  TwinBench other(*this);
  for (std::size_t i = 0; i < commands_.size(); ++i)
    other.environments_[i].history_seed =
        stand::Random(environments_[i].history_seed, "other past " + std::to_string(past)).next();
  return other.output(unit_, std::vector<stand::Faults>(commands_.size()));
}

TwinBench nominal_bench(const std::vector<std::string>& tests) {
  stand::SessionOptions options;
  options.tests = tests;
  options.noise_seed = 20261121;
  return TwinBench(options, stand::Unit());
}

}  // namespace valvetriage::hidden_effects
