#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <random>
#include <thread>

#include "server/store/sqlite/sqlite_store.h"
#include "server/wire/sha256.h"
#include "tests/contract/http_fixture.h"
#include "tests/contract/temporary_folder.h"

extern char** environ;

namespace valvetriage {
namespace {

constexpr int kKills = 200;
constexpr int kClients = 4;
constexpr int kLongestLife_ms = 250;  // starting takes about 30 ms: kills fall into starting, accepting and analysing

/// This executable as a server in a process of its own.
class ServerProcess {
 public:
  explicit ServerProcess(const std::string& folder) {
    int out[2];
    if (pipe2(out, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, (folder + "/server.log").c_str(),
                                     O_WRONLY | O_CREAT | O_APPEND, 0600);
    std::string self = "/proc/self/exe", verb = "serve", data = folder;
    char* arguments[] = {self.data(), verb.data(), data.data(), nullptr};
    if (posix_spawn(&process_, "/proc/self/exe", &actions, nullptr, arguments, environ) != 0) process_ = -1;
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    std::array<char, 16> line{};
    if (read(out[0], line.data(), line.size() - 1) > 0) port_ = std::atoi(line.data());
    close(out[0]);
  }
  ~ServerProcess() { end(SIGKILL); }
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  int port() const { return port_; }
  int end(int signal) {
    if (process_ <= 0) return -1;
    int status = 0;
    kill(process_, signal);
    waitpid(process_, &status, 0);
    process_ = -1;
    return status;
  }

 private:
  pid_t process_ = -1;
  int port_ = 0;
};

/// What the clients were promised: id and hash of every recording that was answered with 202.
struct Promises {
  std::mutex mutex;
  std::map<std::string, std::string> sha256_by_id;
};

void upload_until(const std::atomic<bool>& over, int port, int client, std::atomic<int>& serial, Promises& promises) {
  while (!over) {
    const std::string csv = good_csv(fmt::format("EFC-{}-{}", client, serial++));
    const RawAnswer answer = request(port, "POST", "/v1/recordings", csv);
    if (answer.status == 0) return;  // killed
    if (answer.status != 202) continue;
    const auto document = parse_json(answer.body);
    if (!document) return;  // killed while it answered: no promise was heard
    const std::lock_guard lock(promises.mutex);
    promises.sha256_by_id[(*document)["id"]] = sha256_hex(csv);
  }
}

std::string log_in(const test::TemporaryFolder& folder) {
  std::ifstream log(folder.file("server.log"));
  return {std::istreambuf_iterator<char>(log), {}};
}

TEST(HttpKill, LosesNoAcceptedRecordingAndAnalysesNoneIntoTwoResults) {
  const char* given = std::getenv("VALVETRIAGE_SEED");
  const unsigned seed = given ? static_cast<unsigned>(std::strtoul(given, nullptr, 10)) : std::random_device{}();
  fmt::print("seed {} (VALVETRIAGE_SEED repeats it)\n", seed);
  RecordProperty("seed", std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> life_ms(0, kLongestLife_ms);

  const test::TemporaryFolder folder;
  Promises promises;
  std::atomic<int> serial = 0;
  for (int i = 0; i < kKills; ++i) {
    ServerProcess server(folder.path());
    ASSERT_NE(server.port(), 0) << "the server did not start again after kill " << i << ":\n" << log_in(folder);
    std::atomic<bool> over = false;
    std::vector<std::thread> clients;
    for (int client = 0; client < kClients; ++client) {
      clients.emplace_back([&, client] { upload_until(over, server.port(), client, serial, promises); });
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(life_ms(random)));
    server.end(SIGKILL);
    over = true;
    for (std::thread& client : clients) client.join();
  }
  fmt::print("{} recordings accepted over {} kills\n", promises.sha256_by_id.size(), kKills);
  ASSERT_GT(promises.sha256_by_id.size(), static_cast<std::size_t>(kKills) / 4);

  ServerProcess server(folder.path());
  ASSERT_NE(server.port(), 0);
  for (const auto& [id, hash] : promises.sha256_by_id) {
    const RawAnswer raw = request(server.port(), "GET", "/v1/recordings/" + id + "/raw");
    ASSERT_EQ(raw.status, 200) << id;
    ASSERT_EQ(sha256_hex(raw.body), hash) << id;
    Json document;
    for (int i = 0; i < 6000; ++i) {  // 120 s: only a stuck queue gets there
      document = json_of(request(server.port(), "GET", "/v1/recordings/" + id));
      if (document["state"] != "queued" && document["state"] != "running") break;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_EQ(document["state"], "done") << document.dump(1);
    ASSERT_EQ(json_of(request(server.port(), "GET", "/v1/recordings/" + id + "/analyses"))["items"].size(), 1u) << id;
  }
  EXPECT_EQ(server.end(SIGTERM), 0) << "a drained server ends with status 0";

  const auto store = open_sqlite_store(folder.file("valvetriage.sqlite"));
  ASSERT_TRUE(store);
  EXPECT_EQ((*store)->check()->size(), 0u);
}

}  // namespace
}  // namespace valvetriage
