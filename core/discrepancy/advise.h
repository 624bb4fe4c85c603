#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/model/model.h"

namespace valvetriage {

/// Chance of settling the question below which a test is asked for no more than the rivals that it beats, and of
/// beating a rival below which no test of the repertoire is worth its time.
inline constexpr double kWorthAsking = 0.05;

/// One explanation that the data leave open.
struct Alternative {
  std::string cause;  ///< as a candidate's: a cause, a pair "friction+leakage", "none"
  double probability = 0;
  Model model;  ///< with this cause in it, its baseline refitted
  /// The model moved by one standard deviation along each direction in which the data leave it open, the baseline's own
  /// parameters included. Empty: nothing is known of that, and offset, gain, timing and curvature are free.
  std::vector<Model> moved;
};

/// A test as one alternative sees it.
struct PlayedTest {
  std::size_t samples = 0;
  double distance = 0;  ///< d of the alternative and the rival
  double removed = 0;   ///< d² of the alternative and of none of them, in variances of noise_rms; 0 without `nothing`
};

/// What settles the question between the true one of two alternatives and the other.
struct Settling {
  double least_log_odds = 0;  ///< ln odds that a test must add, whatever the posterior; infinite where nothing does
  double noise_along = 1;     ///< of what the true one leaves along their difference, in variances of the noise
};

struct AdviceOptions {
  double noise_rms = 0;  ///< of white noise that tells as much as the stand's, unit of the output
  double bias_rms = 0;   ///< of what a right model leaves beside noise; it does not average out with more samples
  double input_low = 0, input_high = 0;  ///< what the stand may play, unit of the input
  double sample_rate_hz = 200;
  std::optional<Alternative> nothing;  ///< the valve without any of them
  /// By a test. Empty: the posterior alone settles.
  std::function<Settling(const Alternative& true_one, const Alternative& rival, const PlayedTest& test)> settling;
};

/// The test of the stand's repertoire that is expected to tell the alternatives apart best: steps, staircase, triangles
/// and sweeps of several amplitudes and speeds, a multisine, long holds.
///
/// Every alternative is simulated on every test. The distance of two is
///
///   d² = Δᵀ (σ² I + Σ_k g_k g_kᵀ)⁻¹ Δ,   Δ = y_i − y_j
///
/// where the g_k are what a refit may still move: what each alternative's `moved` models do. From d the chance that the
/// true one reaches a posterior of 0.95, and the odds that are asked for, against a rival is Φ((d²/2 − ln(19 p_j /
/// p_i)) / (d √κ)), κ the noise along their difference: a law is never the whole physics, and what it gets wrong shows
/// where its rival errs otherwise. An alternative is settled if all its rivals are beaten, by the product of the
/// chances, as if each asked for noise of its own (too little for several rivals on one side, too much for one between
/// two), and a test's worth is the mean over the alternatives by their probabilities. Where none reaches 0.05, it is
/// the chance that the true one beats a given rival: of eight alternatives no one test may settle all, and most of them
/// go. Among equals (within a hundredth) the shortest test is taken. Where it may leave the question open, a second
/// test is played after it in the same recording, if that adds a tenth to the chance of settling.
///
/// Only the most probable eight alternatives are compared; `none` is one of them where given. Their models need no
/// side channel: that of a future test is not known.
///
/// returns  empty for fewer than two alternatives, a range without width, or where no test is expected to beat a rival
///          with a probability of 0.05
/// Cost     tests × alternatives × (1 + directions) simulations of 600 to 8,000 samples at 200 Hz, fewer where a short
///          test settles everything; deterministic
std::optional<NextTest> advise_next_test(std::span<const Alternative> alternatives, const AdviceOptions& options);

/// The chance that one given test settles the question, weighed as advise_next_test weighs its own; NaN for fewer than
/// two alternatives that can be simulated.
///
/// input  one value per sample, unit of the input
double chance_to_settle(std::span<const Alternative> alternatives, std::vector<double> input,
                        const AdviceOptions& options);

}  // namespace valvetriage
