#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/model/reference.h"
#include "core/recording/recording.h"
#include "core/stage.h"

namespace valvetriage {

/// All recordings of one good valve.
struct ValveRecordings {
  std::string serial;
  std::vector<Recording> recordings;
};

/// Fewest good valves: below it there is no spread to speak of.
inline constexpr int kFewestReferenceValves = 3;

/// Learns what good valves of one type have in common, and how far they differ.
///
/// Every valve is fitted on its own (fit_valve); mean and covariance over valves make the
/// population. With few valves the covariance is shrunk towards its diagonal (1 / valves of the way at least) and
/// stands for a Student t with valves − 1 degrees of freedom. A valve that differs from the others (externally
/// studentized, at a significance of 0.001 over all valves and figures) is pointed out and left out, as long as three
/// remain. Level figures of a valve are taken against the mean of the *other* valves, so that they hold for a new one.
///
/// Errors  `too_few_valves`; `repeated_valve` where two of one serial share a recording; a valve that cannot be
///         fitted, by its serial
/// Cost    about a second per valve of 24,000 samples
/// report  told each stage as it begins; nobody where empty
Result<Reference> learn_reference(std::span<const ValveRecordings> valves, const std::string& valve_type,
                                  const StageReport& report = {});

}  // namespace valvetriage
