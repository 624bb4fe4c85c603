#pragma once

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// How well held-out samples bear an explanation out.
struct MeasuredGain {
  DiscrepancyGain gain;
  /// By how much less the explanation foresees held-out samples than the baseline [noise variances]. Each by the cost
  /// of the whole fit less that without them, which has the uncertainty of what the kept samples foretell in it: where
  /// the only edge of a recording is held out, they tell little of it and are little wrong. Dawid, J. Royal Statistical
  /// Society A 147 (1984) 278.
  double surprise = 0;
};

/// What an explanation gains on samples that took no part in its fit.
///
/// Folds are recordings where there are at least three, else blocks of a quarter of a recording, the first never held
/// out. For each fold baseline and explanation are fitted again without it (one Gauss-Newton step of the exact normal
/// equations without the fold's rows), simulated freely on it from its own initial state, and compared. The explanation
/// is only used where it pays on the samples that were kept, by more than its parameters cost: choosing is nested. The
/// interval is of a bootstrap over blocks, seeded by nothing but the data's size.
///
/// A cycle of hunting has a phase that no other recording foretells: its frequency, amplitude and level are those of
/// the samples that were kept, its phase that of the reading around each held-out sample, without the sample and its
/// neighbours (core/mechanisms/self_oscillation.cpp); `heldout` says so.
///
/// rmse_black_box  what a regression of the baseline's residual on polynomials of states that remember the input
/// reaches
///                 on the same folds: about what any extension could
/// transfer        the same for all recordings of one kind of test, fitted on the other kinds; empty where there is one
///                 kind only or a law acts in one recording alone
MeasuredGain measure_gain(const Explanation& baseline, const Explanation& extended);

/// What an explanation with some of the causes of another leaves of the samples that are held out of that one [psi].
double held_out_rmse(const Explanation& baseline, const Explanation& fewer, const Explanation& all);

/// Whether recordings that took no part in its fit bear an explanation out: the lower end of the 95 % interval of what
/// it gains on them is above nothing.
bool is_borne_out(const Explanation& baseline, const Explanation& extended);

}  // namespace valvetriage
