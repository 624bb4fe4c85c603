#include "core/identify/valve_fit_problem.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "core/linear_algebra/solve.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/model/gauge.h"
#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

enum Start : Index { kSpoolRate, kSpoolPosition, kPressureGap, kMemory };

// Physics' own preferences where no population is known.
constexpr double kExponentMean = 0.6, kExponentSd = 0.25;
// In A of valves that are played over 1 A or more; the others have shares of them (UsualMechanisms::current_scale). A
// good spool's friction is a few milliamperes: recordings without reversals do not tell it from the wide loop.
constexpr double kNarrowLoopSd_a = 0.01;
constexpr double kSupplyOverReference = 5.0, kSupplyLogSd = 0.7;  // reference is half of the largest pressure
// In shares of the reference pressure, half of the largest: what they are on a valve of 210 psi. Second differences of
// the map over one knot are a few psi there. Where only edges pass, between the levels of steps, nothing else holds the
// map: allowed ten times as much it makes up for every lag, and leaves dents that no fit comes out of.
constexpr double kMapBend = 4.0 / 105;
// A recording that does not begin at rest is off by no more than this in its map's input and its pressure.
constexpr double kSpoolStartSd_a = 0.05, kPressureStartSd = 20.0 / 105, kMemorySd = 0.5;

/// How a spool that starts off its rest, and whatever lags it with it, returns to it, added to a signal.
void add_return(const SampledValveDynamics& dynamics, double rate, double position, std::span<double> signal) {
  SampledValveDynamics::State free = SampledValveDynamics::State::Constant(dynamics.order(), position);
  free(0) = rate;
  for (double& x : signal) {
    if (free.squaredNorm() < 1e-24) return;  // decayed below any effect
    x += free(free.size() - 1);
    free = dynamics.transition().lazyProduct(free).eval();
  }
}

/// Whether something ahead of the map takes time beside the delay.
template <typename Blocks>
bool is_slowed_ahead_of_map(const Blocks& blocks) {
  return blocks.friction.breakaway_a > 0 || !blocks.valve.spool.lag_s.empty();
}

/// The volume as it is run.
OrificeVolume volume_behind(const ValveParameters& valve) {
  return valve.mode ? without_stop(valve.volume) : valve.volume;
}

/// What the volume follows: what a mode makes of the steady pressure, or that itself.
const std::vector<double>& into_volume(const std::vector<double>& steady, const std::vector<double>& filling) {
  return filling.empty() ? steady : filling;
}

/// A rest goes on between two samples of it.
std::vector<double> rests_between_samples(const std::vector<double>& rests) {
  std::vector<double> halves(2 * rests.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < rests.size(); ++i) {
    halves[2 * i] = rests[i];
    if (i + 1 < rests.size() && rests[i] == rests[i + 1]) halves[2 * i + 1] = rests[i];
  }
  return halves;
}

}  // namespace

ValveFitProblem::ValveFitProblem(std::span<const Recording> recordings, const ValveFitOptions& options)
    : options_(options), knots_(static_cast<Index>(options.knots.size())), curve_(options.knots) {
  for (const Recording& recording : recordings) {
    Prepared prepared{.recording = &recording,
                      .input = halved(noise_free_input(recording, options.usual.input_between))};
    const double noise = noise_floor(recording).rms;
    if (noise > 0) prepared.noise_variance = noise * noise;
    prepared.inverse_variance = 1 / prepared.noise_variance;
    prepared.time_s = law_stamps(recording.samples(), recording.sample_period_s);
    prepared.half_time_s = law_stamps(2 * recording.samples(), 0.5 * recording.sample_period_s);
    prepared.ends_s = interleaved_stamps(2 * recording.samples(), 0.5 * recording.sample_period_s);
    prepared.ends_driver = interleaved_driver(prepared.input);
    prepared.gate = loop_gate(prepared.input);
    prepared.driver = loop_driver(prepared.input, prepared.gate);
    prepared_.push_back(std::move(prepared));
  }
  const double quantum = input_quantum(recordings);
  for (Prepared& prepared : prepared_) {
    prepared.coarse_rests = valvetriage::coarse_rests(*prepared.recording, quantum);
    for (CoarseRest& rest : prepared.coarse_rests) {
      rest.variance *= std::pow(usual_slope(prepared.recording->input.values[rest.end - 1]), 2);
    }
  }
  set_bounds();
  place_laws();
  set_preferences();
}

ValveFitProblem::ValveFitProblem(const ValveFitProblem& other, const ValveFitOptions& options)
    : options_(options), prepared_(other.prepared_), knots_(other.knots_), curve_(other.curve_) {
  set_bounds();
  place_laws();
  set_preferences();
}

void ValveFitProblem::place_laws() {
  Index own = kStarts;
  for (const LawInFit& law : options_.laws) {
    law_at_.push_back(baseline_size() + law_parameters_);
    law_parameters_ += static_cast<Index>(law.shared());
    law_own_at_.push_back(own);
    own += static_cast<Index>(law.own());
  }
  own_ = own;
}

void ValveFitProblem::set_bounds() {
  double period = std::numeric_limits<double>::infinity();
  double longest = 0;
  for (const Prepared& p : prepared_) {
    period = std::min(period, p.recording->sample_period_s);
    longest = std::max(longest, p.recording->sample_period_s * static_cast<double>(p.recording->samples()));
  }
  const double range = options_.knots.back() - options_.knots.front();
  const double reference = options_.reference_psi;
  lower_.resize(kParameters);
  upper_.resize(kParameters);
  step_.resize(kParameters);
  const auto bound = [&](Index j, double low, double high, double step) {
    lower_(j) = low;
    upper_(j) = high;
    step_(j) = step;
  };
  // Faster than the sampling shows, or slower than the record holds, is not to be told from these data.
  bound(kFrequency, std::log(4.0 / longest), std::log(2.0 / period), 1e-4);
  bound(kDamping, std::log(0.05), std::log(20.0), 1e-4);
  bound(kDelay, 0, 0.25 * longest, 1e-3 * period);
  bound(kLoop, 0, 0.5 * range, 1e-6 * options_.usual.current_scale);
  bound(kNarrowLoop, 0, 0.5 * range, 1e-6 * options_.usual.current_scale);
  bound(kTimeConstant, std::log(0.2 * period), std::log(longest), 1e-4);
  bound(kExponent, 0.2, 1.5, 1e-4);
  bound(kSupply, std::log(2.05 * reference), std::log(200 * reference), 1e-4);
}

