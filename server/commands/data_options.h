#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "core/result.h"

namespace valvetriage {

/// Where a server keeps what it remembers: the options of serve, migrate, check, backup and restore.
struct DataOptions {
  std::string data_dir = "valvetriage-data";
  std::string database;  ///< empty: valvetriage.sqlite in the data folder

  /// Errors  `unsupported_database` for a URL
  Result<std::string> database_file() const;
};

/// Adds --data-dir and --database. `options` has to live as long as the application.
void add_data_options(CLI::App& verb, DataOptions& options);

}  // namespace valvetriage
