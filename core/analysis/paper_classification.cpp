#include "core/analysis/paper_classification.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace valvetriage {
namespace {

std::size_t largest_set(const LevelRules& level, double error) {
  const auto& sets = level.inputs.front().sets;
  const auto best = std::max_element(sets.begin(), sets.end(), [&](const InputSet& left, const InputSet& right) {
    return membership(left.shape, error) < membership(right.shape, error);
  });
  return static_cast<std::size_t>(best - sets.begin());
}

Verdict crisp(const PaperCrispRanges& ranges, double error) {
  if (error < ranges.malfunctioned_from) return Verdict::kGood;
  return error < ranges.severe_from ? Verdict::kMalfunctioned : Verdict::kSevere;
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

double relative_spread(const std::vector<double>& values) {
  const double centre = mean(values);
  double squares = 0;
  for (const double v : values) squares += (v - centre) * (v - centre);
  return std::sqrt(squares / static_cast<double>(values.size() - 1)) / centre;
}

std::vector<double> low_errors(Verdict verdict, int valve_type) {
  std::vector<double> errors;
  for (const PaperTableRow& row : kPaperTable) {
    if (row.verdict() == verdict && row.valve_type == valve_type) errors.push_back(row.error_low);
  }
  return errors;
}

}  // namespace

SetCounts count_largest_sets(const LevelRules& level, bool low) {
  SetCounts counts{};
  for (const PaperTableRow& row : kPaperTable) {
    const std::size_t set = largest_set(level, low ? row.error_low : row.error_high);
    ++counts[index_of(row.verdict())][set];
  }
  return counts;
}

double largest_error_in_set(const LevelRules& level, Verdict verdict, std::size_t set) {
  double largest = 0;
  for (const PaperTableRow& row : kPaperTable) {
    if (row.verdict() == verdict && largest_set(level, row.error_low) == set)
      largest = std::max(largest, row.error_low);
  }
  return largest;
}

std::array<StrengthRange, kVerdictCount> strengths_at_high(const LevelRules& level, std::size_t set) {
  std::array<StrengthRange, kVerdictCount> ranges{};
  for (const PaperTableRow& row : kPaperTable) {
    StrengthRange& range = ranges[index_of(row.verdict())];
    const double strength = membership(level.inputs.front().sets[set].shape, row.error_high);
    range.smallest = std::min(range.smallest, strength);
    range.largest = std::max(range.largest, strength);
  }
  return ranges;
}

CrispCheck check_crisp_ranges() {
  CrispCheck check;
  for (const PaperTableRow& row : kPaperTable) {
    check.errors += 2;
    check.wrong += crisp(kPaperCrispLow, row.error_low) != row.verdict();
    check.wrong += crisp(kPaperCrispHigh, row.error_high) != row.verdict();
    if (row.verdict() != Verdict::kGood) continue;
    check.largest_good_low = std::max(check.largest_good_low, row.error_low);
    check.largest_good_high = std::max(check.largest_good_high, row.error_high);
  }
  return check;
}

TableStatistics table_statistics() {
  TableStatistics statistics;
  std::vector<double> good;
  for (const int type : {1, 2}) {
    const std::vector<double> errors = low_errors(Verdict::kGood, type);
    statistics.good_mean_low[static_cast<std::size_t>(type - 1)] = mean(errors);
    statistics.good_spread_low[static_cast<std::size_t>(type - 1)] = relative_spread(errors);
    good.insert(good.end(), errors.begin(), errors.end());
  }
  statistics.good_over_malfunctioned_low = mean(good) / mean(low_errors(Verdict::kMalfunctioned, 2));
  for (const PaperTableRow& row : kPaperTable) {
    if (row.condition == PaperTableRow::Condition::kNew) continue;
    const Verdict worse = std::max(crisp(kPaperCrispLow, row.error_low), crisp(kPaperCrispHigh, row.error_high));
    statistics.returned_type_1_severe += row.valve_type == 1 && worse == Verdict::kSevere;
    statistics.returned_type_2_malfunctioned += row.valve_type == 2 && worse == Verdict::kMalfunctioned;
  }
  return statistics;
}

TableScore score_table(const RuleBase& base) {
  TableScore score;
  for (const PaperTableRow& row : kPaperTable) {
    const std::array<LevelFeatures, 2> features{LevelFeatures{.level_a = kPaperLow_a, .error_eq20 = row.error_low},
                                                LevelFeatures{.level_a = kPaperHigh_a, .error_eq20 = row.error_high}};
    const auto classified = classify(base, features);
    if (!classified) continue;
    for (const LevelClassification& level : classified->per_level) {
      ++score.sets;
      score.wrong += level.verdict != row.verdict();
      score.soft += is_soft_error(row.verdict(), level.verdict, level.memberships);
    }
  }
  return score;
}

}  // namespace valvetriage
