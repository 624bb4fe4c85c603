#include <fmt/format.h>

#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

Result<void> migrate(const DataOptions& options) {
  const auto file = options.database_file();
  if (!file) return tl::unexpected(file.error());
  const auto store = open_sqlite_store(*file);
  if (!store) return tl::unexpected(store.error());
  fmt::print("{}: the schema is this version's\n", *file);
  return {};
}

}  // namespace

void add_migrate_command(CLI::App& app, int& exit_status) {
  CLI::App* verb =
      app.add_subcommand("migrate", "Bring the database to this version's schema; the server must be stopped");
  const auto options = std::make_shared<DataOptions>();
  add_data_options(*verb, *options);
  verb->callback([options, &exit_status] {
    const auto migrated = migrate(*options);
    if (!migrated) print_error(migrated.error());
    const bool is_usage = !migrated && migrated.error().code == "unsupported_database";
    exit_status = migrated ? kDone : is_usage ? kBadInput : kFailure;
  });
}

}  // namespace valvetriage
