#pragma once

#include <filesystem>
#include <string>

#include "tests/second_stand/session.h"

namespace valvetriage::second_stand {

/// One CSV per recording as the contract has it.
void write_recordings(const std::filesystem::path& folder, const Session& session);

/// time_s,pressure_psi,command_A without noise, per recording: for the scorer only.
void write_clean(const std::filesystem::path& folder, const Session& session);

/// The sealed truth: seeds, effects with size and parameters, the healthy unit.
void write_truth(const std::filesystem::path& file, const Session& session);

/// A current to play, from the columns time_s and current_A. Throws std::invalid_argument that tells the line.
Command read_command(const std::filesystem::path& file);

}  // namespace valvetriage::second_stand
