#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>

#include "core/model/free_run.h"
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

/// What enters G: the loop's output for a valve, the input about its operating point otherwise.
IntervalSignal driving_signal(const Model& model, const IntervalSignal& input, std::optional<double> gate) {
  IntervalSignal signal =
      model.loop ? model.loop->apply(input, loop_driver(input, gate ? *gate : loop_gate(input))) : input;
  for (std::vector<double>* side : {&signal.start, &signal.end}) {
    for (double& u : *side) u -= model.input_offset;
  }
  return signal;
}

/// Where a free run starts: the states of G, and how far the volume is from its steady pressure.
struct StartState {
  FilterState filter;
  double volume_gap = 0;
};

/// Friction's part in the response of a spool, a pair of poles and perhaps a lag: what the sliding spool does beside
/// the free one.
void slide(const SpoolFriction& friction, const TransferFunction& g, const LinearFilter& filter,
           const IntervalSignal& v, double sample_period_s, std::span<double> y) {
  const auto spool = to_valve_dynamics(g);
  if (!spool || spool->lag_s.size() > 1) return;
  FilterState rest = filter.steady(v.start.front()).value_or(filter.rest());
  rest.past = v.start.front();
  std::vector<double> free(y.size()), sliding(y.size());
  filter.run(rest, std::span(v.start).first(y.size()), std::span(v.end).first(y.size()), free);
  run_sliding_spool(*spool, friction, sample_period_s, v, 0, sliding);
  for (std::size_t i = 0; i < y.size(); ++i) y[i] += sliding[i] - free[i];
}

/// The response from a state on, as many samples as `y` has.
void respond(const Model& model, const SignalLaws& laws, const LinearFilter& filter, const IntervalSignal& v,
             StartState from, double sample_period_s, std::span<double> y) {
  filter.run(from.filter, std::span(v.start).first(y.size()), std::span(v.end).first(y.size()), y);
  if (model.friction && !y.empty()) slide(*model.friction, model.dynamics, filter, v, sample_period_s, y);
  if (laws.at_position) laws.at_position(y);
  if (model.map) model.map->apply(y);
  if (laws.at_steady) laws.at_steady(y);
  std::vector<double> steady;
  if (laws.at_output) steady.assign(y.begin(), y.end());
  if (model.volume && !y.empty()) {
    const double first_psi = settled_psi(*model.volume, y[0]) + from.volume_gap;
    run_volume(*model.volume, sample_period_s, first_psi, y, y);
  }
  for (double& value : y) value += model.output_offset;
  if (laws.at_output) laws.at_output(steady, y);
}

/// Moves `start` by least squares towards the first measured outputs; the smallest move where they do not determine it.
/// Exact in one step for a linear model, Gauss-Newton for a valve.
void fit_start(const Model& model, const SignalLaws& laws, const LinearFilter& filter, const IntervalSignal& v,
               std::span<const double> measured, double sample_period_s, StartState& start) {
  const std::size_t samples = std::min(measured.size(), v.start.size());
  const auto order = static_cast<Index>(filter.order());
  const Index states = order + (model.volume ? 1 : 0);
  if (samples == 0 || states == 0) return;
  const auto moved = [&](StartState from, const Eigen::VectorXd& by) {
    for (Index j = 0; j < order; ++j) from.filter.x[static_cast<std::size_t>(j)] += by[j];
    if (model.volume) from.volume_gap += by[order];
    return from;
  };
  std::vector<double> response(samples), shifted(samples);
  const bool bent = model.map || laws.at_position || laws.at_output;
  const int iterations = bent ? 6 : 1;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    respond(model, laws, filter, v, start, sample_period_s, response);
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(static_cast<Index>(samples), states);
    Eigen::VectorXd gap = Eigen::VectorXd::Zero(static_cast<Index>(samples));
    for (Index j = 0; j < states; ++j) {
      const double probe = bent && j < order ? 1e-5 : 1.0;  // [A] of the map's input; a valve is nearly linear there
      respond(model, laws, filter, v, moved(start, probe * Eigen::VectorXd::Unit(states, j)), sample_period_s, shifted);
      for (std::size_t i = 0; i < samples; ++i) {
        if (!std::isfinite(measured[i])) continue;
        gap[static_cast<Index>(i)] = measured[i] - response[i];
        columns(static_cast<Index>(i), j) = (shifted[i] - response[i]) / probe;
      }
    }
    // States differ by powers of the sampling rate: compare their effects on the output, not their numbers.
    const Eigen::VectorXd scale = columns.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
    const Eigen::MatrixXd scaled = columns * scale.cwiseInverse().asDiagonal();
    start = moved(start, scaled.completeOrthogonalDecomposition().solve(gap).cwiseQuotient(scale));
  }
}

/// Values at times i · from_period, straight between them, read at times j · to_period.
std::vector<double> read_at(std::span<const double> values, double from_period, double to_period, std::size_t count) {
  std::vector<double> read(count);
  const double last = static_cast<double>(values.size() - 1);
  for (std::size_t j = 0; j < count; ++j) {
    const double at = std::min(static_cast<double>(j) * to_period / from_period, last);
    const auto left = static_cast<std::size_t>(at);
    const std::size_t right = std::min(left + 1, values.size() - 1);
    read[j] = values[left] + (at - static_cast<double>(left)) * (values[right] - values[left]);
  }
  return read;
}

