#include "tests/hidden_effects/signatures.h"

#include <algorithm>
#include <cmath>

#include "tests/hidden_effects/absorption.h"
#include "tests/hidden_effects/output_rivals.h"
#include "tests/hidden_effects/rivals.h"

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr int kSizes = 24;
constexpr int kSeconds = 5;      // values of a second number
constexpr Index kInstants = 20;  // rows between the instants of a contact
constexpr std::size_t kOutputCauses = 6;

std::vector<double> grid_of(const Axis& axis, int count) {
  std::vector<double> grid;
  for (int i = 0; i < count; ++i) {
    const double share = (i + 0.5) / count;
    grid.push_back(axis.logarithmic ? axis.low * std::pow(axis.high / axis.low, share)
                                    : axis.low + (axis.high - axis.low) * share);
  }
  return grid;
}

/// Those of a rival over its numbers.
std::vector<VectorXd> of_rival(const TwinBench& bench, const VectorXd& healthy_psi, const Rival& rival) {
  std::vector<VectorXd> found;
  const bool has_second = rival.axes.size() > 1;
  const std::vector<double> seconds = has_second ? grid_of(rival.axes[1], kSeconds) : std::vector<double>{0};
  for (const double first : grid_of(rival.axes[0], kSizes))
    for (const double second : seconds) {
      const std::vector<double> values = has_second ? std::vector<double>{first, second} : std::vector<double>{first};
      std::vector<stand::Faults> faults = healthy(bench);
      for (stand::Faults& one : faults) rival.apply(values, bench.unit(), one);
      found.push_back(bench.output(bench.unit(), faults) - healthy_psi);
    }
  return found;
}

/// A change of gain from an instant of one recording on.
std::vector<VectorXd> of_contacts(const TwinBench& bench, const VectorXd& healthy_psi) {
  std::vector<VectorXd> found;
  for (std::size_t i = 0; i < bench.recordings(); ++i)
    for (Index row = 0; row < bench.size(i) - kInstants; row += kInstants)
      found.push_back(gain_changed_from(bench, healthy_psi, i, row));
  return found;
}

double longest_s(const TwinBench& bench) {
  double longest = 0;
  for (std::size_t i = 0; i < bench.recordings(); ++i)
    longest = std::max(longest, static_cast<double>(bench.size(i)) * bench.commands()[i].period_s);
  return longest;
}

}  // namespace

std::size_t searched_causes() {
  return simulated_rivals().size() + kOutputCauses;
}

std::vector<Signatures> signatures(const TwinBench& bench) {
  const VectorXd healthy_psi = bench.output(bench.unit(), healthy(bench));
  std::vector<Signatures> found;
  for (const Rival& rival : simulated_rivals())
    found.push_back({rival.cause, of_rival(bench, healthy_psi, rival), false});
  found.push_back({"sensor_offset", {VectorXd::Ones(bench.samples())}, true});
  found.push_back({"sensor_drift", {time(bench)}, true});
  found.push_back({"side_input", {warmth(bench), supply(bench)}, true});
  found.push_back({"intermittent", of_contacts(bench, healthy_psi), true});
  return found;
}

std::vector<Tones> searched_tones(const TwinBench& bench) {
  const double resolved_s = longest_s(bench);
  return {{"periodic_disturbance", 0.5, 45, resolved_s * (45 - 0.5)},
          {"self_oscillation", 2, 20, 4 * resolved_s * (20 - 2)}};
}

}  // namespace valvetriage::hidden_effects
