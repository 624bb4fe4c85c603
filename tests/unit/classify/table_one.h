#pragma once

#include <vector>

#include "core/classify/learn.h"
#include "core/classify/paper_table.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage::test {

inline LabelledValve labelled(const PaperTableRow& row) {
  return {row.verdict(),
          {{.level_a = 1.4, .error_eq20 = row.error_low}, {.level_a = 1.6, .error_eq20 = row.error_high}}};
}

inline RuleBase calibrated() {
  return embedded_rule_base("calibrated").value();
}

/// Table I as labelled valves.
inline std::vector<LabelledValve> table_one() {
  std::vector<LabelledValve> valves;
  for (const PaperTableRow& row : kPaperTable) valves.push_back(labelled(row));
  return valves;
}

/// What a rule base gets on labelled valves: wrong valves, and level sets wrong, soft and hard.
struct Score {
  int wrong_valves = 0, wrong_sets = 0, soft = 0, hard = 0;
};

inline Score score(const RuleBase& base, const std::vector<LabelledValve>& valves) {
  Score score;
  for (const LabelledValve& valve : valves) {
    const Classification classified = classify(base, valve.levels).value();
    score.wrong_valves += classified.verdict != valve.verdict;
    for (const LevelClassification& level : classified.per_level) {
      score.wrong_sets += level.verdict != valve.verdict;
      score.soft += is_soft_error(valve.verdict, level.verdict, level.memberships);
      score.hard += is_hard_error(valve.verdict, level.verdict);
    }
  }
  return score;
}

}  // namespace valvetriage::test
