#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "core/identify/blocked_columns.h"
#include "core/identify/coarse_rests.h"
#include "core/identify/knot_curve.h"
#include "core/identify/spool_rests.h"
#include "core/identify/valve_fit.h"
#include "core/model/sampled_mode.h"

namespace valvetriage {

/// The weighted least-squares problem behind fit_valve, linearised by tangents (internal to identify and discrepancy).
///
///   u → magnetic loop → input laws → G → position laws → map → steady laws → mode → volume → gauge → output laws → y
///
/// Vector: [parameters | knot outputs | shared law parameters | per recording: two states of spool or mode, pressure
/// gap, loop memory, its own law parameters].
class ValveFitProblem {
 public:
  static constexpr Eigen::Index kParameters = static_cast<Eigen::Index>(kValveParameters.size());
  enum Parameter : Eigen::Index { kFrequency, kDamping, kDelay, kLoop, kTimeConstant, kExponent, kSupply, kNarrowLoop };
  static constexpr Eigen::Index kStarts = 4;
  /// Of a usual step, where the cost is rough: 1 % of a frequency, 0.1 mA of a loop, 1 % of the input range of a law,
  /// half the range of a memory.
  static constexpr double kWide = 100;

  /// Both must outlive the problem.
  ValveFitProblem(std::span<const Recording> recordings, const ValveFitOptions& options);
  /// The same recordings with other laws.
  ValveFitProblem(const ValveFitProblem& other, const ValveFitOptions& options);

  Eigen::Index size() const { return shared() + own_ * static_cast<Eigen::Index>(prepared_.size()); }
  Eigen::Index baseline_size() const { return kParameters + knots_; }
  Eigen::Index shared() const { return baseline_size() + law_parameters_; }
  Eigen::Index own() const { return own_; }
  Eigen::Index knots() const { return knots_; }
  Eigen::Index own_at(std::size_t recording) const { return shared() + own_ * static_cast<Eigen::Index>(recording); }
  std::size_t recordings() const { return prepared_.size(); }
  const Recording& recording(std::size_t r) const { return *prepared_[r].recording; }
  double inverse_variance(std::size_t r) const { return prepared_[r].inverse_variance; }
  /// Outputs of a recording at some of its samples, ascending, in units of what is not known of them: noise, and where
  /// a coarse log leaves the input of a rest open, what all of it may be off by.
  void whiten(std::size_t recording, std::span<const std::size_t> samples, Eigen::Ref<Eigen::VectorXd> outputs) const;

  /// The vector inside its bounds.
  Eigen::VectorXd clamped(Eigen::VectorXd v) const;
  /// Whether a parameter of the valve lies at one of its bounds, within a step of the differences.
  bool is_at_bound(const Eigen::VectorXd& v, Eigen::Index parameter) const {
    const double step = step_(parameter);
    return v(parameter) < lower_(parameter) + step || v(parameter) > upper_(parameter) - step;
  }
  /// Whether a move of a parameter of the valve ends beyond its bounds.
  bool leaves_bounds(const Eigen::VectorXd& v, Eigen::Index parameter, double move) const {
    return v(parameter) + move < lower_(parameter) || v(parameter) + move > upper_(parameter);
  }
  /// Parameters as given, knots by averaging the outputs seen at each input, starts at rest, laws at their start.
  Eigen::VectorXd start_vector(const ValveParameters& parameters) const;
  /// Parameters of one law as one recording sees them.
  std::vector<double> law_parameters(const Eigen::VectorXd& v, std::size_t law, std::size_t recording) const;
  /// Where the vector has one of them.
  Eigen::Index law_entry(std::size_t law, std::size_t parameter, std::size_t recording) const;

  /// Σ e² / σ² + penalties.
  double cost(const Eigen::VectorXd& v) const { return cost(v, all_runs(v)); }
  double penalty(const Eigen::VectorXd& v) const;
  std::vector<double> simulate(const Eigen::VectorXd& v, std::size_t recording) const;
  /// Valid samples whose input is nearest to each knot of the map.
  Eigen::VectorXd samples_at_knots() const;
  /// The outputs at the knots of the nearest map that falls nowhere, in the mean square over the samples. A fit leaves
  /// the knots anywhere that few samples tell; what is shown, stored and run as a model rises.
  Eigen::VectorXd rising_map(const Eigen::VectorXd& v) const;
  /// Σ n ln(mean square error) over recordings: their cost where the size of each one's error is not known beforehand.
  double scale_free_cost(const Eigen::VectorXd& v) const;

  /// What a mode behind the map makes of the steady pressure, and the way it goes.
  struct Filling {
    std::vector<double> psi;
    SampledMode::Way way;
  };

