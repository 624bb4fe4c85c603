#include "server/commands/print_pdf.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <vector>

#include "server/commands/documents.h"

extern char** environ;

namespace valvetriage {
namespace {

/// A folder that goes with the object.
class Folder {
 public:
  Folder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "valvetriage-report-XXXXXX").string();
    if (mkdtemp(pattern.data())) path_ = pattern;
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// Exit status of a program, its output thrown away; nothing where there is no such program.
std::optional<int> run_quietly(std::vector<std::string> arguments) {
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t child = 0;
  const int error = posix_spawnp(&child, pointers[0], &actions, nullptr, pointers.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return std::nullopt;
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

}  // namespace

Result<void> print_pdf(const std::string& html, const std::string& pdf_file) {
  const Folder folder;
  if (folder.path().empty()) return fail("cannot_write", "no temporary folder can be made");
  const std::string page = folder.path() + "/report.html";
  if (auto written = write_output(page, html); !written) return written;
  std::vector<std::string> arguments{"",
                                     "--headless=new",
                                     "--disable-gpu",
                                     "--no-first-run",
                                     "--no-pdf-header-footer",
                                     "--user-data-dir=" + folder.path() + "/profile",
                                     "--print-to-pdf=" + std::filesystem::absolute(pdf_file).string(),
                                     "file://" + page};
  if (geteuid() == 0) arguments.insert(arguments.begin() + 1, "--no-sandbox");  // its sandbox refuses root
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"}) {
    arguments[0] = name;
    const auto status = run_quietly(arguments);
    if (!status) continue;
    if (*status == 0 && std::filesystem::exists(pdf_file)) return {};
    return fail("cannot_write", fmt::format("{} could not print {}", name, pdf_file));
  }
  return fail("no_chromium", "--pdf needs Chromium; without it write HTML and print that");
}

}  // namespace valvetriage
