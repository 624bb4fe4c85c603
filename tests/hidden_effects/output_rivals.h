#pragma once

#include <Eigen/Dense>
#include <functional>
#include <string>
#include <vector>

#include "tests/hidden_effects/bench.h"

namespace valvetriage::hidden_effects {

struct OutputFit {
  std::string cause;
  double left;  ///< squared error that it leaves
};

/// Causes that add a known shape to the output: offset, drift, a channel, a contact, tones. `left` is the stacked error
/// off the baseline, `whitened` brings a column of psi into the same form.
std::vector<OutputFit> output_rivals(const TwinBench& bench, const Eigen::VectorXd& healthy_psi,
                                     const Eigen::VectorXd& left,
                                     const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& whitened);

}  // namespace valvetriage::hidden_effects