std::size_t samples_at(double period_s, std::size_t samples, double other_period_s) {
  const double span = static_cast<double>(samples - 1) * period_s / other_period_s;
  return static_cast<std::size_t>(std::ceil(span * (1 - kClockTolerance))) + 1;
}

std::vector<double> machine_input(const Machine& machine, const IntervalSignal& input) {
  if (!machine.interval_means) return input.start;
  std::vector<double> means(input.start.size());
  for (std::size_t i = 0; i < means.size(); ++i) means[i] = 0.5 * (input.start[i] + input.end[i]);
  return means;
}

/// A machine runs at its own sample period; an input on another grid is read, and the output written, straight between
/// samples.
Result<std::vector<double>> simulate_machine(const Machine& machine, std::span<const double> input, double period_s,
                                             std::span<const Channel> side, std::span<const double> measured,
                                             const InitialState& initial) {
  if (const auto checked = check_machine(machine); !checked) return tl::unexpected(checked.error());
  if (input.empty()) return std::vector<double>{};
  const bool own_grid = std::abs(machine.sample_period_s - period_s) <= kClockTolerance * period_s;
  const double to = own_grid ? period_s : machine.sample_period_s;
  const auto resampled = [&](std::span<const double> values) {
    if (own_grid || values.empty()) return std::vector<double>(values.begin(), values.end());
    return read_at(values, period_s, to, samples_at(period_s, values.size(), to));
  };
  std::vector<Channel> channels(side.begin(), side.end());
  for (Channel& channel : channels) channel.values = resampled(channel.values);
  const MachineSurroundings around{.side = channels};
  const std::vector<double> u = resampled(input);
  std::vector<double> start;
  if (initial.kind == InitialState::Kind::kMeasured) {
    start = start_towards(machine, around, u, resampled(measured.first(std::min(initial.samples, measured.size()))));
  }
  std::vector<double> y = run_machine(machine, around, start, u);
  if (!own_grid) y = read_at(y, to, period_s, input.size());
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (!std::isfinite(y[i])) {
      return fail("overflow", fmt::format("the simulation leaves the range of numbers at sample {}", i));
    }
  }
  return y;
}

}  // namespace

Result<LinearFilter> sampled_dynamics(const TransferFunction& g, double sample_period_s) {
  if (g.domain == Domain::kS) return LinearFilter::sampled(g, sample_period_s);
  if (std::abs(g.sample_time_s - sample_period_s) <= kClockTolerance * sample_period_s) {
    return LinearFilter::recursion(g);
  }
  auto continuous = continuous_from_zoh(g);
  if (!continuous) {
    Error error = continuous.error();
    error.message =
        fmt::format("the model's sample time is {} s, the recording's {} s, and it cannot be brought there: {}",
                    g.sample_time_s, sample_period_s, error.message);
    return tl::unexpected(error);
  }
  return LinearFilter::sampled(*continuous, sample_period_s);
}

Result<std::vector<double>> free_run(const Model& model, const SignalLaws& laws, const IntervalSignal& input,
                                     double sample_period_s, std::span<const double> measured,
                                     const InitialState& initial, Horizon horizon) {
  if (horizon == Horizon::kUnbounded) {
    if (const auto stable = require_stable(model.dynamics); !stable) return tl::unexpected(stable.error());
  }
  const auto filter = sampled_dynamics(model.dynamics, sample_period_s);
  if (!filter) return tl::unexpected(filter.error());
  if (input.start.empty()) return std::vector<double>{};

  const IntervalSignal v = driving_signal(model, input, laws.loop_gate);
  StartState start{.filter = filter->steady(v.start.front()).value_or(filter->rest())};
  start.filter.past = v.start.front();
  if (initial.kind == InitialState::Kind::kMeasured) {
    const auto first = measured.first(std::min(initial.samples, measured.size()));
    fit_start(model, laws, *filter, v, first, sample_period_s, start);
  }
  std::vector<double> y(v.start.size());
  respond(model, laws, *filter, v, start, sample_period_s, y);
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (!std::isfinite(y[i])) {
      return fail("overflow", fmt::format("the simulation leaves the range of numbers at sample {}", i));
    }
  }
  return y;
}

std::vector<double> first_outputs(const Recording& recording, const InitialState& initial) {
  std::vector<double> measured = recording.output.values;
  measured.resize(std::min({measured.size(), initial.samples, recording.input.values.size()}));
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (!recording.is_valid(i)) measured[i] = std::numeric_limits<double>::quiet_NaN();
  }
  return measured;
}

IntervalSignal model_input(const Model& model, const Recording& recording) {
  return model.map ? noise_free_input(recording) : input_between_samples(recording);
}

Result<std::vector<double>> simulate(const Model& model, const IntervalSignal& input, double sample_period_s,
                                     std::span<const double> measured, const InitialState& initial, Horizon horizon) {
  if (model.machine) {
    return simulate_machine(*model.machine, machine_input(*model.machine, input), sample_period_s, {}, measured,
                            initial);
  }
  return free_run(model, {}, input, sample_period_s, measured, initial, horizon);
}

Result<std::vector<double>> simulate(const Model& model, const Recording& recording, const InitialState& initial,
                                     Horizon horizon) {
  const std::vector<double> measured = first_outputs(recording, initial);
  if (model.machine) {
    return simulate_machine(*model.machine, machine_input(*model.machine, input_between_samples(recording)),
                            recording.sample_period_s, recording.side, measured, initial);
  }
  return simulate(model, model_input(model, recording), recording.sample_period_s, measured, initial, horizon);
}

}  // namespace valvetriage
