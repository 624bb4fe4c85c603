// Free-run simulation against the bare difference equation of the same order, in one run: quote the ratio.
#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "core/model/linear_filter.h"
#include "core/model/model.h"

namespace valvetriage {
namespace {

constexpr std::size_t kSamples = 24'000;  // a session of six recordings
constexpr double kPeriod_s = 0.005;

TransferFunction system_of(int order) {
  TransferFunction g{.domain = Domain::kS, .delay_s = 2.4 * kPeriod_s};
  for (int i = 0; i + 1 < order; i += 2) {
    const double w = 10 + 7 * i;
    g.poles.emplace_back(-0.5 * w, 0.8 * w);
    g.poles.push_back(std::conj(g.poles.back()));
  }
  if (order % 2 == 1) g.poles.emplace_back(-8);
  g.gain = 1;
  g.gain = 470 / static_gain(g);
  return g;
}

std::vector<double> input() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(1.5, 0.1);
  std::vector<double> u(kSamples);
  for (double& v : u) v = normal(random);
  return u;
}

void count(benchmark::State& state) {
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(kSamples));
}

// y_t = Σ b_i u_{t−i} − Σ a_j y_{t−j}, nothing else: the floor.
template <int Order>
void bare_recursion(benchmark::State& state) {
  TransferFunction g = system_of(Order);
  g.delay_s = 0;
  const auto c = *to_coefficients(*discretise_zoh(g, kPeriod_s));
  std::array<double, Order + 1> a{}, b{};
  std::copy(c.a.begin(), c.a.end(), a.begin());
  std::copy(c.b.begin(), c.b.end(), b.begin());
  const auto u = input();
  std::vector<double> y(kSamples);
  for (auto _ : state) {
    for (std::size_t t = Order; t < kSamples; ++t) {
      double sum = b[0] * u[t];
      for (int i = 1; i <= Order; ++i) sum += b[i] * u[t - i] - a[i] * y[t - i];
      y[t] = sum;
    }
    benchmark::DoNotOptimize(y.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

void run_filter(benchmark::State& state, const LinearFilter& filter) {
  const auto u = input();
  std::vector<double> end(u.begin() + 1, u.end()), y(kSamples);
  end.push_back(u.back());
  for (auto _ : state) {
    FilterState start = filter.rest();
    filter.run(start, u, end, y);
    benchmark::DoNotOptimize(y.data());
    benchmark::ClobberMemory();
  }
  count(state);
}

template <int Order>
void recursion(benchmark::State& state) {
  TransferFunction g = system_of(Order);
  g.delay_s = 0;
  run_filter(state, *LinearFilter::recursion(*discretise_zoh(g, kPeriod_s)));
}

template <int Order>
void sampled(benchmark::State& state) {
  TransferFunction g = system_of(Order);
  g.delay_s = 0;
  run_filter(state, *LinearFilter::sampled(g, kPeriod_s));
}

template <int Order>
void sampled_fractional_delay(benchmark::State& state) {
  run_filter(state, *LinearFilter::sampled(system_of(Order), kPeriod_s));
}

// All that `simulate` does for a valve: sampling the model, the map, the initial state, the dynamics.
template <int Order>
void simulate_valve(benchmark::State& state) {
  Model model;
  model.dynamics = system_of(Order);
  model.dynamics.gain /= 470;
  StaticMap map;
  for (int i = 0; i <= 40; ++i) {
    map.input.push_back(1.0 + 0.025 * i);
    map.output.push_back(210.0 / (1 + std::exp(-(map.input.back() - 1.55) / 0.09)));
  }
  model.map = map;
  // A slow triangle with 2 mA of noise, as a stand plays it.
  IntervalSignal signal{input(), {}};
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double t = static_cast<double>(i % 8000) / 4000;
    signal.start[i] = 1.2 + 0.8 * (t < 1 ? t : 2 - t) + 0.02 * (signal.start[i] - 1.5);
  }
  signal.end.assign(signal.start.begin() + 1, signal.start.end());
  signal.end.push_back(signal.start.back());
  for (auto _ : state) benchmark::DoNotOptimize(simulate(model, signal, kPeriod_s, {}, {}));
  count(state);
}

BENCHMARK(bare_recursion<2>);
BENCHMARK(recursion<2>);
BENCHMARK(sampled<2>);
BENCHMARK(sampled_fractional_delay<2>);
BENCHMARK(simulate_valve<2>);
BENCHMARK(bare_recursion<5>);
BENCHMARK(recursion<5>);
BENCHMARK(sampled<5>);
BENCHMARK(sampled_fractional_delay<5>);
BENCHMARK(simulate_valve<5>);
BENCHMARK(bare_recursion<9>);
BENCHMARK(recursion<9>);
BENCHMARK(sampled<9>);
BENCHMARK(sampled_fractional_delay<9>);
BENCHMARK(simulate_valve<9>);

}  // namespace
}  // namespace valvetriage

BENCHMARK_MAIN();
