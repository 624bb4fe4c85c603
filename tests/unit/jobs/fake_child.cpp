// An analysis that does what the options say: {"do":"succeed"}, "reject", "fault", "segv", "hang", "spin", "eat",
// "babble", "silent", "exit", "write". Stands in for the real one in the tests of the workers.
#include <sys/prctl.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

#include "server/jobs/child_protocol.h"
#include "server/wire/json.h"
#include "tests/contract/store_samples.h"

namespace {

using namespace valvetriage;

void eat_memory() {
  std::vector<std::vector<char>> eaten;
  for (;;) eaten.emplace_back(1 << 20, 'x');
}

/// True where the child has what the parent promises: no way to gain privileges, nothing open but the three pipes.
bool is_confined() {
  const bool may_gain = ::prctl(PR_GET_NO_NEW_PRIVS, 0, 0, 0, 0) != 1;
  int open_files = 0;
  for (int fd = 3; fd < 256; ++fd) open_files += ::dup2(fd, fd) == fd;
  return !may_gain && open_files == 0;
}

Result<NewAnalysis> act(const JobSpec& spec, const StageReport& progress) {
  const std::string act = Json::parse(spec.options_json).value("do", "succeed");
  if (act == "reject") return tl::unexpected(Error{.code = "not_a_number", .message = "line 3: 'x'", .line = 3});
  if (act == "fault") return fail(std::string(kPassingFault), "the disk was busy");
  if (act == "segv") std::raise(SIGSEGV);
  if (act == "hang") ::pause();
  if (act == "begin and hang") {
    progress(0.25, "fitting");
    ::pause();
  }
  if (act == "spin") {
    for (volatile int turns = 0;;) (void)turns;
  }
  if (act == "eat") eat_memory();
  if (act == "babble") {
    for (;;) std::puts("{\"progress\":0.1,\"note\":\"again\"}");
  }
  if (act == "silent") std::_Exit(0);
  if (act == "exit") {
    std::fputs("last words", stderr);
    std::_Exit(3);
  }
  if (act == "confined" && !is_confined()) return fail("not_confined", "the child may do more than it should");
  progress(0.5, "half way");
  NewAnalysis analysis = test::an_analysis("Good");
  analysis.body_json = Json{{"files", spec.files.size()}, {"reference", spec.reference_json.value_or("none")}}.dump();
  return analysis;
}

}  // namespace

int main() {
  return valvetriage::run_child(act);
}
