#include "server/commands/data_options.h"

#include <fmt/format.h>

namespace valvetriage {

Result<std::string> DataOptions::database_file() const {
  if (database.find("://") != std::string::npos) {
    return fail("unsupported_database",
                fmt::format("'{}' is a URL: this version keeps its database in a file, --database FILE", database));
  }
  return database.empty() ? data_dir + "/valvetriage.sqlite" : database;
}

void add_data_options(CLI::App& verb, DataOptions& options) {
  verb.add_option("--data-dir", options.data_dir, "Folder of the stored recordings")->capture_default_str();
  verb.add_option("--database", options.database, "Database file (default: valvetriage.sqlite in the data folder)");
}

}  // namespace valvetriage
