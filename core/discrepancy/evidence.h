#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "core/discrepancy/linearised_valve.h"
#include "core/model/reference.h"

namespace valvetriage {

/// How many times more a residual's slow part varies than white noise of the stated variance would: the largest, over
/// block lengths of 1 to 64 samples, of the variance of block sums over the block length. At least 1.
///
/// Both a coloured noise and a simulation's own bias make evidence look stronger than it is by this factor.
double noise_inflation(const Stack& whitened_residual);

/// Evidence for a law in noise variances: the square of a score over its standard error.
struct Evidence {
  double value = 0;  ///< ≥ 0
  double exact = 0;  ///< the part of it that is owed to the prior: no noise in it
  /// How well the standard error is known, in degrees of freedom: infinite for white noise.
  double freedoms = std::numeric_limits<double>::infinity();
  /// Of the information on the size, what the prior alone tells: 0 to 1. What the samples bear out that moved the valve
  /// away from the prior is theirs.
  double prior_share = 0;

  /// What a normal deviate with the same tail as this Student t would have: Wallace, Ann. Math. Stat. 30 (1959) 1124.
  double as_normal() const;
  /// No more of it than the whole cost fell by; none of a cost that rose.
  Evidence at_most(double reduction) const;
};

/// How firmly a signature s = before − after is there, whatever the noise's colour and wherever it is loud:
///
///   T = (Σ_b s_b·s_b)² / Σ_b (s_b·after_b)²
///
/// over blocks b of 1 to 256 samples and of `slowest`, the least of them. For white noise of unit variance T is s·s,
/// the reduction of the cost; where what is left beside the signature is coarser just where the signature lives (a
/// jittering clock at the edges, a few lost samples, another law's leftover), T says so. The consistent variance of a
/// score: White, Econometrica 48 (1980) 817; Newey and West, Econometrica 55 (1987) 703, here with blocks for lags.
/// Where more than white noise scatters, a few loud places may have told how much: T is then the square of a Student t
/// (Bell and McCaffrey, Survey Methodology 28 (2002) 169; its freedoms by Satterthwaite, of the part beyond white
/// noise). Of B blocks the scatter is B / (B − 1) times as large, for the law was fitted to them, and has B − 1
/// freedoms at most; of one or two of `slowest`, whatever they show, one.
///
/// reduction  of the whole cost
/// slowest    samples over which the signature changes slowest, if that is more than the largest block: shorter ones
/// take
///            the swing of a slow residual for scatter that averages out
/// returns    T, and what the reduction owes to the prior rather than to the residual: no noise in that. Where this is
///            the greater part, the samples that moved the valve away from the prior speak for it as well, and as
///            noisily: R² / (Σ_b (s_b·after_b)² + R − Σ_b s_b·s_b), R the reduction, the prior as data of its own
///            variance. Where the samples hardly change, the prior's part alone
Evidence consistent_evidence(const Stack& before, const Stack& after, double reduction, Eigen::Index slowest = 0);

/// Two explanations that both may be wrong, compared block by block: Vuong, Econometrica 57 (1989) 307.
struct Contrast {
  double difference = 0;  ///< cost of the rival less that of the winner
  double z = 0;           ///< of the difference over its scatter between blocks; the smallest over block lengths
};
Contrast contrast(const Stack& winner, const Stack& rival);

/// Variance of what the winner leaves along its difference from a rival, in that of white noise, 1 at the least: what
/// both get wrong of the valve does not average out over a block, and the longer it lasts the less a difference says.
/// The largest over block lengths of Σ_b (Δ_b·r_b)² / Σ Δ².
double noise_along(const Stack& winner, const Stack& rival);

/// What a further difference of the squares has to be for z of the contrast to reach `least_z`: of a test of so many
/// samples on which the two lie d apart, spread evenly over it.
///
/// noise_along  as above
double gain_to_be_borne_out(const Contrast& known, double least_z, double d, double samples, double noise_along);

/// The evidence for a cause that good valves show, each against the others.
struct GoodValveEvidence {
  double mean = 0;
  double sd = 0;  ///< between valves; 0 if not known
  int valves = 0;
  /// The mean size from none over its scatter between valves; infinite where sizes tell nothing of the evidence.
  double common_size = std::numeric_limits<double>::infinity();
};

/// Probability that a good valve seems to have as much of a cause: the larger of what noise and what the spread between
/// good valves would do. In noise the evidence counts as what a normal deviate would have.
///
///   noise   evidence − (kNoise − k) as χ² of k freedoms
///   spread  (evidence − (kNoise − 1)) / s² as F of m and n m freedoms,   s² = 1 + max(0, mean over good valves −
///   kNoise)
///
/// Noise is known; the spread between valves is known from n of them alone, and n that show nothing do not say that
/// there is none. `kNoise` is what noise alone gives after the search over the law's instants or frequencies, k the
/// parameters. What a law takes from the simulation's own bias differs less between valves than the square of one
/// normal deviate would: m, at least 1, is what their scatter tells (2 (mean / sd)², Satterthwaite, Biometrics
/// Bulletin 2 (1946) 110), as far as n valves say what it is (square_p_value). But the square of a normal deviate
/// cannot differ less than its mean allows: with λ = common_size², m is at most (1 + λ)² / (1 + 2 λ).
double good_valve_p_value(const Evidence& evidence, Eigen::Index freedoms, double noise_reduction,
                          const GoodValveEvidence& good);

/// Probability that a further square is `times` as large as the mean of n: F of m and n m freedoms, m what their
/// scatter tells, 2 (mean / sd)² (Satterthwaite), between 1 and `most`. A few may agree by chance: the mean over what n
/// of them leave open of their sd. m = 1 where it is not known.
double square_p_value(double times, double mean, double sd, int n,
                      double most = std::numeric_limits<double>::infinity());

/// Odds of an effect of unknown size to none where a good valve seems to have as much of it with a probability p: the
/// mean, over sizes δ from half to fifty deviations of what good valves show, of e^(zδ − δ²/2) with z = Φ⁻¹(1 − p),
/// 0 at the least. Sizes of faults are spread evenly over decades, and most of a decade lies below what a test can see:
/// 0.2 where nothing is seen, not 0.
double odds_at_unknown_size(double p_value);

/// The same by the size of the effect, where good valves have a mean size: Student's t of
/// (size − mean) / √(sd² (1 + 1/n) + error²), sd from n valves. The error of the size is known as far as the samples
/// tell of the size; as far as the prior does, how much of it a valve's own parameters may make, from n valves as well.
/// Freedoms by Satterthwaite.
///
/// size_from_none  the size less that of no effect
/// mean_from_none  the same of good valves' mean
/// sd              of good valves' sizes
/// error           standard error of the size
/// prior_share     of the information on the size, 0 to 1
double size_p_value(double size_from_none, double mean_from_none, double sd, double error, double prior_share,
                    int good_valves);

}  // namespace valvetriage
