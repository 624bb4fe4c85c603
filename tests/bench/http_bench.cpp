// Uploads durably accepted per second over HTTP, with the floor of the machine's disk in the same run: a file written,
// synced, renamed and its folder synced, then a committed row, in a bare loop.

#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sqlite3.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <memory>
#include <thread>

#include "server/http/http_server.h"
#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/http_exchange.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {
namespace {

/// One session's recording as the stand writes it: 4,000 rows, about 100 kB.
std::string recording(std::uint64_t serial) {
  std::string text = fmt::format("# serial: EFC-{}\n# lot: bench\ntime_s,current_A,pressure_psi\n", serial);
  for (int i = 0; i < 4000; ++i)
    text += fmt::format("{:.4f},{:.4f},{:.3f}\n", 0.005 * i, i < 1000 ? 1.2 : 1.6, 26 + 0.01 * i);
  return text;
}

/// Folder, database and HTTP server without workers, shared by the threads of one run.
struct BenchServer {
  BenchServer()
      : store(std::move(*open_sqlite_store(folder.file("v.sqlite")))),
        blobs(std::move(*BlobStore::open(folder.path()))),
        service{.store = *store, .blobs = *blobs, .limits = {.max_queued_jobs = 10'000'000}},
        front(http::make_http_server(
            service, std::move(*http::Listener::open({.host = "127.0.0.1", .port = 0, .socket_path = {}})), 16, false)),
        thread([this] { front->run(); }) {}
  ~BenchServer() {
    front->stop();
    thread.join();
  }

  test::TemporaryFolder folder;
  std::unique_ptr<Store> store;
  std::unique_ptr<BlobStore> blobs;
  http::Service service;
  std::unique_ptr<http::Front> front;
  std::thread thread;
};

std::unique_ptr<BenchServer> shared_server;
std::atomic<std::uint64_t> next_serial = 0;

void uploads_durably_accepted(benchmark::State& state) {
  if (state.thread_index() == 0) shared_server = std::make_unique<BenchServer>();
  for (auto _ : state) {
    const RawAnswer answer =
        request(shared_server->front->endpoint().port, "POST", "/v1/recordings", recording(next_serial++));
    if (answer.status != 202) state.SkipWithError(answer.body.c_str());
  }
  state.SetItemsProcessed(state.iterations());
  if (state.thread_index() == 0) shared_server.reset();
}
BENCHMARK(uploads_durably_accepted)->Threads(1)->Threads(4)->Threads(16)->UseRealTime();

void write_synced(const std::string& folder, const std::string& name, const std::string& text) {
  const std::string temporary = folder + "/incoming";
  const int file = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  [[maybe_unused]] const auto n = write(file, text.data(), text.size());
  fsync(file);
  close(file);
  std::rename(temporary.c_str(), (folder + "/" + name).c_str());
  const int directory = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  fsync(directory);
  close(directory);
}

/// The floor: what any service that keeps the same promise has to do for one upload at a time.
void floor_synced_file_and_commit(benchmark::State& state) {
  const test::TemporaryFolder folder;
  sqlite3* database = nullptr;
  sqlite3_open(folder.file("floor.sqlite").c_str(), &database);
  sqlite3_exec(database, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; CREATE TABLE t(a);", nullptr, nullptr,
               nullptr);
  std::uint64_t i = 0;
  for (auto _ : state) {
    write_synced(folder.path(), std::to_string(i), recording(i));
    sqlite3_exec(database, "INSERT INTO t VALUES(1)", nullptr, nullptr, nullptr);
    ++i;
  }
  state.SetItemsProcessed(state.iterations());
  sqlite3_close(database);
}
BENCHMARK(floor_synced_file_and_commit)->UseRealTime();

}  // namespace
}  // namespace valvetriage

BENCHMARK_MAIN();
