#pragma once

#include <Eigen/Dense>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/hidden_effects/absorption.h"
#include "tests/hidden_effects/bench.h"
#include "tests/hidden_effects/rivals.h"

namespace valvetriage::hidden_effects {

/// The two distances of a case, in standard deviations.
struct Distances {
  double d = 0;       ///< what the baseline cannot absorb of what is hidden
  double d_name = 0;  ///< what is left when the best rival has absorbed its part as well
  std::string rival;  ///< that rival
  double oracle_set =
      1;  ///< causes that an observer who knows every law could not exclude at 20 to 1, the true one among them
};

/// When to stop early: the caller only wants to know that a case is outside its class.
struct Wanted {
  double smallest_d = 0, smallest_d_name = 0;
  double largest_d_name = 1e9;
};

/// A past day's signatures of all rivals over their screening grids, on the nominal unit.
struct ScreeningGrid {
  struct Entry {
    std::size_t rival;
    std::vector<double> values;
  };
  std::vector<Entry> entries;
  Eigen::MatrixXf signature;  ///< one column per entry [psi]
};
ScreeningGrid screening_grid(const std::vector<std::string>& tests);

/// Distances by twin runs on the stand, nothing of the product.
///
///   d² = min over θ of |y − f(θ)|² / σ² + |θ|²
///
/// y is the noise-free output with what is hidden, f(θ) that of the same valve on the same day without it, θ the
/// valve's parameters in population standard deviations from its own, the weights of three other pasts of each
/// recording, and what the first hold of each recording shows before anything moves (free within 10 psi: where a spool
/// with friction or play stopped before the record began is nobody's knowledge); σ the white noise. For small effects
/// that is sᵀ (σ² I + J Jᵀ)⁻¹ s: the signature whitened with noise and spread. For a rival, f gets its law with every
/// number free, d_name is the least over all rivals. Of a pair, each member is named against the other one present with
/// its size free; d_name is the smaller of the two.
/// Minimised by Gauss-Newton with sensitivities of the nominal unit; errors of a local minimum make d_name too large.
///
/// Cost    30 twin sessions once, 80 more for the screening grid, then 5 to 50 for a case (0.25 s each for a full
/// session)
class DistanceMeter {
 public:
  explicit DistanceMeter(const std::vector<std::string>& tests);
  Distances measure(const stand::SessionOptions& options, const Wanted& wanted);

 private:
  std::vector<std::string> tests_;
  std::shared_ptr<const Absorption> baseline_;
  std::shared_ptr<const ScreeningGrid> grid_;  ///< made when first needed
};

}  // namespace valvetriage::hidden_effects