void ValveFitProblem::set_preferences() {
  spool_start_sd_a_ = kSpoolStartSd_a * options_.usual.current_scale;
  pressure_start_sd_psi_ = kPressureStartSd * options_.reference_psi;
  mean_slope_psi_per_a_ = 2 * options_.reference_psi / (options_.knots.back() - options_.knots.front());
  if (options_.prior) {
    mean_ = options_.prior->mean;
    precision_ = inverse_of_symmetric(options_.prior->covariance);
    return;
  }
  mean_ = VectorXd::Zero(baseline_size());
  precision_ = MatrixXd::Zero(baseline_size(), baseline_size());
  const auto prefer = [&](Index j, double mean, double sd) {
    mean_(j) = mean;
    precision_(j, j) = 1 / (sd * sd);
  };
  prefer(kExponent, kExponentMean, kExponentSd);
  prefer(kNarrowLoop, 0, kNarrowLoopSd_a * options_.usual.current_scale);
  prefer(kSupply, std::log(kSupplyOverReference * options_.reference_psi), kSupplyLogSd);
  constexpr double kStencil[3] = {1, -2, 1};
  const double bend_psi = kMapBend * options_.reference_psi;
  for (Index k = 1; k + 1 < knots_; ++k) {
    for (Index i = 0; i < 3; ++i) {
      for (Index j = 0; j < 3; ++j) {
        precision_(kParameters + k - 1 + i, kParameters + k - 1 + j) +=
            kStencil[i] * kStencil[j] / (bend_psi * bend_psi);
      }
    }
  }
}

VectorXd ValveFitProblem::clamped(VectorXd v) const {
  v.head(kParameters) = v.head(kParameters).cwiseMax(lower_).cwiseMin(upper_);
  const auto clamp_entry = [&](Index at, const LawInFit& law, std::size_t j) {
    v(at) = std::clamp(v(at), law.lower[j], law.upper[j]);
  };
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    double& memory = v(own_at(r) + kMemory);
    memory = std::clamp(memory, -1.0, 1.0);
  }
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    for (std::size_t j = 0; j < law.shared(); ++j) clamp_entry(law_at_[l] + static_cast<Index>(j), law, j);
    for (std::size_t r = 0; r < prepared_.size(); ++r) {
      for (std::size_t j = 0; j < law.own(); ++j) {
        clamp_entry(own_at(r) + law_own_at_[l] + static_cast<Index>(j), law, law.shared() + j);
      }
    }
  }
  return v;
}

VectorXd ValveFitProblem::start_vector(const ValveParameters& parameters) const {
  VectorXd v = VectorXd::Zero(size());
  v.head(kParameters) = to_vector(parameters);
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    for (std::size_t j = 0; j < law.shared(); ++j) v(law_at_[l] + static_cast<Index>(j)) = law.start[j];
    for (std::size_t r = 0; r < prepared_.size(); ++r) {
      for (std::size_t j = 0; j < law.own(); ++j) {
        v(own_at(r) + law_own_at_[l] + static_cast<Index>(j)) = law.start[law.shared() + j];
      }
    }
  }
  if (options_.prior) {
    v.segment(kParameters, knots_) = options_.prior->mean.tail(knots_);
    return clamped(v);
  }
  // Mean output around each knot, gaps filled by the smoothness of the map.
  MatrixXd a = precision_.bottomRightCorner(knots_, knots_);
  VectorXd b = VectorXd::Zero(knots_);
  for_each_knot_seen([&](Index knot, double output) {
    a(knot, knot) += 1;
    b(knot) += output;
  });
  v.segment(kParameters, knots_) = solve_symmetric(a, b);
  v.segment(kParameters, knots_) = rising_map(v);
  return clamped(v);
}

template <typename Visitor>
void ValveFitProblem::for_each_knot_seen(Visitor&& visit) const {
  for (const Prepared& p : prepared_) {
    for (std::size_t i = 0; i < p.recording->samples(); ++i) {
      if (!p.recording->is_valid(i)) continue;
      visit(static_cast<Index>(nearest_knot(options_.knots, p.input.start[2 * i])), p.recording->output.values[i]);
    }
  }
}

VectorXd ValveFitProblem::samples_at_knots() const {
  VectorXd samples = VectorXd::Zero(knots_);
  for_each_knot_seen([&](Index knot, double) { samples(knot) += 1; });
  return samples;
}

VectorXd ValveFitProblem::rising_map(const VectorXd& v) const {
  // A knot that no sample is next to still stands between its neighbours.
  constexpr double kUnseen = 1e-6;
  const VectorXd map = v.segment(kParameters, knots_);
  const VectorXd weights = samples_at_knots().array() + kUnseen;
  const auto knots = static_cast<std::size_t>(knots_);
  const std::vector<double> rising = monotone_regression({map.data(), knots}, {weights.data(), knots});
  return Eigen::Map<const VectorXd>(rising.data(), knots_);
}

VectorXd ValveFitProblem::continued_in(const ValveFitProblem& wider, const VectorXd& v,
                                       std::span<const double> parameters) const {
  VectorXd w = VectorXd::Zero(wider.size());
  w.head(shared()) = v.head(shared());
  const Index added_shared = wider.shared() - shared(), added_own = wider.own() - own_;
  for (Index j = 0; j < added_shared; ++j) w(shared() + j) = parameters[static_cast<std::size_t>(j)];
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    w.segment(wider.own_at(r), own_) = v.segment(own_at(r), own_);
    for (Index j = 0; j < added_own; ++j) {
      const Index from = added_shared + added_own * static_cast<Index>(r) + j;
      w(wider.own_at(r) + own_ + j) = parameters[static_cast<std::size_t>(from)];
    }
  }
  return wider.clamped(w);
}

void ValveFitProblem::follow_rests(const VectorXd& v) {
  const ValveParameters valve = to_parameters(v.head(kParameters), options_.reference_psi, options_.usual);
  const std::vector<double> outputs(v.data() + kParameters, v.data() + kParameters + knots_);
  const StaticMap map = curve_.rising_through(outputs);
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    Prepared& prepared = prepared_[r];
    const Recording& recording = *prepared.recording;
    prepared.rests = spool_rests(recording, valve, map, options_.usual.gauge_lag_s, std::sqrt(prepared.noise_variance));
    prepared.half_rests = rests_between_samples(prepared.rests);
    const double noise =
        static_cast<double>(std::max<std::size_t>(recording.valid_samples(), 1)) * prepared.noise_variance;
    const double left = squared_error(r, simulate(v, r));
    const double slow = std::max(1.0, valve.lag_behind_map_s() / recording.sample_period_s);
    prepared.inverse_variance = 1 / (prepared.noise_variance * (1 + slow * std::max(0.0, left / noise - 1)));
  }
}

std::vector<Slip> ValveFitProblem::slips(const VectorXd& v) const {
  const ValveParameters valve = to_parameters(v.head(kParameters), options_.reference_psi, options_.usual);
  const MagneticLoop loop = loop_of(valve, options_.usual);
  std::vector<Slip> slips;
  for (const Prepared& prepared : prepared_) {
    const std::vector<double> force = at_samples(loop.apply(prepared.input, prepared.driver).start);
    const std::vector<Slip> here = slips_between(force, prepared.rests);
    slips.insert(slips.end(), here.begin(), here.end());
  }
  return slips;
}

