#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/analysis/population_figures.h"

namespace valvetriage::report {

/// One figure of a lot's valves beside good ones.
struct FigureShift {
  PopulationFigure figure;  ///< its value is that of the lot's newest valve
  SharedShift shift;
  double p_adjusted = 1;  ///< paid for all figures tested

  /// In the figure's unit; of a logarithmic figure the means are geometric.
  double good_mean() const;
  double lot_mean() const;
  /// The lot's mean less the good valves', with its 95 % interval.
  double difference() const;
  std::array<double, 2> difference_ci95() const;
};

inline constexpr double kShiftSignificance = 0.05;  ///< of p_adjusted

struct LotShifts {
  std::size_t fitting = 0;  ///< valves without a settled cause, not unexplained
  std::size_t valves = 0;   ///< of them those compared
  std::string valve_type;   ///< of the reference; empty where no valve was compared with one that is stored
  int reference_version = 0;
  int good_valves = 0;
  std::vector<FigureShift> figures;  ///< least p first
};

/// "natural frequency", "steady pressure at 1.40 A".
std::string figure_words(const PopulationFigure& figure);

/// One sentence for each figure that is shifted.
std::vector<std::string> shift_sentences(const LotShifts& shifts);
/// What was compared with what, or why nothing was.
std::string shift_scope(const LotShifts& shifts);

}  // namespace valvetriage::report
