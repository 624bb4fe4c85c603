#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>

#include "core/model/linear_filter.h"
#include "core/model/model.h"

namespace valvetriage {
namespace {

using Eigen::Index;

// Two clocks that differ by less than a crystal's 100 ppm are one sample time.
constexpr double kClockTolerance = 1e-4;

std::string pole_text(std::complex<double> p) {
  if (p.imag() == 0) return fmt::format("{:.4f}", p.real());
  return fmt::format("{:.4f} ± {:.4f}j", p.real(), std::abs(p.imag()));
}

Result<void> require_stable(const TransferFunction& g) {
  if (is_stable(g)) return {};
  const auto growth = [&](std::complex<double> p) { return g.domain == Domain::kZ ? std::abs(p) : p.real(); };
  const auto worst = *std::max_element(g.poles.begin(), g.poles.end(),
                                       [&](auto left, auto right) { return growth(left) < growth(right); });
  if (g.domain == Domain::kZ) {
    return fail("unstable",
                fmt::format("the model is unstable: its pole at z = {} has modulus {:.4f}; ask for a finite "
                            "horizon to run it on this record alone",
                            pole_text(worst), std::abs(worst)));
  }
  return fail("unstable",
              fmt::format("the model is unstable: its pole at s = {} rad/s has modulus {:.4f} rad/s and lies "
                          "not in the left half plane; ask for a finite horizon to run it on this record "
                          "alone",
                          pole_text(worst), std::abs(worst)));
}

Result<LinearFilter> filter_for(const TransferFunction& g, double period_s) {
  if (g.domain == Domain::kS) return LinearFilter::sampled(g, period_s);
  if (std::abs(g.sample_time_s - period_s) <= kClockTolerance * period_s) {
    return LinearFilter::recursion(g);
  }
  auto continuous = continuous_from_zoh(g);
  if (!continuous) {
    Error error = continuous.error();
    error.message =
        fmt::format("the model's sample time is {} s, the recording's {} s, and it cannot be brought there: {}",
                    g.sample_time_s, period_s, error.message);
    return tl::unexpected(error);
  }
  return LinearFilter::sampled(*continuous, period_s);
}

IntervalSignal driving_signal(const Model& model, IntervalSignal signal) {
  for (std::vector<double>* side : {&signal.start, &signal.end}) {
    if (model.map) {
      model.map->apply(*side);
    } else {
      for (double& u : *side) u -= model.input_offset;
    }
  }
  return signal;
}

/// Moves `state` by the least-squares fit of its free response to the first measured outputs; the smallest move where
/// they do not determine it.
void fit_initial_state(const LinearFilter& filter, const IntervalSignal& v, std::span<const double> measured,
                       double output_offset, FilterState& state) {
  const std::size_t samples = std::min(measured.size(), v.start.size());
  const auto order = static_cast<Index>(filter.order());
  if (samples == 0 || order == 0) return;
  std::vector<double> response(samples);
  FilterState forced = state;
  filter.run(forced, std::span(v.start).first(samples), std::span(v.end).first(samples), response);
  Eigen::MatrixXd free = Eigen::MatrixXd::Zero(static_cast<Index>(samples), order);
  Eigen::VectorXd gap = Eigen::VectorXd::Zero(static_cast<Index>(samples));
  for (std::size_t i = 0; i < samples; ++i) {
    if (std::isfinite(measured[i])) gap[static_cast<Index>(i)] = measured[i] - output_offset - response[i];
  }
  const std::vector<double> silence(samples, 0.0);
  for (Index j = 0; j < order; ++j) {
    FilterState unit = filter.rest();
    unit.x[static_cast<std::size_t>(j)] = 1;
    filter.run(unit, silence, silence, response);
    for (std::size_t i = 0; i < samples; ++i) {
      if (std::isfinite(measured[i])) free(static_cast<Index>(i), j) = response[i];
    }
  }
  // Chain states differ by powers of the sampling rate: compare their effects on the output, not their numbers.
  const Eigen::VectorXd scale = free.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
  const Eigen::MatrixXd scaled = free * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd move = scaled.completeOrthogonalDecomposition().solve(gap).cwiseQuotient(scale);
  for (Index j = 0; j < order; ++j) state.x[static_cast<std::size_t>(j)] += move[j];
}

}  // namespace

Result<std::vector<double>> simulate(const Model& model, const IntervalSignal& input, double sample_period_s,
                                     std::span<const double> measured, const InitialState& initial, Horizon horizon) {
  if (horizon == Horizon::kUnbounded) {
    if (const auto stable = require_stable(model.dynamics); !stable) return tl::unexpected(stable.error());
  }
  const auto filter = filter_for(model.dynamics, sample_period_s);
  if (!filter) return tl::unexpected(filter.error());
  if (input.start.empty()) return std::vector<double>{};

  const IntervalSignal v = driving_signal(model, input);
  FilterState state = filter->steady(v.start.front()).value_or(filter->rest());
  state.past = v.start.front();
  if (initial.kind == InitialState::Kind::kMeasured) {
    fit_initial_state(*filter, v, measured.first(std::min(initial.samples, measured.size())), model.output_offset,
                      state);
  }
  std::vector<double> y(v.start.size());
  filter->run(state, v.start, v.end, y);
  for (std::size_t i = 0; i < y.size(); ++i) {
    y[i] += model.output_offset;
    if (!std::isfinite(y[i])) {
      return fail("overflow", fmt::format("the simulation leaves the range of numbers at sample {}", i));
    }
  }
  return y;
}

Result<std::vector<double>> simulate(const Model& model, const Recording& recording, const InitialState& initial,
                                     Horizon horizon) {
  std::vector<double> measured = recording.output.values;
  measured.resize(std::min({measured.size(), initial.samples, recording.input.values.size()}));
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (!recording.is_valid(i)) measured[i] = std::numeric_limits<double>::quiet_NaN();
  }
  return simulate(model, input_between_samples(recording), recording.sample_period_s, measured, initial, horizon);
}

}  // namespace valvetriage
