#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <optional>
#include <utility>

#include "core/linear_algebra/solve.h"
#include "core/model/free_run.h"
#include "core/model/linear_filter.h"
#include "core/model/model.h"
#include "core/recording/limits.h"

namespace valvetriage {
namespace {

using Eigen::Index;

// A crystal's 100 ppm.
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

/// Where a free run starts, beside rest at the first input.
struct StartState {
  std::vector<double> moved;  ///< states of G or of the mode, from rest
  double volume_gap = 0;      ///< of the volume from its steady pressure
  double memory = 0;          ///< of the loop and the friction
  LawMemories memories;
};

/// Friction's part in the response of a spool, a pair of poles and perhaps a lag: what the sliding spool does beside
/// the free one.
void slide(const SpoolFriction& friction, const RunDynamics& dynamics, const IntervalSignal& v, double memory,
           double sample_period_s, std::span<double> y) {
  const LinearFilter& filter = dynamics.ahead;
  if (!dynamics.spool || dynamics.spool->lag_s.size() > 1) return;
  FilterState rest = filter.steady(v.start.front()).value_or(filter.rest());
  rest.past = v.start.front();
  std::vector<double> free(y.size()), sliding(y.size());
  filter.run(rest, std::span(v.start).first(y.size()), std::span(v.end).first(y.size()), free);
  run_sliding_spool(*dynamics.spool, friction, sample_period_s, v, memory, sliding);
  for (std::size_t i = 0; i < y.size(); ++i) y[i] += sliding[i] - free[i];
}

/// A model with its laws in one recording, ready to run from any state.
class FreeRun {
 public:
  /// input, dynamics  the inner intervals, and what is run at their period
  FreeRun(const Model& model, const SignalLaws& laws, const RunDynamics& dynamics, const IntervalSignal& input,
          double sample_period_s)
      : model_(model), laws_(laws), dynamics_(dynamics), input_(input), sample_period_s_(sample_period_s) {
    if (volume_ && dynamics_.behind) volume_ = without_stop(*volume_);
  }

  std::size_t samples() const { return input_.start.size() / per_sample_; }

  StartState at_rest() const {
    return {.moved = std::vector<double>(moving()),
            .memory = model_.loop ? model_.loop->memory : 0,
            .memories = laws_.memories};
  }

  /// The response from a state on, as many samples as `y` has.
  void respond(const StartState& from, std::span<double> y) const {
    const IntervalSignal v = driving_signal(from, per_sample_ * y.size());
    std::vector<double> x(v.start.size());
    FilterState state = dynamics_.ahead.steady(v.start.front()).value_or(dynamics_.ahead.rest());
    state.past = v.start.front();
    for (std::size_t j = 0; !dynamics_.behind && j < from.moved.size(); ++j) state.x[j] += from.moved[j];
    dynamics_.ahead.run(state, v.start, v.end, x);
    if (model_.friction) {
      const double period_s = sample_period_s_ / static_cast<double>(per_sample_);
      slide(*model_.friction, dynamics_, v, from.memory, period_s, x);
    }
    if (laws_.at_position) laws_.at_position(from.memories, x);
    if (model_.map) model_.map->apply(x);
    if (laws_.at_steady) laws_.at_steady(x);
    const std::vector<double> steady = per_sample_ == 2 ? at_samples(x) : x;
    if (dynamics_.behind) {
      const double stop_psi = model_.volume.value_or(OrificeVolume{}).stop_psi;
      for (double& value : x) value = std::min(value, stop_psi);
      // What enters the map is held where what drives it is, nowhere where something slows it.
      const auto held = dynamics_.spool ? std::vector<bool>(x.size()) : held_intervals(v);
      dynamics_.behind->run(held_or_straight(x, held), {from.moved[0], from.moved[1]}, x);
    }
    if (volume_) {
      const double first_psi = settled_psi(*volume_, x[0]) + from.volume_gap;
      run_volume(*volume_, sample_period_s_, first_psi, x, y);
    } else {
      std::copy(x.begin(), x.end(), y.begin());
    }
    for (double& value : y) value += model_.output_offset;
    if (laws_.at_output) laws_.at_output(steady, y);
  }

