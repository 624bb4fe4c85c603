#pragma once

#include <string>
#include <vector>

#include "core/discrepancy/machine_trials.h"

namespace valvetriage {

/// One explanation with its best fit and its error on what was held out.
struct MachineScore {
  std::vector<std::string> causes;  ///< empty: the linear machine alone
  std::string place;
  MachineFit fit;                         ///< on all rows of the search
  std::vector<double> log_rms;            ///< per held-out group, scaled units
  std::vector<std::vector<double>> gaps;  ///< per held-out group: measured less simulated
  double mean = 0;                        ///< of log_rms: the geometric mean decides
  bool held_out = false;                  ///< false: its fit did not earn the effort

  double rms() const;        ///< geometric mean over the groups
  std::string name() const;  ///< "friction", "orifice_flow+saturation", "none"
};

struct MachineSearch {
  MachineGround ground;
  MachineScore linear;               ///< the best linear machine
  std::vector<MachineScore> scores;  ///< causes and pairs, best first, those not held out behind
  double black_box_rms = 0;          ///< geometric mean over the same groups, scaled units; NaN where there is none
  std::vector<double> black_box_log_rms;
  bool budget_spent = false;
};

/// Runs the folds of a score's fit: what is free in it refitted without the judged rows, judged on them.
void hold_out(const MachineData& data, MachineScore& score, MachineBudget& budget);

/// Rms over all judged samples, what a reader is told. No decision rests on it: one bad block would outweigh all
/// others.
double held_out_rms(const MachineScore& score);
double black_box_held_out_rms(const MachineSearch& search);

/// How many of the groups one score is better on than another, and the p-value of that many or more by chance
/// (two-sided sign test).
double sign_test(const std::vector<double>& better, const std::vector<double>& worse);

/// Two explanations compared on what was held out, group by group, as Vuong does: not nested in one another, the
/// differences of their log errors are all that counts.
struct BlockComparison {
  double log_gain = 0;  ///< mean over the groups of log(error of `worse` / error of `better`)
  double p_value = 1;   ///< sign test or Student's t over the groups, the smaller of them doubled
};
BlockComparison compare_blocks(const std::vector<double>& better, const std::vector<double>& worse);

/// The same after both residuals went through the filter that whitens `better`'s: slow wander that nobody explains
/// counts once, not once per sample. A law of the machine shows in both comparisons, luck with slow noise in one.
BlockComparison compare_whitened(const MachineScore& better, const MachineScore& worse);

/// Fits the linear machines of order 1 to 6 and picks one by its held-out error. Orders 1 and 2 are also started from
/// integrating motions, which an identifier in feedback or in noise tends to miss.
MachineScore search_linear(const MachineData& data, MachineGround& ground, MachineBudget& budget);

/// Frequencies [Hz] of the most prominent lines of what a fit leaves, where the input has none: at least three periods
/// in the longest record, power over the neighbours' median more than noise reaches. Cost O(n²).
std::vector<double> residual_tones(const MachineData& data, const MachineFit& fit);

/// The instants of a single recording at which the gain of what is measured over what a fit simulates, both from
/// `zero`, changes most: at most three apart from each other, strongest first. Cost O(n log n).
std::vector<GainStep> gain_steps(const MachineData& data, const MachineFit& fit, double zero);
/// A fit whose last law is an abrupt change of gain, moved to the instant that its own machine shows until that stays:
/// the cost is flat between two samples, and no slope leads there.
void move_instant(const MachineData& data, int iterations, MachineFit& fit, MachineBudget& budget);

/// At one rate a lag and a memory look alike, and laws are tried around a static core. Where a linear machine with
/// dynamics is clearly closer than each of them, and the black box not closer than that, lags are all there is: it is
/// the linear machine that the rest is measured against.
void prefer_lags(const MachineData& data, MachineSearch& search, MachineBudget& budget);

/// Everything: linear machines, single causes, pairs, black box. Explanations are screened by their fit to all rows
/// from every start; the best are refined and judged on held-out groups.
MachineSearch search_machines(const MachineData& data, MachineGround ground, MachineBudget& budget);

/// Geometric-mean error of a flexible black box on the held-out groups: ridge regression on polynomials of lagged
/// states of the linear machine and of plays of the input, stable by construction.
std::vector<double> black_box_log_rms(const MachineData& data, const MachineGround& ground);

}  // namespace valvetriage
