#pragma once

#include <string>
#include <vector>

#include "core/classify/rule_base.h"

namespace valvetriage {

/// A number behind a line, for programs.
struct PaperFigure {
  std::string name;  ///< snake_case, unique in its line
  double value = 0;
  std::string unit{};  ///< "" where it has none
};

/// One place of the paper, recomputed.
struct PaperLine {
  std::string where;
  std::string as_printed;
  std::string recomputed;
  std::string does_not_hold;  ///< "nothing: …" where all of it holds
  std::vector<PaperFigure> figures{};
};

/// Every published equation and table that can be recomputed, in the paper's order.
///
/// paper, calibrated  the rule bases of those names, each with the levels "low" and "high"
/// Cost               some 50 ms; deterministic, seeds are fixed
std::vector<PaperLine> check_paper(const RuleBase& paper, const RuleBase& calibrated);

}  // namespace valvetriage