  /// The start from which the first outputs are nearest to the measured ones in least squares; the smallest move from
  /// rest where they do not determine it. Exact in one step for a linear model. For a valve, whose map bends and whose
  /// memories end, Levenberg-Marquardt: a step is taken where it comes nearer, for the spool's states and the volume's
  /// look alike and a free step between them runs away.
  StartState start_towards(std::span<const double> measured) const {
    constexpr int kMostSteps = 20;
    constexpr double kLeastGain = 1e-4;  // of the squared error
    StartState start = at_rest();
    const std::size_t samples = std::min(measured.size(), this->samples());
    const auto unknowns = static_cast<Index>(probes(start).size());
    if (samples == 0 || unknowns == 0) return start;
    look_around(measured, start);
    std::vector<double> response = response_from(start, samples);
    Eigen::VectorXd gap = gap_to(measured, response);
    double damping = 1e-3;
    for (int step = 0; step < kMostSteps; ++step) {
      const Eigen::MatrixXd columns = effects(start, measured, response);
      // States differ by powers of the sampling rate: compare their effects on the output, not their numbers.
      if (!is_bent()) return moved(start, scaled_least_squares(columns, gap));
      const Eigen::VectorXd scale = columns.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
      const Eigen::MatrixXd scaled = columns * scale.cwiseInverse().asDiagonal();
      const double before = gap.squaredNorm();
      double gained = 0;
      for (; damping < 1e6; damping *= 10) {
        const Eigen::VectorXd by = bounded_step(start, scaled, scale, gap, damping);
        StartState tried = moved(start, by);
        std::vector<double> reached = response_from(tried, samples);
        const Eigen::VectorXd left = gap_to(measured, reached);
        gained = before - left.squaredNorm();
        if (!(gained > 0)) continue;
        start = std::move(tried);
        response = std::move(reached);
        gap = left;
        damping /= 10;
        break;
      }
      if (!(gained > kLeastGain * before)) break;
    }
    return start;
  }

 private:
  bool is_bent() const { return model_.map || laws_.at_position || laws_.at_output || !laws_.memories.empty(); }
  bool has_memory() const { return model_.loop || model_.friction; }

  /// What enters G: the loop's output for a valve, the input about its operating point otherwise.
  IntervalSignal driving_signal(const StartState& from, std::size_t intervals) const {
    IntervalSignal signal;
    if (laws_.at_input) {
      signal = laws_.at_input(from.memories, intervals);
    } else {
      const auto count = static_cast<std::ptrdiff_t>(intervals);
      signal.start.assign(input_.start.begin(), input_.start.begin() + count);
      signal.end.assign(input_.end.begin(), input_.end.begin() + count);
    }
    if (model_.loop) {
      MagneticLoop loop = *model_.loop;
      loop.memory = from.memory;
      signal = loop.apply(signal, loop_driver(signal, gate_));
    }
    for (std::vector<double>* side : {&signal.start, &signal.end}) {
      for (double& u : *side) u -= model_.input_offset;
    }
    return signal;
  }

  /// How far each unknown of a start is moved to see what it does: for a valve little [A], for it is nearly linear
  /// there; a memory towards its middle, for it ends at one.
  std::vector<double> probes(const StartState& start) const {
    const auto inwards = [](double memory) { return memory > 0 ? -0.01 : 0.01; };
    constexpr double kLittle_a = 1e-5, kLittle_psi = 1e-3;
    std::vector<double> probes(moving(), dynamics_.behind ? kLittle_psi : is_bent() ? kLittle_a : 1.0);
    if (model_.volume) probes.push_back(1);
    if (has_memory()) probes.push_back(inwards(start.memory));
    for (const double memory : start.memories) probes.push_back(inwards(memory));
    return probes;
  }