VectorXd ValveFitProblem::let_go(VectorXd v) {
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    std::vector<double>& rests = prepared_[r].rests;
    const double breakaway = blocks_of(v, r).friction.breakaway_a;
    if (!rests.empty() && std::isfinite(rests[0]) && breakaway > 0) {
      v(own_at(r) + kMemory) = (prepared_[r].input.start[0] - rests[0]) / breakaway;
    }
    rests.clear();
    prepared_[r].half_rests.clear();
    prepared_[r].inverse_variance = 1 / prepared_[r].noise_variance;
  }
  return clamped(std::move(v));
}

StaticMap ValveFitProblem::map_of(const VectorXd& v) const {
  const double* first = v.data() + kParameters;
  return curve_.through(std::vector<double>(first, first + knots_));
}

Index ValveFitProblem::law_entry(std::size_t law, std::size_t parameter, std::size_t recording) const {
  const std::size_t shared = options_.laws[law].shared();
  if (parameter < shared) return law_at_[law] + static_cast<Index>(parameter);
  return own_at(recording) + law_own_at_[law] + static_cast<Index>(parameter - shared);
}

std::vector<double> ValveFitProblem::law_parameters(const VectorXd& v, std::size_t law, std::size_t recording) const {
  std::vector<double> parameters;
  for (std::size_t j = 0; j < options_.laws[law].law->parameters.size(); ++j) {
    parameters.push_back(v(law_entry(law, j, recording)));
  }
  return parameters;
}

LawContext ValveFitProblem::context(const VectorXd& v, std::size_t recording, Place place) const {
  const Prepared& prepared = prepared_[recording];
  const double lowest = v(kParameters), highest = v(kParameters + knots_ - 1);
  const bool is_ahead = place != Place::kOutput && place != Place::kReading;
  return {.time_s = place == Place::kInput ? prepared.ends_s
                    : is_ahead             ? prepared.half_time_s
                                           : prepared.time_s,
          .output_range = highest - lowest,
          .driver = place == Place::kInput ? std::span<const double>(prepared.ends_driver) : std::span<const double>{},
          .side = prepared.recording->side,
          .recording = recording,
          .input = is_ahead ? prepared.input.start : prepared.recording->input.values,
          .input_middle = 0.5 * (options_.knots.front() + options_.knots.back()),
          .rest_input = options_.knots.front(),
          .secant = (highest - lowest) / (options_.knots.back() - options_.knots.front()),
          .measured = is_ahead ? std::span<const double>{} : prepared.recording->output.values,
          .noise_rms = std::sqrt(prepared.noise_variance)};
}

ValveFitProblem::Blocks ValveFitProblem::blocks_of(const VectorXd& v, std::size_t recording, std::size_t laws) const {
  Blocks blocks{.valve = to_parameters(v.head(kParameters), options_.reference_psi, options_.usual)};
  blocks.valve.volume.highest_psi = v(kParameters + knots_ - 1);
  blocks.friction.growth.middle_a = 0.5 * (options_.knots.front() + options_.knots.back());
  for (std::size_t l = 0; l < laws; ++l) {
    const LawInFit& law = options_.laws[l];
    if (!law.law->reshape || !acts(law, recording)) continue;
    law.law->reshape(law_parameters(v, l, recording), {blocks.valve.spool, blocks.valve.volume, blocks.friction});
  }
  return blocks;
}

void ValveFitProblem::apply_laws(Place place, const VectorXd& v, std::size_t recording, std::span<const double> steady,
                                 std::vector<double>& signal, std::vector<std::vector<double>>* before) const {
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    if (!acts_at(law, place, recording)) continue;
    if (before) before->push_back(signal);
    LawContext seen = context(v, recording, place);
    seen.steady = steady;
    law.law->apply(law_parameters(v, l, recording), seen, signal);
  }
}

void ValveFitProblem::read_off(const VectorXd& v, std::size_t recording, std::span<const double> steady,
                               std::vector<double>& pressure, std::vector<std::vector<double>>* before) const {
  apply_laws(Place::kOutput, v, recording, steady, pressure, before);
  apply_laws(Place::kReading, v, recording, steady, pressure, nullptr);
}

IntervalSignal ValveFitProblem::behind_input_laws(const VectorXd& v, std::size_t recording) const {
  const Prepared& prepared = prepared_[recording];
  std::vector<double> signal;
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    if (!acts_at(law, Place::kInput, recording)) continue;
    if (signal.empty()) signal = interleaved(prepared.input);
    law.law->apply(law_parameters(v, l, recording), context(v, recording, Place::kInput), signal);
  }
  return signal.empty() ? prepared.input : intervals(signal);
}

std::vector<std::vector<double>> ValveFitProblem::positions(std::span<const RunAt> at) const {
  std::vector<Blocks> blocks;
  std::vector<IntervalSignal> forces;
  std::vector<std::size_t> force_of;  // place in `forces`
  std::vector<std::vector<double>> positions(at.size());
  for (std::size_t k = 0; k < at.size(); ++k) {
    const auto& [v, recording] = at[k];
    const Prepared& prepared = prepared_[recording];
    positions[k].resize(prepared.input.start.size());
    blocks.push_back(blocks_of(*v, recording));
    const MagneticLoop loop = loop_of(blocks.back().valve, options_.usual, (*v)(own_at(recording) + kMemory));
    const bool is_moved =
        std::any_of(options_.laws.begin(), options_.laws.end(),
                    [&, r = recording](const LawInFit& law) { return acts_at(law, Place::kInput, r); });
    // What moves the spool alone leaves the force as it is.
    const auto has_its_force = [&, r = recording](std::size_t other) {
      const ValveParameters &a = blocks[k].valve, &b = blocks[other].valve;
      return !is_moved && at[other].recording == r && a.loop_width_a == b.loop_width_a &&
             a.narrow_loop_width_a == b.narrow_loop_width_a && (*at[other].v)(own_at(r) + kMemory) == loop.memory;
    };
    std::size_t same = 0;
    while (same < k && !has_its_force(same)) ++same;
    force_of.push_back(same < k ? force_of[same] : forces.size());
    if (same < k) continue;
    const IntervalSignal moved = is_moved ? behind_input_laws(*v, recording) : IntervalSignal{};
    forces.push_back(is_moved ? loop.apply(moved, loop_driver(moved, prepared.gate))
                              : loop.apply(prepared.input, prepared.driver));
  }
  // A mode behind the map has the delay (ahead_of_volume).
  for (Blocks& of_run : blocks) of_run.valve.spool.delay_s *= of_run.valve.mode ? 0 : 1;
  std::vector<SlidingRun> sliding;
  for (std::size_t k = 0; k < at.size(); ++k) {
    const auto& [v, recording] = at[k];
    const ValveDynamics& spool = blocks[k].valve.spool;
    if (!(blocks[k].friction.breakaway_a > 0)) continue;
    sliding.push_back({&spool, &blocks[k].friction, half_period_s(recording), &forces[force_of[k]],
                       (*v)(own_at(recording) + kMemory), positions[k], prepared_[recording].half_rests});
  }
  run_sliding_spools(sliding);
  for (std::size_t k = 0; k < at.size(); ++k) {
    const auto& [v, recording] = at[k];
    const IntervalSignal& force = forces[force_of[k]];
    if (blocks[k].valve.mode && !is_slowed_ahead_of_map(blocks[k])) {
      std::copy_n(force.start.begin(), positions[k].size(), positions[k].begin());
    } else {
      const SampledValveDynamics spool(blocks[k].valve.spool, half_period_s(recording));
      if (!(blocks[k].friction.breakaway_a > 0)) spool.run(force, positions[k]);
      const auto start = v->segment<kStarts>(own_at(recording));
      if (!blocks[k].valve.mode) add_return(spool, start(kSpoolRate), start(kSpoolPosition), positions[k]);
    }
    apply_laws(Place::kPosition, *v, recording, {}, positions[k], nullptr);
  }
  return positions;
}

