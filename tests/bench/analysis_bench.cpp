// Analyses per second of one core: a returned valve's session of 24,000 samples against a reference of good valves,
// with one free run of the same session as its floor in the same run.
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "core/analysis/analyze.h"
#include "core/analysis/learn_reference.h"
#include "tests/bench/processor_time.h"
#include "tests/unit/identify/valves.h"

namespace {

using namespace valvetriage;
using bench::processor_seconds;

constexpr double kNoise_psi = 0.35;
constexpr std::size_t kSamples = 24'000;

/// Three sessions of 7,600 samples and one step more.
std::vector<Recording> long_session(const test::MadeValve& valve, unsigned seed) {
  std::vector<Recording> recordings;
  for (unsigned run = 0; run < 3; ++run) {
    for (Recording& recording : test::session(valve, kNoise_psi, seed + 10 * run)) {
      recordings.push_back(std::move(recording));
    }
  }
  recordings.push_back(test::step_to(valve, 1.5, kNoise_psi, seed + 30));
  return recordings;
}

Reference learned_reference() {
  std::vector<ValveRecordings> good;
  for (unsigned i = 0; i < 4; ++i) {
    test::MadeValve valve;
    valve.parameters.volume.time_constant_s *= 1 + 0.02 * i;
    good.push_back({"GOOD-" + std::to_string(i), test::session(valve, kNoise_psi, 100 * i)});
  }
  return learn_reference(good, "bench").value();
}

/// The least that any analysis has to do: run the valve's equations once over every recording.
void run_once(const test::MadeValve& valve, const std::vector<Recording>& recordings) {
  for (const Recording& recording : recordings) {
    benchmark::DoNotOptimize(test::pressure_of(valve, input_between_samples(recording), recording.sample_period_s));
  }
}

/// `free_runs` is what an analysis costs in runs of the model over the session.
void analysis_of_a_session(benchmark::State& state) {
  const AnalysisOptions options{.reference = learned_reference(), .rule_base = {}, .baseline = {}};
  test::MadeValve slow;
  slow.parameters.volume.time_constant_s *= 2;
  const std::vector<Recording> recordings = long_session(slow, 900);
  std::size_t samples = 0;
  for (const Recording& recording : recordings) samples += recording.samples();
  if (samples != kSamples) std::abort();
  double floor_total = 0, total = 0;
  for (auto _ : state) {
    double start = processor_seconds();
    run_once(slow, recordings);
    floor_total += processor_seconds() - start;
    start = processor_seconds();
    auto analysis = analyze(recordings, options);
    if (!analysis) std::abort();
    const double seconds = processor_seconds() - start;
    total += seconds;
    state.SetIterationTime(seconds);
  }
  state.counters["analyses_per_s"] = static_cast<double>(state.iterations()) / total;
  state.counters["free_runs"] = total / floor_total;
}
BENCHMARK(analysis_of_a_session)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