  /// The damped step towards the gap within the ends of the memories: one that would pass its end stops there, and the
  /// others make up for it.
  Eigen::VectorXd bounded_step(const StartState& start, const Eigen::MatrixXd& scaled, const Eigen::VectorXd& scale,
                               const Eigen::VectorXd& gap, double damping) const {
    const Index unknowns = scaled.cols();
    std::vector<double> memories = start.memories;
    if (has_memory()) memories.insert(memories.begin(), start.memory);
    const Index first_memory = unknowns - static_cast<Index>(memories.size());
    Eigen::MatrixXd free = scaled;
    Eigen::VectorXd stopped = Eigen::VectorXd::Zero(unknowns);
    while (true) {
      const Eigen::MatrixXd damped = free.transpose() * free + damping * Eigen::MatrixXd::Identity(unknowns, unknowns);
      const Eigen::VectorXd left = gap - scaled * stopped.cwiseProduct(scale);
      const Eigen::VectorXd by = stopped + solve_symmetric(damped, free.transpose() * left).cwiseQuotient(scale);
      bool passes = false;
      for (Index j = first_memory; j < unknowns; ++j) {
        const double memory = memories[static_cast<std::size_t>(j - first_memory)];
        if (free.col(j).isZero(0) || std::abs(memory + by[j]) <= 1) continue;
        stopped[j] = std::copysign(1.0, by[j]) - memory;
        free.col(j).setZero();
        passes = true;
      }
      if (!passes) return by;
    }
  }

  StartState moved(StartState from, const Eigen::VectorXd& by) const {
    Index at = 0;
    for (double& state : from.moved) state += by[at++];
    if (model_.volume) from.volume_gap += by[at++];
    if (has_memory()) from.memory = std::clamp(from.memory + by[at++], -1.0, 1.0);
    for (double& memory : from.memories) memory = std::clamp(memory + by[at++], -1.0, 1.0);
    return from;
  }

  std::vector<double> response_from(const StartState& from, std::size_t samples) const {
    std::vector<double> response(samples);
    respond(from, response);
    return response;
  }

  /// Measured − response, 0 where nothing was measured.
  static Eigen::VectorXd gap_to(std::span<const double> measured, std::span<const double> response) {
    Eigen::VectorXd gap = Eigen::VectorXd::Zero(static_cast<Index>(response.size()));
    for (std::size_t i = 0; i < response.size(); ++i) {
      if (std::isfinite(measured[i])) gap[static_cast<Index>(i)] = measured[i] - response[i];
    }
    return gap;
  }

  /// Each memory in turn at the best of a few places between its ends: inside a play nothing small shows an effect.
  void look_around(std::span<const double> measured, StartState& start) const {
    std::vector<double*> memories;
    if (has_memory()) memories.push_back(&start.memory);
    for (double& memory : start.memories) memories.push_back(&memory);
    for (double* memory : memories) {
      double nearest = std::numeric_limits<double>::infinity(), best = *memory;
      for (const double place : {*memory, -1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0}) {
        *memory = place;
        const std::size_t samples = std::min(measured.size(), this->samples());
        const double squares = gap_to(measured, response_from(start, samples)).squaredNorm();
        if (!(squares < nearest)) continue;
        nearest = squares;
        best = place;
      }
      *memory = best;
    }
  }

  /// What each unknown of a start does to the first outputs, per unit; 0 where nothing was measured.
  Eigen::MatrixXd effects(const StartState& start, std::span<const double> measured,
                          std::span<const double> response) const {
    const std::vector<double> probe = probes(start);
    Eigen::MatrixXd columns =
        Eigen::MatrixXd::Zero(static_cast<Index>(response.size()), static_cast<Index>(probe.size()));
    for (Index j = 0; j < columns.cols(); ++j) {
      const double way = probe[static_cast<std::size_t>(j)];
      const StartState shifted = moved(start, way * Eigen::VectorXd::Unit(columns.cols(), j));
      const std::vector<double> there = response_from(shifted, response.size());
      for (std::size_t i = 0; i < response.size(); ++i) {
        if (std::isfinite(measured[i])) columns(static_cast<Index>(i), j) = (there[i] - response[i]) / way;
      }
    }
    return columns;
  }

