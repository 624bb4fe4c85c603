#include <fmt/format.h>

#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/store/backup.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

Result<std::vector<std::string>> check(const DataOptions& options) {
  const auto file = options.database_file();
  if (!file) return tl::unexpected(file.error());
  const auto store = open_sqlite_reader(*file);
  if (!store) return tl::unexpected(store.error());
  const auto blobs = BlobStore::open(options.data_dir);
  if (!blobs) return tl::unexpected(blobs.error());
  return check_everything(**store, **blobs);
}

}  // namespace

void add_check_command(CLI::App& app, int& exit_status) {
  CLI::App* verb =
      app.add_subcommand("check", "Check the database and every stored recording, also while a server runs");
  const auto options = std::make_shared<DataOptions>();
  add_data_options(*verb, *options);
  verb->callback([options, &exit_status] {
    const auto damages = check(*options);
    if (!damages) print_error(damages.error());
    if (damages && damages->empty()) fmt::print("everything is sound\n");
    if (damages) {
      for (const std::string& damage : *damages) fmt::print("{}\n", damage);
    }
    exit_status = damages && damages->empty() ? kDone : kFailure;
  });
}

}  // namespace valvetriage
