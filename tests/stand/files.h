#pragma once

#include <filesystem>
#include <string>

#include "tests/stand/session.h"

namespace valvetriage::stand {

/// One recording as a CSV of the contract: metadata lines, header, rows.
std::string recording_csv(const SessionOptions& options, const StandRecording& recording);
/// time_s,pressure_psi without noise.
std::string clean_csv(const StandRecording& recording);
/// The sealed truth of a session: seeds, effects with their size and parameters, the healthy unit.
std::string truth_json(const Session& session);
/// Writes a file, making its folder. Throws std::runtime_error where it cannot.
void write_file(const std::filesystem::path& path, const std::string& text);
/// Writes every recording of a session into `folder`.
void write_recordings(const std::filesystem::path& folder, const Session& session);
/// Writes the noise-free outputs of a session into `folder`.
void write_clean(const std::filesystem::path& folder, const Session& session);

}  // namespace valvetriage::stand