  /// Every signal along the chain of one free run. Ahead of the volume two values a sample, there and half-way to the
  /// next; from it on one.
  struct Run {
    std::vector<double> position;                    ///< the map's input x [A]
    std::vector<double> mapped;                      ///< map(x)
    std::vector<double> steady;                      ///< behind the steady laws
    std::vector<double> asked;                       ///< the same at the samples
    Filling filling;                                 ///< behind the mode, where there is one
    std::vector<double> pressure;                    ///< behind the volume and the gauge
    std::vector<std::vector<double>> before_output;  ///< what enters each law at the output
    std::vector<double> output;
    VolumeTangent tangent;
  };
  Run run(const Eigen::VectorXd& v, std::size_t recording, bool tangents) const;
  std::vector<Run> all_runs(const Eigen::VectorXd& v) const;
  /// The cost of v by `all_runs` of it.
  double cost(const Eigen::VectorXd& v, std::span<const Run> at_v) const;
  /// Outputs of some recordings at v where the last law alone makes the difference to runs without it (one of each
  /// recording): from that law on along the chain, what comes before it is taken over.
  std::vector<std::vector<double>> simulate_behind_last(const Eigen::VectorXd& v,
                                                        std::span<const std::size_t> recordings,
                                                        std::span<const Run> without_last) const;

  /// This problem's vector continued into one with more laws behind the same ones: `parameters` are those of the added
  /// last law, shared ones first, then each recording's own.
  Eigen::VectorXd continued_in(const ValveFitProblem& wider, const Eigen::VectorXd& v,
                               std::span<const double> parameters) const;
  /// Whether its laws make the spool stick at v.
  bool sticks(const Eigen::VectorXd& v) const { return blocks_of(v, 0).friction.breakaway_a > 0; }
  /// How many times their usual steps the differences of a search at v are taken over. Free runs that stick are rough:
  /// they jump wherever one slip more or less decides, and only a secant over many slips tells where the cost falls.
  double width_at(const Eigen::VectorXd& v) const { return prepared_.front().rests.empty() && sticks(v) ? kWide : 1; }
  /// From now on a spool with dry friction begins every slip where the measured one, by the valve at v, rested: its
  /// runs are one slip ahead of the data instead of free. Each recording weighs by what v leaves of it, an error as
  /// slow as the volume, so that one whose slips are still wrong does not bend the valve.
  void follow_rests(const Eigen::VectorXd& v);
  /// The slips of all recordings by the rests that are followed, behind the magnetic loop at v.
  std::vector<Slip> slips(const Eigen::VectorXd& v) const;
  /// Runs are free again, weighed by noise. Returns v with the spools' first places where the rests have them.
  Eigen::VectorXd let_go(Eigen::VectorXd v);
  /// From now on a recording weighs nothing.
  void leave_out(std::size_t recording) { prepared_[recording].inverse_variance = 0; }
  /// What a law may look at in one recording.
  LawContext context(const Eigen::VectorXd& v, std::size_t recording, Place place) const;
  bool acts(const LawInFit& law, std::size_t recording) const { return !law.recording || *law.recording == recording; }

  /// Rows of one recording, whitened by its noise: sensitivities [shared | own] and errors at every valid sample.
  struct Rows {
    BlockedColumns jacobian;          ///< rows × (shared + own)
    Eigen::VectorXd error;            ///< measured − simulated
    std::vector<std::size_t> sample;  ///< of each row
  };
  Rows rows(const Eigen::VectorXd& v, std::size_t recording, double width = 1) const;

  /// Normal equations, lower and upper half filled.
  struct Normal {
    Eigen::MatrixXd a;
    Eigen::VectorXd b;
  };
  Normal linearise(const Eigen::VectorXd& v, double width = 1) const;
  /// Adds the rows of one recording, or of a part of them.
  void accumulate(const Rows& rows, Eigen::Index first, Eigen::Index count, std::size_t recording,
                  Normal& normal) const;
  /// Adds prior and preferences at v.
  void add_penalty(const Eigen::VectorXd& v, Normal& normal) const;

 private:
  struct Prepared {
    const Recording* recording = nullptr;
    IntervalSignal input;             ///< two intervals a sample
    std::vector<double> time_s;       ///< of each sample, from the recording's start
    std::vector<double> half_time_s;  ///< and half-way to the next
    std::vector<double> ends_s;       ///< start and end of each interval
    std::vector<double> ends_driver;  ///< the input there, without its noise
    double gate = 0;                  ///< of the loop's driver
    std::vector<double> driver;       ///< of the loop, where no law acts on the input
    double inverse_variance = 1;
    double noise_variance = 1;
    std::vector<double> rests;  ///< of the measured spool, as `spool_rests`; empty: runs are free
    std::vector<double> half_rests;
    std::vector<CoarseRest> coarse_rests;  ///< variances of the output
  };