SampledMode ValveFitProblem::mode_of(const Blocks& blocks, std::size_t recording) const {
  const ValveParameters& valve = blocks.valve;
  const double period_s = half_period_s(recording);
  return {delayed_mode(*valve.mode, valve.spool, is_slowed_ahead_of_map(blocks), period_s),
          valve.volume.fall_to_rise_ratio, period_s};
}

std::vector<bool> ValveFitProblem::held_halves(const Blocks& blocks, const VectorXd& v, std::size_t recording) const {
  const IntervalSignal& input = prepared_[recording].input;
  if (is_slowed_ahead_of_map(blocks)) return std::vector<bool>(input.start.size());
  const bool is_moved = std::any_of(options_.laws.begin(), options_.laws.end(),
                                    [&](const LawInFit& law) { return acts_at(law, Place::kInput, recording); });
  return is_moved ? held_intervals(behind_input_laws(v, recording)) : held_intervals(input);
}

ValveFitProblem::Filling ValveFitProblem::ahead_of_volume(const Blocks& blocks, const VectorXd& v,
                                                          std::size_t recording,
                                                          const std::vector<double>& steady) const {
  const Index own = own_at(recording);
  const SampledMode::Start start{mean_slope_psi_per_a_ * v(own + kSpoolRate),
                                 mean_slope_psi_per_a_ * v(own + kSpoolPosition)};
  Filling filling{std::vector<double>(steady.size()), {}};
  std::vector<double> asked = steady;
  for (double& psi : asked) psi = std::min(psi, blocks.valve.volume.stop_psi);
  filling.way = mode_of(blocks, recording)
                    .run(held_or_straight(std::move(asked), held_halves(blocks, v, recording)), start, filling.psi);
  return filling;
}

std::vector<ValveFitProblem::Run> ValveFitProblem::runs(const VectorXd& v, std::span<const std::size_t> recordings,
                                                        bool tangents) const {
  const StaticMap map = map_of(v);
  std::vector<Run> runs(recordings.size());
  std::vector<OrificeVolume> volumes;
  std::vector<RunAt> at;
  for (const std::size_t r : recordings) at.push_back({&v, r});
  std::vector<std::vector<double>> moved = positions(at);
  for (std::size_t k = 0; k < runs.size(); ++k) {
    Run& run = runs[k];
    run.position = std::move(moved[k]);
    run.mapped = run.position;
    map.apply(run.mapped);
    run.steady = run.mapped;
    apply_laws(Place::kSteady, v, recordings[k], run.mapped, run.steady, nullptr);
    const Blocks blocks = blocks_of(v, recordings[k]);
    volumes.push_back(volume_behind(blocks.valve));
    if (blocks.valve.mode) run.filling = ahead_of_volume(blocks, v, recordings[k], run.steady);
  }
  std::vector<VolumeRun> through;
  for (std::size_t k = 0; k < runs.size(); ++k) {
    runs[k].asked = at_samples(runs[k].steady);
    runs[k].pressure.resize(runs[k].asked.size());
    through.push_back(
        volume_run(v, recordings[k], volumes[k], into_volume(runs[k].steady, runs[k].filling.psi), runs[k].pressure));
    if (tangents) through.back().tangent = &runs[k].tangent;
  }
  run_volumes(through);
  for (std::size_t k = 0; k < runs.size(); ++k) {
    Run& run = runs[k];
    read_behind_lag(options_.usual.gauge_lag_s, period_s(recordings[k]), run.pressure);
    run.output = run.pressure;
    read_off(v, recordings[k], run.asked, run.output, tangents ? &run.before_output : nullptr);
  }
  return runs;
}

VolumeRun ValveFitProblem::volume_run(const VectorXd& v, std::size_t recording, const OrificeVolume& volume,
                                      std::span<const double> filling, std::span<double> pressure) const {
  return {&volume, period_s(recording), filling.front() + v(own_at(recording) + kPressureGap), filling, pressure};
}

ValveFitProblem::Run ValveFitProblem::run(const VectorXd& v, std::size_t recording, bool tangents) const {
  return std::move(runs(v, {&recording, 1}, tangents).front());
}

