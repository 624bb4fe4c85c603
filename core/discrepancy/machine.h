#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/model/model.h"
#include "core/recording/recording.h"
#include "core/stage.h"

namespace valvetriage {

struct MachineOptions {
  std::size_t most_samples = 5000;  ///< that a search looks at; the winner is refitted on all
  double block_samples = 4e9;       ///< simulations times samples times blocks, over the whole search
  bool trace = false;               ///< the table of all explanations in `trace`
  StageReport report{};             ///< told each stage as it begins; nobody where empty
};

/// What baseline `self` finds out about any machine.
struct MachineDiagnosis {
  Discrepancy discrepancy;
  Model extended_model;                       ///< kind "machine" where a cause was added; else empty
  std::vector<std::vector<double>> extended;  ///< free runs on each recording's grid; empty where nothing was added
  std::vector<std::string> trace;
};

/// Names what a linear machine fitted on the very recordings gets wrong: any input-output machine, units or not.
///
/// The linear machine (order, delay, offset, initial state chosen by held-out free run) competes with laws on its
/// input and output, a law between two linear blocks, a hardening spring, a loop or Coulomb friction inside the motion
/// and a chain of tanks; every law with its own order. A name needs 1.3 times the linear machine's held-out accuracy
/// and 1.2 times that of the next family, won on most held-out blocks; pairs must remove 30 % of what a single leaves
/// above the noise floor. What no law explains and a black box does, or what the linear machine leaves of all samples
/// and answers the input in whatever way, is `unexplained`; where that lies beside what was searched, it is searched
/// once more.
///
/// recordings  of one machine and one sample time, prepared
/// Errors      no recordings, `sample_time_differs`, `constant_output`
/// Cost        bounded by twice `block_samples`; a pure function
Result<MachineDiagnosis> diagnose_machine(std::span<const Recording> recordings, const MachineOptions& options);

}  // namespace valvetriage
