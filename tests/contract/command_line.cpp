#include "tests/contract/command_line.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "tests/contract/temporary_folder.h"

namespace valvetriage::test {
namespace {

std::string text_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void open_as(int descriptor, const char* file, int flags) {
  ::dup2(::open(file, flags, 0600), descriptor);
}

}  // namespace

Outcome run_program(const std::string& program, const std::vector<std::string>& arguments) {
  const TemporaryFolder folder;
  const std::string out = folder.file("out"), err = folder.file("err");
  std::vector<char*> argv{const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    open_as(0, "/dev/null", O_RDONLY);
    open_as(1, out.c_str(), O_WRONLY | O_CREAT);
    open_as(2, err.c_str(), O_WRONLY | O_CREAT);
    ::execv(program.c_str(), argv.data());
    ::_exit(127);
  }
  int ended = 0;
  ::waitpid(child, &ended, 0);
  return {.status = WIFEXITED(ended) ? WEXITSTATUS(ended) : -1, .out = text_of(out), .err = text_of(err)};
}

}  // namespace valvetriage::test
