// Reading CSV, with its floor in the same run: a bare std::from_chars loop over the same bytes into reserved arrays.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "core/recording/parse_csv.h"
#include "core/recording/prepare.h"
#include "tests/bench/processor_time.h"

namespace valvetriage {
namespace {

constexpr std::size_t kRows = 200'000;

/// What a stand writes: stamps of 5 ms, current and pressure with four decimals.
const std::string& csv_rows() {
  static const std::string rows = [] {
    std::string text;
    for (std::size_t i = 0; i < kRows; ++i) {
      const double phase = static_cast<double>(i) * 0.01;
      text += fmt::format("{:.4f},{:.4f},{:.4f}\n", 0.005 * static_cast<double>(i), 1.5 + 0.5 * std::sin(phase),
                          100 + 50 * std::sin(phase - 0.3) + 0.35 * std::sin(997.0 * static_cast<double>(i)));
    }
    return text;
  }();
  return rows;
}

const std::string& csv_text() {
  static const std::string text = "# serial: 1\ntime_s,current_A,pressure_psi\n" + csv_rows();
  return text;
}

class TextSource : public ByteSource {
 public:
  explicit TextSource(std::string_view text) : text_(text) {}
  Result<std::size_t> read(std::span<char> buffer) override {
    const std::size_t n = std::min(buffer.size(), text_.size() - at_);
    std::memcpy(buffer.data(), text_.data() + at_, n);
    at_ += n;
    return n;
  }
  bool rewind() override {
    at_ = 0;
    return true;
  }

 private:
  std::string_view text_;
  std::size_t at_ = 0;
};

std::size_t parse_once() {
  TextSource source(csv_text());
  const auto raw = parse_csv(source, "bench.csv", {});
  return raw ? raw->output.values.size() : 0;
}

std::size_t floor_once() {
  std::vector<double> columns[3];
  for (auto& column : columns) column.reserve(kRows);
  const char* at = csv_rows().data();
  const char* const end = at + csv_rows().size();
  while (at < end) {
    for (auto& column : columns) {
      double value = 0;
      at = std::from_chars(at, end, value).ptr + 1;
      column.push_back(value);
    }
  }
  benchmark::DoNotOptimize(columns[2].data());
  return columns[2].size();
}

double seconds_of(std::size_t (*run)()) {
  const double start = bench::processor_seconds();
  if (run() != kRows) std::abort();
  return bench::processor_seconds() - start;
}

/// Parser and floor in turns, so that both see the same machine; `of_floor` is the ratio of their rows per second.
void parse_csv_beside_its_floor(benchmark::State& state) {
  std::vector<double> parsed, floors;
  for (auto _ : state) {
    floors.push_back(seconds_of(floor_once));
    parsed.push_back(seconds_of(parse_once));
    state.SetIterationTime(parsed.back());
  }
  const double best_parsed = *std::ranges::min_element(parsed), best_floor = *std::ranges::min_element(floors);
  state.counters["rows_per_s"] = kRows / best_parsed;
  state.counters["floor_rows_per_s"] = kRows / best_floor;
  state.counters["of_floor"] = best_floor / best_parsed;
}
BENCHMARK(parse_csv_beside_its_floor)->UseManualTime()->Unit(benchmark::kMillisecond);

void prepare(benchmark::State& state) {
  TextSource source(csv_text());
  const auto raw = parse_csv(source, "bench.csv", {});
  for (auto _ : state) {
    auto recording = prepare_recording(*raw, {});
    benchmark::DoNotOptimize(recording);
  }
  state.counters["rows_per_s"] =
      benchmark::Counter(static_cast<double>(kRows * state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(prepare)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace valvetriage

BENCHMARK_MAIN();
