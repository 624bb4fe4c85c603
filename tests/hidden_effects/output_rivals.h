#pragma once

#include <Eigen/Dense>
#include <functional>
#include <string>
#include <vector>

#include "tests/hidden_effects/bench.h"

namespace valvetriage::hidden_effects {

/// What these causes add to the output at unit size: a change of gain from a row of one recording on, how far the day's
/// channels have moved [°C, psi], and the time since a recording began [s].
Eigen::VectorXd gain_changed_from(const TwinBench& bench, const Eigen::VectorXd& healthy_psi, std::size_t recording,
                                  Eigen::Index row);
Eigen::VectorXd warmth(const TwinBench& bench);
Eigen::VectorXd supply(const TwinBench& bench);
Eigen::VectorXd time(const TwinBench& bench);

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
