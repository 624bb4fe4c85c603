#include "server/store/backup.h"

#include <fmt/format.h>

#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

struct BackupOptions {
  DataOptions data;
  std::string folder;
};

Result<BackupReport> back_up(const BackupOptions& options) {
  const auto file = options.data.database_file();
  if (!file) return tl::unexpected(file.error());
  const auto store = open_sqlite_reader(*file);
  if (!store) return tl::unexpected(store.error());
  const auto blobs = BlobStore::open(options.data.data_dir);
  if (!blobs) return tl::unexpected(blobs.error());
  return valvetriage::back_up(**store, **blobs, options.folder);
}

Result<BackupReport> restore(const BackupOptions& options) {
  const auto file = options.data.database_file();
  if (!file) return tl::unexpected(file.error());
  return valvetriage::restore(options.folder, *file, options.data.data_dir);
}

int report(const Result<BackupReport>& done, std::string_view what) {
  if (!done) {
    print_error(done.error());
    return kFailure;
  }
  fmt::print("{}: the database and {} recordings' bytes ({} MB), every hash checked\n", what, done->blobs,
             done->bytes >> 20);
  return kDone;
}

/// The two verbs differ in what they call.
template <typename Work>
void add_verb(CLI::App& app, int& exit_status, const char* name, const char* description, const char* folder_option,
              const Work& work) {
  CLI::App* verb = app.add_subcommand(name, description);
  const auto options = std::make_shared<BackupOptions>();
  add_data_options(*verb, options->data);
  verb->add_option(folder_option, options->folder, "Folder of the backup")->required();
  verb->callback([options, name, work, &exit_status] { exit_status = report(work(*options), name); });
}

}  // namespace

void add_backup_command(CLI::App& app, int& exit_status) {
  add_verb(app, exit_status, "backup", "Copy everything into a new folder, also while a server runs", "-o,--output",
           [](const BackupOptions& options) { return back_up(options); });
}

void add_restore_command(CLI::App& app, int& exit_status) {
  add_verb(app, exit_status, "restore", "Bring a backup back into an empty place", "folder",
           [](const BackupOptions& options) { return restore(options); });
}

}  // namespace valvetriage
