#pragma once

#include <string>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage::http {

/// Files that are sent together: one valve.
struct PlannedSubmission {
  std::string title;  ///< folder, or "lot serial", or the file
  std::vector<std::string> files;
};

/// Which files of a command line belong together: every folder (and every folder below it) that holds recordings is one
/// submission; other files are grouped by lot and serial, read from their heads; a file without a serial stands alone.
///
/// labels   what the command line says for all; it holds where a file says nothing
/// mapping  how MAT files are to be read
/// Errors  `cannot_read` naming the file; `no_recordings` where a folder holds none; metadata that cannot be read
Result<std::vector<PlannedSubmission>> plan_submissions(const std::vector<std::string>& arguments,
                                                        const Metadata& labels, const ColumnMapping& mapping = {});

/// Equal for equal content: what makes a repeated upload safe. `route` carries labels and options.
/// Errors  `cannot_read`
Result<std::string> content_key(const std::string& route, const std::vector<std::string>& files);

}  // namespace valvetriage::http