  /// How many states move when it starts off its rest: the mode's, or those of G.
  std::size_t moving() const { return dynamics_.behind ? 2 : dynamics_.ahead.order(); }

  const Model& model_;
  const SignalLaws& laws_;
  const RunDynamics& dynamics_;
  std::optional<OrificeVolume> volume_ = model_.volume;
  const IntervalSignal& input_;
  double sample_period_s_;
  std::size_t per_sample_ = runs_per_sample(model_);
  double gate_ = model_.loop ? loop_gate(input_) : 0;  // of the input before a law moves it
};

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
  const bool own_grid = is_same_period(machine.sample_period_s, period_s);
  const double to = own_grid ? period_s : machine.sample_period_s;
  const double own_samples = static_cast<double>(input.size()) * (period_s / to);
  if (!(own_samples <= static_cast<double>(kMaxRows))) {
    return fail("too_large",
                fmt::format("{} samples of {} s are {:.3g} of the machine's own {:.3g} s, at most {} are run",
                            input.size(), period_s, own_samples, to, kMaxRows));
  }
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

bool is_same_period(double one_s, double other_s) {
  return std::abs(one_s - other_s) <= kClockTolerance * other_s;
}

namespace {

Result<LinearFilter> sampled_dynamics(const TransferFunction& g, double sample_period_s) {
  if (g.domain == Domain::kS) return LinearFilter::sampled(g, sample_period_s);
  if (is_same_period(g.sample_time_s, sample_period_s)) {
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

}  // namespace

Result<RunDynamics> run_dynamics(const Model& model, double inner_period_s) {
  TransferFunction g = model.dynamics;
  auto spool = to_valve_dynamics(g);
  std::optional<SampledMode> behind;
  if (spool && model.mode) {
    const bool is_slowed = model.friction || !spool->lag_s.empty();
    behind.emplace(delayed_mode(*model.mode, *spool, is_slowed, inner_period_s),
                   model.volume ? model.volume->fall_to_rise_ratio : 1, inner_period_s);
    spool->delay_s = 0;
    g = is_slowed ? to_transfer_function(*spool) : TransferFunction{.domain = Domain::kS, .gain = 1};
    if (!is_slowed) spool.reset();
  }
  auto ahead = sampled_dynamics(g, inner_period_s);
  if (!ahead) return tl::unexpected(ahead.error());
  return RunDynamics{std::move(*ahead), std::move(behind), std::move(spool)};
}

IntervalSignal inner_intervals(const Model& model, const IntervalSignal& input) {
  return runs_per_sample(model) == 2 ? halved(input) : input;
}

Result<std::vector<double>> free_run(const Model& model, const SignalLaws& laws, const IntervalSignal& inner_input,
                                     double sample_period_s, std::span<const double> measured,
                                     const InitialState& initial, Horizon horizon) {
  if (horizon == Horizon::kUnbounded) {
    if (const auto stable = require_stable(model.dynamics); !stable) return tl::unexpected(stable.error());
  }
  const auto dynamics = run_dynamics(model, sample_period_s / static_cast<double>(runs_per_sample(model)));
  if (!dynamics) return tl::unexpected(dynamics.error());
  if (inner_input.start.empty()) return std::vector<double>{};

  const FreeRun run(model, laws, *dynamics, inner_input, sample_period_s);
  const bool measured_start = initial.kind == InitialState::Kind::kMeasured;
  const auto first = measured.first(measured_start ? std::min(initial.samples, measured.size()) : 0);
  std::vector<double> y(run.samples());
  run.respond(run.start_towards(first), y);
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
  return model.map ? noise_free_input(recording, model.input_between)
                   : input_between_samples(recording, model.input_between);
}

Result<std::vector<double>> simulate(const Model& model, const IntervalSignal& input, double sample_period_s,
                                     std::span<const double> measured, const InitialState& initial, Horizon horizon) {
  if (model.machine) {
    return simulate_machine(*model.machine, machine_input(*model.machine, input), sample_period_s, {}, measured,
                            initial);
  }
  return free_run(model, {}, inner_intervals(model, input), sample_period_s, measured, initial, horizon);
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