std::vector<ValveFitProblem::Run> ValveFitProblem::all_runs(const VectorXd& v) const {
  std::vector<std::size_t> all(prepared_.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return runs(v, all, false);
}

std::vector<double> ValveFitProblem::simulate(const VectorXd& v, std::size_t recording) const {
  return std::move(run(v, recording, false).output);
}

std::vector<std::vector<double>> ValveFitProblem::simulate_behind_last(const VectorXd& v,
                                                                       std::span<const std::size_t> recordings,
                                                                       std::span<const Run> without_last) const {
  const std::size_t last = options_.laws.size() - 1;
  const LawInFit& law = options_.laws[last];
  const auto with_law = [&](Place place, std::size_t r, const std::vector<double>& signal,
                            const std::vector<double>& steady) {
    std::vector<double> changed = signal;
    LawContext seen = context(v, r, place);
    seen.steady = steady;
    law.law->apply(law_parameters(v, last, r), seen, changed);
    return changed;
  };
  std::vector<std::vector<double>> outputs(recordings.size());
  std::vector<std::size_t> whole, behind_map;  // places in `recordings`
  const StaticMap map = map_of(v);
  std::vector<std::vector<double>> steady(recordings.size()), filling(recordings.size());
  std::vector<OrificeVolume> volumes(recordings.size());
  for (std::size_t k = 0; k < recordings.size(); ++k) {
    const std::size_t r = recordings[k];
    const Run& before_law = without_last[r];
    const Blocks blocks = blocks_of(v, r), before = blocks_of(v, r, last);
    const bool is_behind_spool = acts_at(law, Place::kPosition, r), is_behind_map = acts_at(law, Place::kSteady, r);
    if (acts_at(law, Place::kInput, r) || !(blocks.valve.spool == before.valve.spool) ||
        !(blocks.friction == before.friction)) {
      whole.push_back(k);
    } else if (is_behind_spool || is_behind_map || !(blocks.valve.volume == before.valve.volume)) {
      behind_map.push_back(k);
      volumes[k] = volume_behind(blocks.valve);
      if (is_behind_spool) {
        std::vector<double> mapped = with_law(Place::kPosition, r, before_law.position, {});
        map.apply(mapped);
        steady[k] = mapped;
        apply_laws(Place::kSteady, v, r, mapped, steady[k], nullptr);
      } else {
        steady[k] =
            is_behind_map ? with_law(Place::kSteady, r, before_law.steady, before_law.mapped) : before_law.steady;
      }
      if (blocks.valve.mode) filling[k] = ahead_of_volume(blocks, v, r, steady[k]).psi;
    } else {
      outputs[k] = before_law.output;
      if (acts_at(law, Place::kReading, r)) {
        outputs[k] = with_law(Place::kReading, r, before_law.output, before_law.asked);
      } else if (acts_at(law, Place::kOutput, r)) {
        outputs[k] = before_law.pressure;
        read_off(v, r, before_law.asked, outputs[k], nullptr);
      }
    }
  }
  if (!whole.empty()) {
    std::vector<std::size_t> chosen;
    for (const std::size_t k : whole) chosen.push_back(recordings[k]);
    std::vector<Run> runs_of_them = runs(v, chosen, false);
    for (std::size_t i = 0; i < whole.size(); ++i) outputs[whole[i]] = std::move(runs_of_them[i].output);
  }
  std::vector<VolumeRun> through;
  for (const std::size_t k : behind_map) {
    outputs[k].resize(prepared_[recordings[k]].recording->samples());
    through.push_back(volume_run(v, recordings[k], volumes[k], into_volume(steady[k], filling[k]), outputs[k]));
  }
  run_volumes(through);
  for (const std::size_t k : behind_map) {
    read_behind_lag(options_.usual.gauge_lag_s, period_s(recordings[k]), outputs[k]);
    read_off(v, recordings[k], at_samples(steady[k]), outputs[k], nullptr);
  }
  return outputs;
}

double ValveFitProblem::squared_error(std::size_t recording, const std::vector<double>& simulated) const {
  const Recording& measured = *prepared_[recording].recording;
  double squares = 0;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    if (!measured.is_valid(i)) continue;
    const double e = measured.output.values[i] - simulated[i];
    squares += e * e;
  }
  return squares;
}

double ValveFitProblem::usual_slope(double input) const {
  const double span = options_.knots.back() - options_.knots.front();
  if (!options_.prior) return 2 * options_.reference_psi / span;
  const VectorXd outputs = options_.prior->mean.tail(knots_);
  return curve_.rising_through({outputs.data(), outputs.data() + knots_}).slope(input);
}

double ValveFitProblem::weighed_error(std::size_t recording, const std::vector<double>& simulated) const {
  const Prepared& prepared = prepared_[recording];
  double squares = squared_error(recording, simulated);
  for (const CoarseRest& rest : prepared.coarse_rests) {
    double sum = 0, samples = 0;
    for (std::size_t i = rest.begin; i < rest.end; ++i) {
      if (!prepared.recording->is_valid(i)) continue;
      sum += prepared.recording->output.values[i] - simulated[i];
      samples += 1;
    }
    const double of_noise = rest.variance * prepared.inverse_variance;
    squares -= of_noise / (1 + samples * of_noise) * sum * sum;
  }
  return squares * prepared.inverse_variance;
}

void ValveFitProblem::whiten(std::size_t recording, std::span<const std::size_t> samples,
                             Eigen::Ref<VectorXd> outputs) const {
  const Prepared& prepared = prepared_[recording];
  outputs *= std::sqrt(prepared.inverse_variance);
  auto first = samples.begin();
  for (const CoarseRest& rest : prepared.coarse_rests) {
    first = std::lower_bound(first, samples.end(), rest.begin);
    const auto last = std::lower_bound(first, samples.end(), rest.end);
    const auto count = static_cast<Index>(last - first);
    if (count == 0) continue;
    const double told = static_cast<double>(count) * rest.variance * prepared.inverse_variance;
    auto here = outputs.segment(first - samples.begin(), count);
    here.array() -= (1 - 1 / std::sqrt(1 + told)) * here.mean();
  }
}

double ValveFitProblem::cost(const VectorXd& v, std::span<const Run> at_v) const {
  double sum = penalty(v);
  for (std::size_t r = 0; r < prepared_.size(); ++r) sum += weighed_error(r, at_v[r].output);
  return sum;
}

double ValveFitProblem::scale_free_cost(const VectorXd& v) const {
  const std::vector<Run> at_v = all_runs(v);
  double sum = 0;
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    const double samples = static_cast<double>(prepared_[r].recording->valid_samples());
    if (samples == 0) continue;
    sum += samples * std::log(prepared_[r].noise_variance + squared_error(r, at_v[r].output) / samples);
  }
  return sum;
}

double ValveFitProblem::penalty(const VectorXd& v) const {
  const VectorXd d = v.head(baseline_size()) - mean_;
  double sum = d.dot(precision_ * d);
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    const auto s = v.segment<kStarts>(own_at(r));
    sum += (s(kSpoolRate) * s(kSpoolRate) + s(kSpoolPosition) * s(kSpoolPosition)) /
               (spool_start_sd_a_ * spool_start_sd_a_) +
           std::pow(s(kPressureGap) / pressure_start_sd_psi_, 2) + std::pow(s(kMemory) / kMemorySd, 2);
  }
  return sum;
}

void ValveFitProblem::add_penalty(const VectorXd& v, Normal& normal) const {
  // What is not varied, or not seen by any sample, stays where it is.
  for (Index j = baseline_size(); j < shared(); ++j) normal.a(j, j) += normal.a(j, j) > 0 ? 0.0 : 1.0;
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    for (Index j = own_at(r) + kStarts; j < own_at(r) + own_; ++j) normal.a(j, j) += normal.a(j, j) > 0 ? 0.0 : 1.0;
  }
  const Index shared_baseline = baseline_size();
  normal.a.topLeftCorner(shared_baseline, shared_baseline) += precision_;
  normal.b.head(shared_baseline) -= precision_ * (v.head(shared_baseline) - mean_);
  const double weights[kStarts] = {1 / (spool_start_sd_a_ * spool_start_sd_a_),
                                   1 / (spool_start_sd_a_ * spool_start_sd_a_),
                                   1 / (pressure_start_sd_psi_ * pressure_start_sd_psi_), 1 / (kMemorySd * kMemorySd)};
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    for (Index s = 0; s < kStarts; ++s) {
      const Index at = own_at(r) + s;
      normal.a(at, at) += weights[s];
      normal.b(at) -= weights[s] * v(at);
    }
  }
}

