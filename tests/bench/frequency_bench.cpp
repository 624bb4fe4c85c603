// The frequency domain against its floors, in the same run: two Fourier transforms of the record for a response, the
// normal equations of the fit's own iterations for a rational function.
#include <benchmark/benchmark.h>

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include "core/identify/rational_fit.h"
#include "tests/bench/processor_time.h"
#include "tests/unit/identify/responses.h"

namespace {

using valvetriage::bench::processor_seconds;
using valvetriage::test::plant_s;

double floor_transforms(std::vector<double>& u, std::vector<double>& y) {
  const double start = processor_seconds();
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> lines;
  fft.fwd(lines, u);
  benchmark::DoNotOptimize(lines.data());
  fft.fwd(lines, y);
  benchmark::DoNotOptimize(lines.data());
  return processor_seconds() - start;
}

/// A million samples, 0.2 to 20 Hz at 200 Hz; a million has no prime factor above 5.
void response_of_a_million_samples(benchmark::State& state) {
  constexpr std::size_t kSamples = 1'000'000;
  auto recording =
      valvetriage::test::recording_of(plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004),
                                      valvetriage::test::swept_sine(kSamples, 200, 0.2, 20, 0.1), 200, 0.35);
  const valvetriage::Recording* const one[] = {&recording};
  double floor_total = 0, total = 0;
  for (auto _ : state) {
    floor_total += floor_transforms(recording.input.values, recording.output.values);
    const double start = processor_seconds();
    auto response = valvetriage::estimate_frequency_response(one);
    const double seconds = processor_seconds() - start;
    if (!response) state.SkipWithError(response.error().message.c_str());
    benchmark::DoNotOptimize(response);
    total += seconds;
    state.SetIterationTime(seconds);
  }
  state.counters["samples_per_s"] = kSamples * static_cast<double>(state.iterations()) / total;
  state.counters["floor_ms"] = 1e3 * floor_total / static_cast<double>(state.iterations());
  state.counters["times_floor"] = total / floor_total;
}
BENCHMARK(response_of_a_million_samples)->UseManualTime()->Unit(benchmark::kMillisecond);

double floor_normal_equations(Eigen::Index values, Eigen::Index parameters, int iterations) {
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Random(values, parameters);
  const Eigen::VectorXd residual = Eigen::VectorXd::Random(values);
  const double start = processor_seconds();
  for (int i = 0; i < iterations; ++i) {
    const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    const Eigen::VectorXd step = normal.ldlt().solve(jacobian.transpose() * residual);
    jacobian(0, 0) += 1e-6 * step(0);
  }
  benchmark::DoNotOptimize(jacobian.data());
  return processor_seconds() - start;
}

/// Order nine with three zeros and a delay at 200 frequencies, errors of 1 %.
void fit_of_order_nine(benchmark::State& state) {
  const auto truth = plant_s(470, {0.8}, {{3, 0.4}, {9, 0.3}, {25, 0.3}, {40, 0.2}}, {2, 6, 30}, 0.004);
  double floor_total = 0, total = 0;
  std::uint32_t seed = 0;
  for (auto _ : state) {
    const auto response = valvetriage::test::response_of(truth, 0.2, 80, 200, 0.01, ++seed);
    const double start = processor_seconds();
    auto fit = valvetriage::fit_rational(response, {.order = 9, .zeros = 3});
    const double seconds = processor_seconds() - start;
    floor_total += floor_normal_equations(400, fit->parameters, fit->iterations);
    total += seconds;
    state.SetIterationTime(seconds);
  }
  state.counters["floor_ms"] = 1e3 * floor_total / static_cast<double>(state.iterations());
  state.counters["times_floor"] = total / floor_total;
}
BENCHMARK(fit_of_order_nine)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