  /// The valve's blocks with every law on them.
  struct Blocks {
    ValveParameters valve;
    SpoolFriction friction;
  };
  Blocks blocks_of(const Eigen::VectorXd& v, std::size_t recording) const {
    return blocks_of(v, recording, options_.laws.size());
  }
  /// With its first `laws` laws alone.
  Blocks blocks_of(const Eigen::VectorXd& v, std::size_t recording, std::size_t laws) const;
  double period_s(std::size_t recording) const { return prepared_[recording].recording->sample_period_s; }
  double half_period_s(std::size_t recording) const { return 0.5 * period_s(recording); }
  std::vector<Run> runs(const Eigen::VectorXd& v, std::span<const std::size_t> recordings, bool tangents) const;
  /// The mode behind the map with the delay, two steps a sample.
  SampledMode mode_of(const Blocks& blocks, std::size_t recording) const;
  /// In which halves of samples what enters the map is held: as what drives it is, nowhere where something slows it.
  std::vector<bool> held_halves(const Blocks& blocks, const Eigen::VectorXd& v, std::size_t recording) const;
  /// What the mode makes of the steady pressure.
  Filling ahead_of_volume(const Blocks& blocks, const Eigen::VectorXd& v, std::size_t recording,
                          const std::vector<double>& steady) const;
  VolumeRun volume_run(const Eigen::VectorXd& v, std::size_t recording, const OrificeVolume& volume,
                       std::span<const double> filling, std::span<double> pressure) const;
  /// visit(knot, output) of every valid sample, with the knot nearest to its input.
  template <typename Visitor>
  void for_each_knot_seen(Visitor&& visit) const;
  double squared_error(std::size_t recording, const std::vector<double>& simulated) const;
  /// The same over its variance, with what whole rests may be off by.
  double weighed_error(std::size_t recording, const std::vector<double>& simulated) const;
  /// Change of the output with the input at a rest, of a usual valve.
  double usual_slope(double input) const;
  StaticMap map_of(const Eigen::VectorXd& v) const;
  struct RunAt {
    const Eigen::VectorXd* v = nullptr;
    std::size_t recording = 0;
  };
  /// The map's input in each of several runs.
  std::vector<std::vector<double>> positions(std::span<const RunAt> at) const;
  /// Whether a law acts on a signal of this model, at a place.
  bool acts_at(const LawInFit& law, Place place, std::size_t recording) const {
    return law.law->place == place && law.law->apply && !law.acts_in_blocks_alone() && acts(law, recording);
  }
  IntervalSignal behind_input_laws(const Eigen::VectorXd& v, std::size_t recording) const;
  void apply_laws(Place place, const Eigen::VectorXd& v, std::size_t recording, std::span<const double> steady,
                  std::vector<double>& signal, std::vector<std::vector<double>>* before) const;
  /// What is read of the pressure: the laws at the output, then those on the reading.
  void read_off(const Eigen::VectorXd& v, std::size_t recording, std::span<const double> steady,
                std::vector<double>& pressure, std::vector<std::vector<double>>* before) const;
  void output_tangents(const Eigen::VectorXd& v, std::size_t recording, const Run& base,
                       std::vector<double>& change) const;

  class Columns;

  void set_bounds();
  void set_preferences();
  void place_laws();

  const ValveFitOptions& options_;
  std::vector<Prepared> prepared_;
  Eigen::Index knots_;
  KnotCurve curve_;
  Eigen::Index law_parameters_ = 0;
  Eigen::Index own_ = kStarts;
  double spool_start_sd_a_ = 0, pressure_start_sd_psi_ = 0;
  double mean_slope_psi_per_a_ = 0;                ///< of the map, roughly: what a start of a mode in A is in psi
  std::vector<Eigen::Index> law_at_, law_own_at_;  ///< first shared entry of each law; first own one behind own_at()
  Eigen::VectorXd lower_, upper_, step_;
  Eigen::MatrixXd precision_;  ///< of the prior, baseline_size() square
  Eigen::VectorXd mean_;
};

/// Where a descent ended.
struct Descent {
  Eigen::VectorXd v;
  double cost = 0;
  int iterations = 0;
  FitTermination termination = FitTermination::kIterationLimit;
  double damping = 0;
  double width = 1;  ///< of the differences, see ValveFitProblem::width_at
};

/// Levenberg-Marquardt with Marquardt's scaling, from v down, until a step lowers the cost by less than `smallest_gain`
/// of it; the default moves no parameter noticeably. Where the cost is rough its slope is taken as a secant over wide
/// steps, and over narrower ones when those lead no farther.
Descent descend(const ValveFitProblem& problem, Eigen::VectorXd v, int most_iterations, double smallest_gain = 1e-7);
/// A descent before its first step.
Descent descent_from(const ValveFitProblem& problem, Eigen::VectorXd v);
/// So many steps more of a descent that its limit of steps ended. One that does not seem to come down to `to_reach` is
/// given up: where the linear model of the fit, which is seldom off by more than three times, forecasts too little.
Descent descend_on(const ValveFitProblem& problem, Descent descent, int most_iterations, double smallest_gain = 1e-7,
                   double to_reach = std::numeric_limits<double>::infinity());

}  // namespace valvetriage
