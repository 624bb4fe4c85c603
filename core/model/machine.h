#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/model/section_cascade.h"
#include "core/recording/recording.h"
#include "core/result.h"

namespace valvetriage {

/// What one block of a machine does to the signal that enters it. Parameters in the order given; x the signal, T the
/// machine's sample period.
///
/// kLinear         Σ c_i x_i of a cascade of sections behind a delay of whole samples (section_cascade.h)
/// kAffine         scale x + offset
/// kPlay           lost motion of full `width`
/// kStickSlip      holds until |x − held| > breakaway, then follows at a distance of kinetic ≤ breakaway
/// kLoop           smooth rate-independent loop, mean of eight plays up to half width `reach`; `width` full width
/// kDeadBand       no change inside centre ± width/2
/// kUpperLimit     min(x, level), rounded over `softness` (log 2 of it at the level); kLowerLimit the reverse
/// kCurve          x + curvature R q (1 − q), q = (x − zero) / R, R = range
/// kMagnitude      fold + |x − fold|
/// kRateLimit      changes by at most `limit` per second
/// kLag            ẏ = (x − y) / τ, τ `rising_s` upwards and `falling_s` downwards
/// kSpring         y = G x + H (y − centre)³, G and H of the same poles; restoring force z + c z³, c = −H(0)
/// kRestoringLoop  y = G x + H h, ḣ = ẏ − beta |ẏ| h − delta ẏ |h|: Bouc and Wen's loop in the restoring force
/// kMotion         ÿ = gain x_t + gain_before x_{t−1} + bias − stiffness y − damping ẏ − friction; at rest as long as a
///                 force below `breakaway` can hold it, against `coulomb` in motion; shows ẏ where shows_speed is 1
/// kTanks          ḣ₁ = gain (x − closed) − outflow₁ h₁ᵐ,  ḣ₂ = outflow₁ h₁ᵐ − outflow₂ h₂ⁿ + share · spill₁, levels
///                 limited to their rims (the lower one's as a reading), shows h₂ + zero; one tank where `tanks` is 1
/// kTone           x + sine sin 2πft + cosine cos 2πft, t from the start of the recording
/// kDrift          x + rate t
/// kWarming        centre + (x − centre) (1 + change (1 − exp(−t / τ)))
/// kGainStep       from time_s on: centre + (x − centre) (1 + change)
/// kSide           x + coefficient (side channel − centre)
enum class MachineLaw : std::uint8_t {
  kLinear,
  kAffine,
  kPlay,
  kStickSlip,
  kLoop,
  kDeadBand,
  kUpperLimit,
  kLowerLimit,
  kCurve,
  kMagnitude,
  kRateLimit,
  kLag,
  kSpring,
  kRestoringLoop,
  kMotion,
  kTanks,
  kTone,
  kDrift,
  kWarming,
  kGainStep,
  kSide
};

/// A rim of kTanks that no level comes to.
inline constexpr double kNoRim = 1e6;
constexpr std::size_t kMachineLaws = static_cast<std::size_t>(MachineLaw::kSide) + 1;

/// Name in documents and names of the parameters, in order.
std::string_view name_of(MachineLaw law);
std::optional<MachineLaw> machine_law_from(std::string_view name);
std::span<const std::string_view> parameter_names(MachineLaw law);

struct MachineBlock {
  MachineLaw law = MachineLaw::kLinear;
  std::vector<double> parameters;
  std::vector<Section> sections;  ///< kLinear, kSpring, kRestoringLoop
  std::vector<double> numerator;  ///< at most order + 1 coefficients on the cascade's basis, highest states first
  std::vector<double> feedback;   ///< kSpring, kRestoringLoop: at most order coefficients, H
  int delay_samples = 0;          ///< kLinear, kSpring, kRestoringLoop, kMotion, kTanks
  std::string channel;            ///< kSide
};

/// A machine as a chain of blocks, from the input to the reading, on a sample period of its own.
struct Machine {
  static constexpr double kLeaves = 1e9;           ///< a run that gets here has left every machine's range
  static constexpr double kStraight = 1e-8;        ///< an exponent of kRestoringLoop at which nothing bends
  static constexpr int kLoopPlays = 8;             ///< of kLoop
  static constexpr int kSubSteps = 4;              ///< of kMotion and kTanks, per sample
  static constexpr std::size_t kSettleEvery = 64;  ///< samples from one SectionState::settle of kLinear to the next

  double sample_period_s = 0;
  /// What enters is the mean of the input over each interval between samples, in which steps are held and everything
  /// else is straight: where a session holds both, its samples alone do not say when a step came.
  bool interval_means = false;
  std::vector<MachineBlock> blocks;
};

/// What a run sees beside the signal.
struct MachineSurroundings {
  double start_s = 0;             ///< time of the first sample, from the start of the recording
  std::span<const Channel> side;  ///< on the same samples
};

/// Numbers that say how a run starts off steady state: deviations of states, and the memory of laws that have one.
std::size_t start_size(const MachineBlock& block);
std::size_t start_size(const Machine& machine);
/// What is much of each of them, where the output varies by about 1: 1, and of a motion's speed that it goes as far in
/// a sample, of its place where only the speed is shown what that comes to.
std::vector<double> units_of_start(const Machine& machine);

/// One block over a signal, from the steady state at its first value moved by `start` (empty: not moved).
/// out may be `in`. A run that leaves |10⁹| ends in NaN.
void run_block(const MachineBlock& block, double sample_period_s, const MachineSurroundings& around,
               std::span<const double> start, std::span<const double> in, std::span<double> out);

/// h of kRestoringLoop after its output has moved straight on by `move`: exact, for between the signs of the move and
/// of h its equation is linear.
double loop_after(double h, double move, double beta, double delta);

/// The basis signals whose weighted sum a linear block's output is: n × numerator.size().
Eigen::MatrixXd linear_basis(const MachineBlock& block, std::span<const double> start, std::span<const double> in);

/// Free run of the whole chain. Cost O(n · states), four sub-steps per sample for kMotion and kTanks.
std::vector<double> run_machine(const Machine& machine, const MachineSurroundings& around,
                                std::span<const double> start, std::span<const double> input);

/// Moves `start` by Gauss-Newton so that the run meets the first measured outputs (NaN takes no part); the smallest
/// move where they do not determine it.
std::vector<double> start_towards(const Machine& machine, const MachineSurroundings& around,
                                  std::span<const double> input, std::span<const double> measured);

/// What a document from outside must fulfil before it is run.
/// Errors  `machine_malformed`: parameters missing or not finite, a section that is not stable, coefficients beyond the
/// order
Result<void> check_machine(const Machine& machine);

}  // namespace valvetriage