/// Sensitivities at one recording: a difference up to the block that a parameter changes, from
/// there on the tangents of the blocks behind it.
class ValveFitProblem::Columns {
 public:
  Columns(const ValveFitProblem& problem, const VectorXd& v, std::size_t recording)
      : problem_(problem),
        v_(v),
        recording_(recording),
        base_(problem.run(v, recording, true)),
        used_(static_cast<std::size_t>(problem.knots_), false),
        blocks_(problem.blocks_of(v, recording)) {
    if (blocks_.valve.mode) {
      mode_.emplace(problem.mode_of(blocks_, recording));
      held_ = problem.held_halves(blocks_, v, recording);
    }
    const StaticMap map = problem.map_of(v);
    for (const double x : base_.position) {
      slope_.push_back(map.slope(x));
      shares_.push_back(problem.curve_.share_at(x));
      const std::size_t first = shares_.back().first;
      for (std::size_t k = first; k < std::min(first + shares_.back().weight.size(), used_.size()); ++k)
        used_[k] = true;
    }
    has_steady_laws_ = base_.steady != base_.mapped;
    if (!has_steady_laws_) return;
    steady_gain_.assign(base_.mapped.size(), 1.0);
    std::vector<double> before = base_.mapped;
    for (std::size_t l = 0; l < problem.options_.laws.size(); ++l) {
      const LawInFit& law = problem.options_.laws[l];
      if (!problem.acts_at(law, Place::kSteady, recording)) continue;
      LawContext seen = problem.context(v, recording, Place::kSteady);
      seen.steady = base_.mapped;
      const std::vector<double> parameters = problem.law_parameters(v, l, recording);
      if (law.law->tangent) law.law->tangent(parameters, seen, before, steady_gain_);
      law.law->apply(parameters, seen, before);
    }
  }

  const Run& base() const { return base_; }

  /// An entry of the vector and how far it is moved for a difference.
  struct Move {
    Index entry = 0;
    double step = 0;
  };

  /// ∂output / ∂v(entry) of each; what has to be run again runs side by side.
  std::vector<std::vector<double>> of(const std::vector<Move>& moves) const {
    std::vector<std::vector<double>> changes(moves.size());
    std::vector<VectorXd> moved(moves.size(), v_);
    std::vector<std::size_t> spools, volumes;  // places in `moves`
    for (std::size_t k = 0; k < moves.size(); ++k) {
      const auto [entry, step] = moves[k];
      const Index own_entry = entry - problem_.own_at(recording_);
      moved[k](entry) += step;
      if (own_entry == kPressureGap) {
        changes[k] = gap_change();
      } else if ((own_entry == kSpoolRate || own_entry == kSpoolPosition) && mode_) {
        changes[k] = mode_start_change(own_entry);
      } else if ((own_entry == kSpoolRate || own_entry == kSpoolPosition) && !has_position_laws()) {
        changes[k] = spool_start_change(own_entry);
      } else if (in_two_places(entry)) {
        changes[k] = whole_change(moved[k], step);
      } else {
        const Blocks &here = blocks_, there = problem_.blocks_of(moved[k], recording_);
        const bool is_mode =
            mode_ && (here.valve.mode != there.valve.mode || here.valve.spool.delay_s != there.valve.spool.delay_s ||
                      here.valve.volume.stop_psi != there.valve.volume.stop_psi ||
                      here.valve.volume.fall_to_rise_ratio != there.valve.volume.fall_to_rise_ratio);
        if (mode_ && is_slowed_ahead_of_map(here) != is_slowed_ahead_of_map(there)) {
          changes[k] = whole_change(moved[k], step);
        } else if (is_mode) {
          changes[k] = mode_change(there, moved[k], step);
        } else if (moves_position(entry) || here.valve.loop_width_a != there.valve.loop_width_a ||
                   here.valve.narrow_loop_width_a != there.valve.narrow_loop_width_a ||
                   !(here.valve.spool == there.valve.spool) || !(here.friction == there.friction)) {
          spools.push_back(k);
        } else if (!(here.valve.volume == there.valve.volume)) {
          volumes.push_back(k);
        } else {
          changes[k] = behind_map(moved[k], step);
        }
      }
    }
    change_positions(moves, moved, spools, changes);
    change_volumes(moves, moved, volumes, changes);
    return changes;
  }

  /// ∂output / ∂knot of every knot that takes part, given to `keep` with the knot's number.
  template <typename Keep>
  void of_knots(const Keep& keep) const {
    for (Index first = 0; first < problem_.knots_; first += kAbreast) {
      std::vector<Index> used;
      for (Index k = first; k < std::min(first + kAbreast, problem_.knots_); ++k) {
        if (used_[static_cast<std::size_t>(k)]) used.push_back(k);
      }
      if (used.empty()) continue;
      if (mode_) {
        for (const Index knot : used) keep(knot, behind_mode_of_knot(knot));
        continue;
      }
      const std::vector<Abreast> abreast = pressures_of_knots(first);
      for (const Index knot : used) {
        std::vector<double> change;
        change.reserve(abreast.size());
        for (const Abreast& at : abreast) change.push_back(at(knot - first));
        problem_.output_tangents(v_, recording_, base_, change);
        keep(knot, change);
      }
    }
  }

 private:
  // Each sample of a sensitivity waits for the one before: several abreast keep a processor busy.
  static constexpr Index kAbreast = 4;
  using Abreast = Eigen::Array<double, kAbreast, 1>;

  /// ∂output / ∂knot where a mode takes each change for itself.
  std::vector<double> behind_mode_of_knot(Index knot) const {
    std::vector<double> change(shares_.size(), 0.0);
    for (std::size_t i = 0; i < change.size(); ++i) {
      const Index at = knot - static_cast<Index>(shares_[i].first);
      if (at >= 0 && at < static_cast<Index>(shares_[i].weight.size())) {
        change[i] = shares_[i].weight[static_cast<std::size_t>(at)];
      }
    }
    carry_steady(change);
    return change;
  }

  /// ∂pressure / ∂knot of neighbouring knots as the gauge shows it, a value of each per sample.
  std::vector<Abreast> pressures_of_knots(Index first) const {
    return behind_volume<Abreast>([&](std::size_t i) {
      Abreast change = Abreast::Zero();
      const KnotCurve::Share& share = shares_[i];
      for (std::size_t k = 0; k < share.weight.size(); ++k) {
        const auto at = static_cast<Index>(share.first + k) - first;
        if (at >= 0 && at < kAbreast) change(at) = share.weight[k];
      }
      if (has_steady_laws_) change *= steady_gain_[i];
      return change;
    });
  }

