// Recursive least squares against its floor: the textbook update of Eqs 13 to 15 on fixed-size arrays, in the same run.
#include <benchmark/benchmark.h>

#include <array>
#include <random>
#include <vector>

#include "core/identify/identification.h"
#include "core/identify/rls.h"
#include "tests/bench/processor_time.h"

namespace {

constexpr std::size_t kRows = 4096;

std::vector<double> regressors(std::size_t parameters) {
  std::mt19937 engine(7);
  std::vector<double> rows(kRows * (parameters + 1));
  for (auto& value : rows) value = static_cast<double>(engine()) / 4294967296.0 - 0.5;
  return rows;
}

template <std::size_t N>
void floor_update(std::array<double, N>& theta, std::array<double, N * N>& P, const double* phi, double y,
                  double lambda) {
  std::array<double, N> g{};
  double alpha = lambda;
  double error = y;
  for (std::size_t i = 0; i < N; ++i) {
    for (std::size_t j = 0; j < N; ++j) g[j] += P[i * N + j] * phi[i];
  }
  for (std::size_t i = 0; i < N; ++i) {
    alpha += phi[i] * g[i];
    error -= phi[i] * theta[i];
  }
  const double inverse = 1 / alpha;
  const double inverse_lambda = 1 / lambda;
  for (std::size_t i = 0; i < N; ++i) {
    const double gain = g[i] * inverse;
    theta[i] += gain * error;
    for (std::size_t j = 0; j < N; ++j) P[i * N + j] = (P[i * N + j] - gain * g[j]) * inverse_lambda;
  }
}

using valvetriage::bench::processor_seconds;

template <std::size_t N>
double floor_seconds(const std::vector<double>& rows, double lambda) {
  std::array<double, N> theta{};
  std::array<double, N * N> P{};
  for (std::size_t i = 0; i < N; ++i) P[i * N + i] = 1e6;
  const double start = processor_seconds();
  for (std::size_t t = 0; t < kRows; ++t) {
    floor_update<N>(theta, P, &rows[t * (N + 1)], rows[t * (N + 1) + N], lambda);
  }
  benchmark::DoNotOptimize(theta);
  return processor_seconds() - start;
}

/// Floor and product take turns on the same rows; `of_floor` is product rate over floor rate.
template <std::size_t N>
void bm_rls_kernel(benchmark::State& state) {
  const double lambda = state.range(0) == 0 ? 1.0 : 0.999;
  const auto rows = regressors(N);
  double floor_total = 0;
  double total = 0;
  for (auto _ : state) {
    floor_total += floor_seconds<N>(rows, lambda);
    valvetriage::RlsKernel kernel(std::vector<double>(std::size_t{N}), lambda, 1e6);
    const double start = processor_seconds();
    for (std::size_t t = 0; t < kRows; ++t) {
      auto error = kernel.update({&rows[t * (N + 1)], N}, rows[t * (N + 1) + N]);
      benchmark::DoNotOptimize(error);
    }
    const double seconds = processor_seconds() - start;
    total += seconds;
    state.SetIterationTime(seconds);
  }
  const double updates = static_cast<double>(state.iterations()) * kRows;
  state.counters["updates_per_s"] = updates / total;
  state.counters["floor_per_s"] = updates / floor_total;
  state.counters["of_floor"] = floor_total / total;
}

/// The whole of a live stream's sample: histories, increments, update.
void bm_rls_stream(benchmark::State& state) {
  const int order = static_cast<int>(state.range(0));
  const int input_terms = static_cast<int>(state.range(1));
  const auto rows = regressors(1);
  for (auto _ : state) {
    auto rls = valvetriage::RecursiveLeastSquares::create({.order = order, .input_terms = input_terms}).value();
    for (std::size_t t = 0; t < kRows; ++t) {
      auto done = rls.update(rows[2 * t], rows[2 * t + 1]);
      benchmark::DoNotOptimize(done);
    }
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(kRows));
}

/// A noisy second-order valve of 24,000 samples at 200 Hz on random levels.
valvetriage::Recording long_recording() {
  constexpr std::size_t kSamples = 24000;
  const auto random = regressors(11);
  valvetriage::Recording recording;
  recording.sample_period_s = 1.0 / 200;
  double level = 1.5, y1 = 0, y2 = 0, u1 = 0, u2 = 0;
  for (std::size_t t = 0; t < kSamples; ++t) {
    if (t % 250 == 0) level = 1.6 + 0.4 * random[t / 250];
    const double y = 1.890035 * y1 - 0.895874 * y2 + 1.372 * (u1 + u2);
    recording.input.values.push_back(level);
    recording.output.values.push_back(y + random[t]);
    y2 = y1, y1 = y, u2 = u1, u1 = level;
  }
  return recording;
}

/// Free-run refinement alone (order given), and with order and delay chosen on the way.
void bm_output_error(benchmark::State& state) {
  const auto recording = long_recording();
  const valvetriage::Recording* const all[] = {&recording};
  valvetriage::IdentifyOptions options;
  for (auto _ : state) {
    if (state.range(0) == 0) {
      auto fit = valvetriage::fit_output_error(all, {.order = 2, .zeros = 1, .delay_samples = 1}, {});
      benchmark::DoNotOptimize(fit);
    } else {
      auto found = valvetriage::identify(all, options);
      benchmark::DoNotOptimize(found);
    }
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(recording.samples()));
}

}  // namespace

BENCHMARK_TEMPLATE(bm_rls_kernel, 4)->Arg(0)->Arg(1)->ArgName("forgets")->UseManualTime();
BENCHMARK_TEMPLATE(bm_rls_kernel, 8)->Arg(0)->Arg(1)->ArgName("forgets")->UseManualTime();
BENCHMARK_TEMPLATE(bm_rls_kernel, 13)->Arg(0)->Arg(1)->ArgName("forgets")->UseManualTime();
BENCHMARK(bm_rls_stream)->Args({2, 2})->Args({4, 4})->Args({7, 6});
BENCHMARK(bm_output_error)->Arg(0)->Arg(1)->ArgName("chooses_order")->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
