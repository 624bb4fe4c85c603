#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/identify/output_error.h"

namespace valvetriage {

/// One line of the table of what was tried.
struct TriedStructure {
  OutputErrorStructure structure;
  double delay_s = 0;       ///< dead time of the transfer function
  double rmse_heldout = 0;  ///< geometric mean over the held-out blocks of the free run's rms error, unit of the output
};

struct OrderOptions {
  OffsetSharing offsets = OffsetSharing::kPerRecording;
  std::optional<int> order{};  ///< fixed by the caller, or chosen
  std::optional<int> zeros{};
  std::optional<int> delay_samples{};
  int largest_order = 8;        ///< the paper estimates 5 to 9; noisy recordings support no more
  std::size_t max_rows = 4000;  ///< samples compared on; the free runs themselves see every sample of the input
};

struct OrderChoice {
  OutputErrorStructure structure;
  std::vector<std::complex<double>> poles;  ///< of the search's fit, a start for the refinement on all samples
  std::vector<TriedStructure> tried;
  std::string reason;
};

/// Dead time of the transfer function [samples]: the part of k that a delay-free plant with so many poles and zeros has
/// not.
int dead_time_samples(const OutputErrorStructure& structure);

/// Order, zeros and delay by held-out free-run error.
///
/// Held out in turn: each recording where there are several (its initial state and offset estimated on itself), else
/// five of six blocks of the one recording, never the first, whose initial state nothing else tells. A block is run
/// through freely from the first sample on. A structure's score is the geometric mean over blocks: one block alone
/// decides nothing.
///
/// The smallest structure is taken whose score is within one standard error over blocks, or within half a percent, of
/// the best (Breiman and others 1984): what the blocks cannot tell apart is decided by simplicity.
///
/// Errors  as fit_output_error
/// Cost    bounded: at most largest_order + a dozen structures, each a few dozen free runs
Result<OrderChoice> choose_order(std::span<const Recording* const> recordings, const OrderOptions& options);

}  // namespace valvetriage
