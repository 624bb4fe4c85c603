#pragma once

#include <string>
#include <vector>

#include "core/discrepancy/machine_trials.h"

namespace valvetriage {

/// One explanation with its best fit and its error on what was held out.
struct MachineScore {
  std::vector<std::string> causes;  ///< empty: the linear machine alone
  std::string place;
  MachineFit fit;               ///< on all rows of the search
  std::vector<double> log_rms;  ///< per held-out group, scaled units
  double mean = 0;              ///< of log_rms: the geometric mean decides
  bool held_out = false;        ///< false: its fit did not earn the effort

  double rms() const;
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

/// How many of the groups one score is better on than another, and the p-value of that many or more by chance
/// (two-sided sign test).
double sign_test(const std::vector<double>& better, const std::vector<double>& worse);

/// Fits the linear machines of order 1 to 6 and picks one by its held-out error.
MachineScore search_linear(const MachineData& data, MachineGround& ground, MachineBudget& budget);

/// Everything: linear machines, single causes, pairs, black box. Explanations are screened by their fit to all rows
/// from every start; the best are refined and judged on held-out groups.
MachineSearch search_machines(const MachineData& data, MachineGround ground, MachineBudget& budget);

/// A pair in reach of what a single cause leaves is looked for only when that single cause leaves more than this many
/// noise floors.
inline constexpr double kPairAboveFloors = 1.2;

/// Geometric-mean error of a flexible black box on the held-out groups: ridge regression on polynomials of lagged
/// states of the linear machine and of plays of the input, stable by construction.
std::vector<double> black_box_log_rms(const MachineData& data, const MachineGround& ground);

}  // namespace valvetriage
