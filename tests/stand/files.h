#pragma once

#include <filesystem>
#include <string>

#include "tests/stand/session.h"

namespace valvetriage::stand {

/// What the columns of a recording are called: the valve's, or those of a unitless machine.
enum class Columns { kValve, kUnitless };

/// One recording as a CSV of the contract: metadata lines, header, rows.
std::string recording_csv(const SessionOptions& options, const StandRecording& recording,
                          Columns columns = Columns::kValve);
/// time_s,pressure_psi,command_A without noise.
std::string clean_csv(const StandRecording& recording);
/// time_s,command_A,healthy_psi,effect_psi without noise.
std::string signature_csv(const StandRecording& healthy, const StandRecording& spoiled);
/// The sealed truth of a session: seeds, effects with their size and parameters, the healthy unit.
std::string truth_json(const Session& session);
/// Writes a file, making its folder. Throws std::runtime_error where it cannot.
void write_file(const std::filesystem::path& path, const std::string& text);
/// Writes every recording of a session into `folder`.
void write_recordings(const std::filesystem::path& folder, const Session& session, Columns columns = Columns::kValve);
/// Writes the noise-free outputs of a session into `folder`.
void write_clean(const std::filesystem::path& folder, const Session& session);
/// Reads a current to play from columns time_s and current_A of a CSV. Throws std::invalid_argument with the position.
Command read_command(const std::filesystem::path& path);

}  // namespace valvetriage::stand
