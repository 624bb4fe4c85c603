// How fast the store accepts, against the bare disk in the same run, and what its queries cost with a million
// recordings.
//   bench_store            1,000,000 recordings in a temporary folder (about a minute to make)
//   bench_store --quick    20,000
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <string>
#include <vector>

#include "server/jobs/accept.h"
#include "server/store/sqlite/connection.h"
#include "server/store/sqlite/sqlite_store.h"
#include "tests/contract/store_samples.h"
#include "tests/contract/temporary_folder.h"

namespace {

using namespace valvetriage;
using test::TemporaryFolder;

std::int64_t recordings_stored = 1'000'000;
constexpr std::int64_t kLots = 200;

/// Rows as a busy year leaves them, written with plain SQL; the triggers count as they do in service.
void fill(const std::string& file) {
  open_sqlite_store(file)->reset();
  sqlite::Connection connection(file, sqlite::Access::kWrite);
  connection.script("PRAGMA synchronous = OFF");
  connection.script("BEGIN IMMEDIATE");
  const std::string numbers = fmt::format(
      "WITH RECURSIVE n (i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i + 1 < {}) ", recordings_stored);
  connection.script(
      numbers +
      fmt::format(
          "INSERT INTO submissions (seq, id, job_id, state, received_at, lot, serial, valve_type, condition, stand, "
          "recordings, verdict, "
          "conclusion, top_cause, top_cause_probability, errors) SELECT i + 1, 'sub_' || i, 'job_' || i, 'done', "
          "1700000000000 + i * 30000, "
          "'lot-' || (i * {} / {}), 'EFC-' || i, 'type-' || (i % 3), 'returned', 'stand-' || (i % 7), 1, "
          "CASE i % 10 WHEN 0 THEN 'Severe' WHEN 1 THEN 'Malfunctioned' ELSE 'Good' END, 'named', "
          "CASE i % 10 WHEN 0 THEN 'friction' WHEN 1 THEN 'leakage' END, 0.97, '[[1.2,0.03],[2.0,0.11]]' FROM n",
          kLots, recordings_stored));
  connection.script(numbers +
                    "INSERT INTO recordings (id, submission_seq, name, sha256, size_bytes, test, metadata) "
                    "SELECT 'rec_' || i, i + 1, 'step.csv', printf('%064x', i), 100000, 'step', '{}' FROM n");
  connection.script(
      "INSERT INTO lots (lot, first_received_at, last_received_at, recordings, submissions) "
      "SELECT lot, min(received_at), max(received_at), count(*), count(*) FROM submissions GROUP BY lot");
  connection.script(
      "INSERT INTO lot_valves SELECT lot, 'serial ' || serial, seq, verdict FROM submissions;"
      "INSERT INTO submission_causes SELECT top_cause, received_at, seq FROM submissions WHERE top_cause IS NOT NULL;"
      "INSERT INTO lot_causes SELECT lot, top_cause, 'serial ' || serial FROM submissions WHERE top_cause IS NOT NULL");
  connection.script("COMMIT");
}

/// Made once, at the first query that is measured.
Store& filled_store() {
  static const TemporaryFolder folder(TemporaryFolder::Where::kDisk);
  static const std::unique_ptr<Store> store = [] {
    fill(folder.file("db"));
    return std::move(*open_sqlite_store(folder.file("db")));
  }();
  return *store;
}

void lot_query(benchmark::State& state) {
  Store& store = filled_store();
  std::int64_t lot = 0;
  for (auto _ : state) {
    const auto row = store.lot(fmt::format("lot-{}", lot++ % kLots));
    if (!row || row->valves == 0) state.SkipWithError("the lot is not there");
  }
  state.counters["recordings"] = static_cast<double>(recordings_stored);
}
BENCHMARK(lot_query)->Unit(benchmark::kMicrosecond);

void list_query(benchmark::State& state, const Filter& filter) {
  Store& store = filled_store();
  for (auto _ : state) {
    const auto page = store.list_recordings(filter, {.limit = 50, .cursor = {}});
    if (!page || page->items.empty()) state.SkipWithError("nothing was found");
  }
}
BENCHMARK_CAPTURE(list_query, newest, Filter{})->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(list_query, by_lot, Filter{.lot = "lot-7"})->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(list_query, by_lot_and_verdict, Filter{.lot = "lot-7", .verdict = "Severe"})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(list_query, by_serial, Filter{.serial = "EFC-4711"})->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(list_query, by_cause, Filter{.cause = "leakage"})->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(list_query, by_stand_and_time, Filter{.stand = "stand-3", .since = 1'700'000'000'000})
    ->Unit(benchmark::kMicrosecond);

/// The bare disk: what one synced write of a page costs.
void floor_synced_write(benchmark::State& state) {
  const TemporaryFolder folder(TemporaryFolder::Where::kDisk);
  const int fd = ::open(folder.file("floor").c_str(), O_CREAT | O_WRONLY, 0600);
  const std::string page(4096, 'x');
  for (auto _ : state) {
    if (::write(fd, page.data(), page.size()) < 0 || ::fdatasync(fd) != 0) state.SkipWithError("the disk refused");
  }
  ::close(fd);
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(floor_synced_write)->UseRealTime();

/// One store for all threads of a run.
struct Service {
  TemporaryFolder folder{TemporaryFolder::Where::kDisk};
  std::unique_ptr<Store> store = std::move(*open_sqlite_store(folder.file("db")));
  std::unique_ptr<BlobStore> blobs = std::move(*BlobStore::open(folder.path()));
  std::atomic<std::int64_t> sent = 0;
};
std::unique_ptr<Service> service;

void open_service(const benchmark::State&) {
  service = std::make_unique<Service>();
}
void close_service(const benchmark::State&) {
  service.reset();
}

void commits(benchmark::State& state) {
  for (auto _ : state) {
    const std::string content = std::to_string(service->sent++);
    NewSubmission submission = test::alone(test::a_valve("lot-a", "EFC-" + content), content);
    submission.max_queued_jobs = INT64_MAX;
    if (!service->store->accept(submission)) state.SkipWithError("not accepted");
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(commits)->Setup(open_service)->Teardown(close_service)->ThreadRange(1, 16)->UseRealTime();

void durable_uploads(benchmark::State& state) {
  std::string bytes(static_cast<std::size_t>(state.range(0)), 'x');
  for (auto _ : state) {
    const std::string number = std::to_string(service->sent++);
    std::memcpy(bytes.data(), number.data(), number.size());
    auto writer = service->blobs->begin(1 << 30);
    const auto blob = writer->write(bytes).and_then([&] { return writer->commit(); });
    if (!blob) {
      state.SkipWithError("not stored");
      break;
    }
    AcceptRequest request{.labels = test::a_valve("lot-a", "EFC-" + number),
                          .files = {{.name = "a.csv", .blob = *blob, .test = {}}}};
    if (!accept_submission(*service->store, request, {.max_queued_jobs = INT64_MAX}))
      state.SkipWithError("not accepted");
  }
  state.SetItemsProcessed(state.iterations());
  state.SetBytesProcessed(state.iterations() * state.range(0));
}
BENCHMARK(durable_uploads)
    ->Setup(open_service)
    ->Teardown(close_service)
    ->Arg(100'000)
    ->ThreadRange(1, 8)
    ->UseRealTime();

}  // namespace

int main(int argc, char** argv) {
  std::vector<char*> arguments;
  static char short_runs[] = "--benchmark_min_time=0.05";
  for (int i = 0; i < argc; ++i) {
    const bool quick = std::string(argv[i]) == "--quick";
    if (quick) recordings_stored = 20'000;
    arguments.push_back(quick ? short_runs : argv[i]);
  }
  int count = static_cast<int>(arguments.size());
  benchmark::Initialize(&count, arguments.data());
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