  /// Changes of the steady pressure, two a sample, carried through the volume and the gauge.
  template <typename Value, typename Steady>
  std::vector<Value> behind_volume(const Steady& steady) const {
    const VolumeTangent& tangent = base_.tangent;
    const std::size_t samples = tangent.keep.size();
    std::vector<Value> pressures;
    if (samples == 0) return pressures;
    pressures.reserve(samples);
    Value begin = steady(0), p = begin;  // the volume starts at its steady pressure
    for (std::size_t i = 0; i < samples; ++i) {
      const Value middle = steady(2 * i + 1), end = i + 1 < samples ? steady(2 * i + 2) : middle;
      pressures.push_back(p);
      p = tangent.keep[i] * p + tangent.begin[i] * begin + tangent.middle[i] * middle + tangent.end[i] * end;
      begin = end;
    }
    if (const double lag_s = problem_.options_.usual.gauge_lag_s; lag_s > 0) {
      GaugeLag<Value> lag(lag_s, period_s(), pressures.front());
      for (Value& at : std::span(pressures).subspan(1)) at = lag.next(at);
    }
    return pressures;
  }

  bool moves_position(Index entry) const {
    const Index own = problem_.own_at(recording_);
    if (entry >= own && entry < own + kStarts && entry != own + kPressureGap) return true;
    for (std::size_t l = 0; l < problem_.options_.laws.size(); ++l) {
      const LawInFit& law = problem_.options_.laws[l];
      if (law.law->place != Place::kInput && law.law->place != Place::kPosition) continue;
      if (owns(l, law, entry)) return true;
    }
    return false;
  }
  /// A law that acts on a signal and on the valve's blocks has no one place to start from.
  bool in_two_places(Index entry) const {
    for (std::size_t l = 0; l < problem_.options_.laws.size(); ++l) {
      const LawInFit& law = problem_.options_.laws[l];
      if (law.law->apply && law.law->reshape && !law.acts_in_blocks_alone() && owns(l, law, entry)) return true;
    }
    return false;
  }
  std::vector<double> whole_change(const VectorXd& w, double step) const {
    std::vector<double> moved = problem_.simulate(w, recording_);
    for (std::size_t i = 0; i < moved.size(); ++i) moved[i] = (moved[i] - base_.output[i]) / step;
    return moved;
  }
  bool owns(std::size_t l, const LawInFit& law, Index entry) const {
    const Index shared = problem_.law_at_[l], own = problem_.own_at(recording_) + problem_.law_own_at_[l];
    return (entry >= shared && entry < shared + static_cast<Index>(law.shared())) ||
           (entry >= own && entry < own + static_cast<Index>(law.own()));
  }

  bool has_position_laws() const {
    return std::any_of(problem_.options_.laws.begin(), problem_.options_.laws.end(),
                       [&](const LawInFit& law) { return problem_.acts_at(law, Place::kPosition, recording_); });
  }

  /// The spool's own return from a start off its rest, which nothing before the map changes.
  std::vector<double> spool_start_change(Index state) const {
    const SampledValveDynamics spool(blocks_.valve.spool, problem_.half_period_s(recording_));
    std::vector<double> change(base_.position.size(), 0.0);
    add_return(spool, state == kSpoolRate ? 1 : 0, state == kSpoolRate ? 0 : 1, change);
    for (std::size_t i = 0; i < change.size(); ++i) change[i] *= slope_[i];
    carry_steady(change);
    return change;
  }

  /// The mode's own return from a start off its rest.
  std::vector<double> mode_start_change(Index state) const {
    std::vector<double> change(base_.filling.psi.size(), 0.0);
    const double psi = problem_.mean_slope_psi_per_a_;
    const SampledMode::Start start{state == kSpoolRate ? psi : 0, state == kSpoolPosition ? psi : 0};
    mode_->run_along(base_.filling.way, {change, change}, start, change);
    carry_volume(change);
    problem_.output_tangents(v_, recording_, base_, change);
    return change;
  }

  /// Another mode behind the same volume.
  std::vector<double> mode_change(const Blocks& there, const VectorXd& w, double step) const {
    const std::vector<double> filling = problem_.ahead_of_volume(there, w, recording_, base_.steady).psi;
    std::vector<double> change(base_.pressure.size());
    const OrificeVolume volume = volume_behind(there.valve);
    const VolumeRun through = problem_.volume_run(w, recording_, volume, filling, change);
    run_volumes({&through, 1});
    as_slope(step, change);
    return change;
  }

  /// From another pressure in the volume to the slope of the output.
  void as_slope(double step, std::vector<double>& pressure) const {
    read_behind_lag(problem_.options_.usual.gauge_lag_s, period_s(), pressure);
    for (std::size_t i = 0; i < pressure.size(); ++i) pressure[i] = (pressure[i] - base_.pressure[i]) / step;
    problem_.output_tangents(v_, recording_, base_, pressure);
  }

  /// A volume that starts off its steady pressure returns as its tangent does.
  std::vector<double> gap_change() const {
    std::vector<double> change(base_.pressure.size());
    double p = 1;
    for (std::size_t i = 0; i < change.size(); ++i) {
      change[i] = p;
      p *= base_.tangent.keep[i];
    }
    read_behind_lag(problem_.options_.usual.gauge_lag_s, period_s(), change);
    problem_.output_tangents(v_, recording_, base_, change);
    return change;
  }

  void change_positions(const std::vector<Move>& moves, const std::vector<VectorXd>& moved,
                        const std::vector<std::size_t>& which, std::vector<std::vector<double>>& changes) const {
    std::vector<RunAt> at;
    for (const std::size_t k : which) at.push_back({&moved[k], recording_});
    std::vector<std::vector<double>> positions = problem_.positions(at);
    for (std::size_t n = 0; n < which.size(); ++n) {
      std::vector<double>& change = changes[which[n]] = std::move(positions[n]);
      for (std::size_t i = 0; i < change.size(); ++i) {
        change[i] = slope_[i] * (change[i] - base_.position[i]) / moves[which[n]].step;
      }
      carry_steady(change);
    }
  }

  void change_volumes(const std::vector<Move>& moves, const std::vector<VectorXd>& moved,
                      const std::vector<std::size_t>& which, std::vector<std::vector<double>>& changes) const {
    std::vector<OrificeVolume> volumes;
    for (const std::size_t k : which) volumes.push_back(volume_behind(problem_.blocks_of(moved[k], recording_).valve));
    std::vector<VolumeRun> through;
    for (std::size_t n = 0; n < which.size(); ++n) {
      std::vector<double>& change = changes[which[n]];
      change.resize(base_.pressure.size());
      through.push_back(problem_.volume_run(moved[which[n]], recording_, volumes[n],
                                            into_volume(base_.steady, base_.filling.psi), change));
    }
    run_volumes(through);
    for (const std::size_t k : which) as_slope(moves[k].step, changes[k]);
  }

