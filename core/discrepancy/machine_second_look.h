#pragma once

#include <optional>

#include "core/discrepancy/machine_fit.h"

namespace valvetriage {

/// Recordings that are longer than what is searched are looked at again where a machine leaves more than noise beside
/// what was searched, and more than twice the mean square that it leaves there: half of the searched samples of each
/// recording stay, the other half move to where it leaves most. Empty where it does not.
///
/// first      what was searched, records with windows
/// whole      the same recordings from end to end (whole_records)
/// linear     the machine, fitted to `whole`
/// noise_rms  scaled units
/// Cost       O(n · windows)
std::optional<MachineData> second_look(std::span<const Recording> recordings, const MachineData& first,
                                       const MachineData& whole, const MachineFit& linear, double noise_rms);

}  // namespace valvetriage
