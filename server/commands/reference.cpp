#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>

#include "core/analysis/learn_reference.h"
#include "core/recording/text.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/commands/progress_line.h"
#include "server/commands/recording_options.h"
#include "server/wire/reference_json.h"

namespace valvetriage {
namespace {

namespace fs = std::filesystem;

// In the root mean square, by which simulations may leave more than noise: three quarters of what they leave is no
// noise beyond that.
constexpr double kFollowed = 2;

struct LearnArguments {
  std::vector<std::string> paths;
  std::string output;
  RecordingOptions recording;
};

/// Files of one valve, and what to call it where no file says its serial.
struct ValveFiles {
  std::string name;
  std::vector<std::string> files;
};

/// Entries in the order of their names, hidden ones left out; none where the folder cannot be read.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code unreadable;
  fs::directory_iterator at(folder, unreadable);
  for (; !unreadable && at != fs::directory_iterator(); at.increment(unreadable)) {
    if (!at->path().filename().string().starts_with('.')) entries.push_back(at->path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

bool is_recording_name(const fs::path& file) {
  static constexpr std::string_view kEndings[] = {".csv", ".json", ".mat", ".gz", ".zst"};
  const std::string name = to_lower_ascii(file.filename().string());
  return std::any_of(std::begin(kEndings), std::end(kEndings), [&](auto ending) { return name.ends_with(ending); });
}

/// A linked folder is not walked into: it may lie above.
bool is_folder_inside(const fs::path& entry) {
  std::error_code unreadable;
  return fs::is_directory(entry, unreadable) && !fs::is_symlink(entry, unreadable);
}

/// A folder of recordings is one valve, a folder of folders several; what lies beside the folders is one as well.
void add_folder(const fs::path& folder, std::vector<ValveFiles>& valves) {
  ValveFiles valve{.name = folder.filename().string(), .files = {}};
  std::vector<fs::path> folders;
  for (const fs::path& entry : entries_of(folder)) {
    if (is_folder_inside(entry)) {
      folders.push_back(entry);
    } else if (is_recording_name(entry)) {
      valve.files.push_back(entry.string());
    }
  }
  if (!valve.files.empty()) valves.push_back(std::move(valve));
  for (const fs::path& inner : folders) add_folder(inner, valves);
}

/// The recordings of one folder, called as they call it or as the folder is called.
Result<ValveRecordings> one_valve(const std::string& folder, std::vector<ReadRecording> recordings) {
  ValveRecordings valve{.serial = folder, .recordings = {}};
  valve.recordings.reserve(recordings.size());
  const Recording* named = nullptr;
  for (ReadRecording& read : recordings) {
    const auto serial = read.recording.metadata.serial;
    if (serial && named && *serial != valve.serial) {
      return fail("several_valves",
                  fmt::format("{} is of valve {}, {} of valve {}: a folder of recordings is one valve", named->name,
                              valve.serial, read.recording.name, *serial));
    }
    valve.recordings.push_back(std::move(read.recording));
    if (!serial) continue;
    valve.serial = *serial;
    named = &valve.recordings.back();
  }
  return valve;
}

/// Plain files: one valve for each serial that they name.
Result<std::vector<ValveRecordings>> read_by_serial(const std::vector<std::string>& files, const ReadOptions& options) {
  std::map<std::string, ValveRecordings> by_serial;
  for (const std::string& file : files) {
    auto read = read_recording_file(file, options);
    if (!read) return tl::unexpected(read.error());
    const auto& serial = read->recording.metadata.serial;
    if (!serial) {
      Error error{.code = "no_serial",
                  .message =
                      "no '# serial:' line; plain files are grouped by serial, put the files of "
                      "one valve into one folder otherwise"};
      error.file = file;
      return tl::unexpected(error);
    }
    ValveRecordings& valve = by_serial[*serial];
    valve.serial = *serial;
    valve.recordings.push_back(std::move(read->recording));
  }
  std::vector<ValveRecordings> valves;
  for (auto& [serial, valve] : by_serial) valves.push_back(std::move(valve));
  return valves;
}

Result<std::vector<ValveRecordings>> read_valves(const std::vector<std::string>& paths, const ReadOptions& options) {
  std::vector<std::string> plain_files;
  std::vector<ValveFiles> folders;
  for (const std::string& path : paths) {
    std::error_code unreadable;  // a file then, whose reading says why
    if (fs::is_directory(path, unreadable)) {
      add_folder(path, folders);
    } else {
      plain_files.push_back(path);
    }
  }
  auto valves = read_by_serial(plain_files, options);
  if (!valves) return valves;
  for (const ValveFiles& folder : folders) {
    auto read = read_recordings(folder.files, options);
    if (!read) return tl::unexpected(read.error());
    auto valve = one_valve(folder.name, std::move(*read));
    if (!valve) return tl::unexpected(valve.error());
    valves->push_back(std::move(*valve));
  }
  return valves;
}

/// Of the valves that were used, in the root mean square [psi].
double rmse_of_members(const Reference& reference) {
  double squares = 0;
  for (const ReferenceMember& member : reference.members) squares += member.used ? member.rmse * member.rmse : 0;
  return std::sqrt(squares / std::max(reference.valves, 1));
}

void tell_left_out(const Reference& reference, const char* when) {
  for (const ReferenceMember& member : reference.members) {
    if (member.used) continue;
    fmt::print(stderr, "valve {}{} is unlike the others ({:.1f} standard deviations) and was left out\n", member.serial,
               when, member.distance);
  }
}

void tell(const Reference& reference, const std::string& file) {
  fmt::print(stderr, "{}: {} good valves of {}, noise {:.3g} psi, {} levels\n", file, reference.valves,
             reference.valve_type, reference.noise_floor, reference.levels.size());
  double left = rmse_of_members(reference);
  for (const OnKnownTests& known : reference.on_known_tests) {
    const double beyond = rmse_of_members(known.reference);
    fmt::print(stderr,
               "their simulations leave {:.3g} psi, and in common so much that it is taken off of a valve in the same "
               "tests: {:.3g} psi are left then\n",
               left, beyond);
    left = beyond;
    tell_left_out(known.reference, ", once that is taken off,");
  }
  if (reference.noise_floor > 0 && left > kFollowed * reference.noise_floor) {
    fmt::print(
        stderr,
        "{:.3g} psi are {:.2g} times their noise: no simulation here follows these valves, and a fault that does "
        "less stays unseen\n",
        left, left / reference.noise_floor);
  }
  tell_left_out(reference, "");
}

ExitStatus run_learn(const LearnArguments& arguments) {
  const auto options = read_options(arguments.recording);
  if (!options) return ended_by(options.error());
  const auto valves = read_valves(arguments.paths, *options);
  if (!valves) return ended_by(valves.error());
  const auto reference = [&] {
    const ProgressLine progress;
    return learn_reference(*valves, *arguments.recording.valve_type, progress.stages());
  }();
  if (!reference) return ended_by(reference.error());
  const auto written = write_output(arguments.output, dump_json(to_json(*reference), true) + "\n");
  if (!written) return ended_by(written.error());
  tell(*reference, arguments.output);
  return kDone;
}

}  // namespace

void add_reference_command(CLI::App& app, int& exit_status) {
  CLI::App* group = app.add_subcommand("reference", "References: learn what good valves of one type have in common");
  group->require_subcommand(1);
  CLI::App* verb = group->add_subcommand("learn", "A reference from the recordings of at least 3 good valves");
  auto arguments = std::make_shared<LearnArguments>();
  verb->add_option("DIR|FILE", arguments->paths,
                   "A folder of recordings is one valve, a folder of folders several; plain files group by serial")
      ->required()
      ->check(CLI::ExistingPath);
  verb->add_option("--valve-type", arguments->recording.valve_type, "Type of the valves")->required();
  verb->add_option("-o,--output", arguments->output, "Where the reference goes")->required();
  add_column_options(*verb, arguments->recording);
  verb->callback([arguments, &exit_status] {
    keep_freed_memory();
    exit_status = run_learn(*arguments);
  });
}

}  // namespace valvetriage