  /// A parameter of a law behind the map.
  std::vector<double> behind_map(const VectorXd& w, double step) const {
    std::vector<double> steady = base_.mapped;
    problem_.apply_laws(Place::kSteady, w, recording_, base_.mapped, steady, nullptr);
    if (steady != base_.steady) {
      for (std::size_t i = 0; i < steady.size(); ++i) steady[i] = (steady[i] - base_.steady[i]) / step;
      carry_mode(steady);
      carry_volume(steady);
      problem_.output_tangents(v_, recording_, base_, steady);
      return steady;
    }
    std::vector<double> output = base_.pressure;
    problem_.read_off(w, recording_, base_.asked, output, nullptr);
    for (std::size_t i = 0; i < output.size(); ++i) output[i] = (output[i] - base_.output[i]) / step;
    return output;
  }

  void carry_steady(std::vector<double>& change) const {
    if (has_steady_laws_) {
      for (std::size_t i = 0; i < change.size(); ++i) change[i] *= steady_gain_[i];
    }
    carry_mode(change);
    carry_volume(change);
    problem_.output_tangents(v_, recording_, base_, change);
  }

  /// A change of the steady pressure as the mode hands it on.
  void carry_mode(std::vector<double>& change) const {
    if (!mode_) return;
    for (std::size_t i = 0; i < change.size(); ++i) change[i] *= base_.steady[i] < blocks_.valve.volume.stop_psi;
    mode_->run_along(base_.filling.way, held_or_straight(change, held_), {}, change);
  }

  void carry_volume(std::vector<double>& change) const {
    change = behind_volume<double>([&](std::size_t i) { return change[i]; });
  }

  double period_s() const { return problem_.period_s(recording_); }

  const ValveFitProblem& problem_;
  const VectorXd& v_;
  std::size_t recording_;
  Run base_;
  std::vector<double> slope_, steady_gain_;
  std::vector<KnotCurve::Share> shares_;  ///< of the knots in the map at each sample
  std::vector<bool> used_;                ///< which knots have any
  bool has_steady_laws_ = false;
  Blocks blocks_;
  std::optional<SampledMode> mode_;  ///< behind the map
  std::vector<bool> held_;           ///< in which halves of samples what enters it is
};

void ValveFitProblem::output_tangents(const VectorXd& v, std::size_t recording, const Run& base,
                                      std::vector<double>& change) const {
  std::size_t stage = 0;
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    if (!acts_at(law, Place::kOutput, recording)) continue;
    LawContext seen = context(v, recording, Place::kOutput);
    seen.steady = base.asked;
    if (law.law->tangent) {
      law.law->tangent(law_parameters(v, l, recording), seen, base.before_output[stage], change);
    }
    ++stage;
  }
}

ValveFitProblem::Rows ValveFitProblem::rows(const VectorXd& v, std::size_t recording, double width) const {
  const Recording& measured = *prepared_[recording].recording;
  const Columns columns(*this, v, recording);
  Rows rows;
  for (std::size_t i = 0; i < measured.samples(); ++i) {
    if (measured.is_valid(i)) rows.sample.push_back(i);
  }
  const auto count = static_cast<Index>(rows.sample.size());
  MatrixXd jacobian = MatrixXd::Zero(count, shared() + own_);
  rows.error.resize(count);
  const auto keep = [&](Index column, const std::vector<double>& change) {
    for (Index i = 0; i < count; ++i) jacobian(i, column) = change[rows.sample[static_cast<std::size_t>(i)]];
    whiten(recording, rows.sample, jacobian.col(column));
  };
  for (Index i = 0; i < count; ++i) {
    const std::size_t at = rows.sample[static_cast<std::size_t>(i)];
    rows.error(i) = measured.output.values[at] - columns.base().output[at];
  }
  whiten(recording, rows.sample, rows.error);
  const auto inward = [&](double at, double step, double upper) { return at + step > upper ? -step : step; };
  std::vector<Columns::Move> moves;
  std::vector<Index> column_of;
  for (Index j = 0; j < kParameters; ++j) {
    moves.push_back({j, inward(v(j), width * step_(j), upper_(j))});
    column_of.push_back(j);
  }
  const Index own = own_at(recording);
  const double memory_step = 0.01 * width;
  const double spool_step_a = 1e-5 * options_.usual.current_scale * width;
  const double start_step[kStarts] = {spool_step_a, spool_step_a, 1e-3 * width,
                                      v(own + kMemory) > 0 ? -memory_step : memory_step};
  for (Index s = 0; s < kStarts; ++s) {
    moves.push_back({own + s, start_step[s]});
    column_of.push_back(shared() + s);
  }
  for (std::size_t l = 0; l < options_.laws.size(); ++l) {
    const LawInFit& law = options_.laws[l];
    if (!acts(law, recording)) continue;
    for (std::size_t j = 0; j < law.law->parameters.size(); ++j) {
      const bool is_shared = j < law.shared();
      const auto offset = static_cast<Index>(is_shared ? j : j - law.shared());
      const Index entry = is_shared ? law_at_[l] + offset : own + law_own_at_[l] + offset;
      if (law.step[j] == 0) continue;  // a whole number: searched, not varied
      moves.push_back({entry, inward(v(entry), width * law.step[j], law.upper[j])});
      column_of.push_back(is_shared ? entry : shared() + law_own_at_[l] + offset);
    }
  }
  const std::vector<std::vector<double>> changes = columns.of(moves);
  for (std::size_t k = 0; k < moves.size(); ++k) keep(column_of[k], changes[k]);
  columns.of_knots([&](Index knot, const std::vector<double>& change) { keep(kParameters + knot, change); });
  rows.jacobian = BlockedColumns(std::move(jacobian));
  return rows;
}

void ValveFitProblem::accumulate(const Rows& rows, Index first, Index count, std::size_t recording,
                                 Normal& normal) const {
  if (count == 0) return;
  const MatrixXd a = rows.jacobian.gram(first, count);
  const VectorXd b = rows.jacobian.transposed_times(first, rows.error.segment(first, count));
  const Index own = own_at(recording);
  normal.a.topLeftCorner(shared(), shared()) += a.topLeftCorner(shared(), shared());
  normal.a.block(own, 0, own_, shared()) += a.bottomLeftCorner(own_, shared());
  normal.a.block(0, own, shared(), own_) += a.topRightCorner(shared(), own_);
  normal.a.block(own, own, own_, own_) += a.bottomRightCorner(own_, own_);
  normal.b.head(shared()) += b.head(shared());
  normal.b.segment(own, own_) += b.tail(own_);
}

ValveFitProblem::Normal ValveFitProblem::linearise(const VectorXd& v, double width) const {
  Normal normal{MatrixXd::Zero(size(), size()), VectorXd::Zero(size())};
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    const Rows of_recording = rows(v, r, width);
    accumulate(of_recording, 0, of_recording.error.size(), r, normal);
  }
  add_penalty(v, normal);
  return normal;
}

}  // namespace valvetriage
