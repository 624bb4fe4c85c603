#include "core/classify/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage {
namespace {

using Kind = RuleBaseFinding::Kind;

/// Grid points that one level and one set of measured inputs may cost.
constexpr double kGridBudget = 8000;
constexpr int kMostSamplesPerCell = 64;

double largest_finite_corner(const FuzzyInput& input) {
  double largest = 0;
  for (const InputSet& set : input.sets) {
    for (const double corner : {set.shape.a, set.shape.b, set.shape.c, set.shape.d}) {
      if (std::isfinite(corner)) largest = std::max(largest, corner);
    }
  }
  return largest;
}

/// From 0 to past the last corner: beyond it nothing changes. With the corners of the sets in between.
std::vector<double> corners_of(const FuzzyInput& input) {
  const double last = largest_finite_corner(input);
  std::vector<double> corners{0.0, last > 0 ? 1.25 * last : 1.0};
  for (const InputSet& set : input.sets) {
    for (const double corner : {set.shape.a, set.shape.b, set.shape.c, set.shape.d}) {
      if (std::isfinite(corner) && corner > 0) corners.push_back(corner);
    }
  }
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  return corners;
}

std::vector<double> refine(const std::vector<double>& corners, int per_cell) {
  std::vector<double> points;
  for (std::size_t k = 0; k + 1 < corners.size(); ++k) {
    for (int i = 0; i < per_cell; ++i) points.push_back(std::lerp(corners[k], corners[k + 1], double(i) / per_cell));
  }
  points.push_back(corners.back());
  return points;
}

void set_value(LevelFeatures& features, Quantity quantity, double value) {
  switch (quantity) {
    case Quantity::kError:
      features.error_eq20 = value;
      break;
    case Quantity::kSettlingError:
      features.settling_error = value;
      break;
    case Quantity::kRiseTime:
      features.rise_time_s = value;
      break;
    case Quantity::kBandwidthTime:
      features.bandwidth_hz = 1 / (2 * std::numbers::pi * value);
      break;
  }
}

/// The verdicts over a grid of some of a level's inputs, the first axis slowest.
class VerdictGrid {
 public:
  VerdictGrid(const RuleBase& base, const LevelRules& level, std::vector<std::size_t> inputs)
      : base_(base), level_(level), inputs_(std::move(inputs)) {
    const double per_axis = std::pow(kGridBudget, 1.0 / double(inputs_.size()));
    for (const std::size_t input : inputs_) {
      const std::vector<double> corners = corners_of(level.inputs[input]);
      // At least two, so that the middle of every cell is there: coverage is constant inside a cell.
      const int per_cell = std::clamp(int(per_axis / double(corners.size())), 2, kMostSamplesPerCell);
      axes_.push_back(refine(corners, per_cell));
    }
    evaluate();
  }

  void append_findings(std::vector<RuleBaseFinding>& findings) const {
    for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
      if (append_first_hole(axis, findings)) return;
      if (append_first_descent(axis, findings)) return;
    }
  }

 private:
  void evaluate() {
    std::size_t size = 1;
    for (const auto& axis : axes_) size *= axis.size();
    verdicts_.resize(size);
    for (std::size_t at = 0; at < size; ++at) {
      const auto classified = classify_level(base_, level_, features_at(at));
      verdicts_[at] = classified ? std::optional(classified->verdict) : std::nullopt;
    }
  }

  std::size_t stride(std::size_t axis) const {
    std::size_t stride = 1;
    for (std::size_t later = axis + 1; later < axes_.size(); ++later) stride *= axes_[later].size();
    return stride;
  }

  double coordinate(std::size_t at, std::size_t axis) const {
    return axes_[axis][at / stride(axis) % axes_[axis].size()];
  }

  LevelFeatures features_at(std::size_t at) const {
    LevelFeatures features{.level_a = level_.level_a};
    for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
      set_value(features, level_.inputs[inputs_[axis]].quantity, coordinate(at, axis));
    }
    return features;
  }

  std::string place(std::size_t at) const {
    std::string text;
    for (std::size_t axis = 0; axis < axes_.size(); ++axis) {
      text += fmt::format("{}{} {:.6g}", axis == 0 ? "" : ", ", to_string(level_.inputs[inputs_[axis]].quantity),
                          coordinate(at, axis));
    }
    return text;
  }

  RuleBaseFinding finding(Kind kind, std::size_t axis, double from, double to, std::string text) const {
    return {kind, level_.name, level_.inputs[inputs_[axis]].quantity, from, to, std::move(text)};
  }

  bool append_first_hole(std::size_t axis, std::vector<RuleBaseFinding>& findings) const {
    const auto hole = std::find(verdicts_.begin(), verdicts_.end(), std::nullopt);
    if (hole == verdicts_.end()) return false;
    const auto at = std::size_t(hole - verdicts_.begin());
    auto last = at;
    while (last + stride(axis) < verdicts_.size() && !verdicts_[last + stride(axis)] &&
           coordinate(last + stride(axis), axis) > coordinate(last, axis)) {
      last += stride(axis);
    }
    findings.push_back(finding(Kind::kUncovered, axis, coordinate(at, axis), coordinate(last, axis),
                               fmt::format("level {}: no rule fires at {}", level_.name, place(at))));
    return true;
  }

  bool append_first_descent(std::size_t axis, std::vector<RuleBaseFinding>& findings) const {
    const std::size_t step = stride(axis);
    for (std::size_t at = 0; at + step < verdicts_.size(); ++at) {
      const bool neighbours = coordinate(at, axis) < coordinate(at + step, axis);
      if (!neighbours || verdicts_[at + step] >= verdicts_[at]) continue;
      findings.push_back(finding(Kind::kVerdictNotMonotone, axis, coordinate(at, axis), coordinate(at + step, axis),
                                 fmt::format("level {}: {} at {}, but {} at {}", level_.name, to_string(*verdicts_[at]),
                                             place(at), to_string(*verdicts_[at + step]), place(at + step))));
      return true;
    }
    return false;
  }

  const RuleBase& base_;
  const LevelRules& level_;
  std::vector<std::size_t> inputs_;
  std::vector<std::vector<double>> axes_;
  std::vector<std::optional<Verdict>> verdicts_;
};

/// Every set of inputs that can be measured: the error, with or without each of the others.
std::vector<std::vector<std::size_t>> measurable_inputs(const LevelRules& level) {
  std::vector<std::vector<std::size_t>> subsets{{}};
  for (std::size_t i = 0; i < level.inputs.size(); ++i) {
    const std::size_t before = subsets.size();
    const bool always = level.inputs[i].quantity == Quantity::kError;
    for (std::size_t s = 0; s < before; ++s) {
      auto with = subsets[s];
      with.push_back(i);
      if (always) {
        subsets[s] = std::move(with);
      } else {
        subsets.push_back(std::move(with));
      }
    }
  }
  return subsets;
}

/// The fuzzy part of a level that asks about the error alone, as functions of the error.
class ErrorCurve {
 public:
  ErrorCurve(const RuleBase& base, const LevelRules& level) : base_(base), level_(level) {
    const auto is_error = [](const FuzzyInput& input) { return input.quantity == Quantity::kError; };
    const auto error = std::find_if(level.inputs.begin(), level.inputs.end(), is_error);
    cells_ = corners_of(*error);
    const double end = cells_.back();
    append_crossings(*error);
    for (const double limit : {level.crisp.malfunctioned_from, level.crisp.severe_from}) {
      if (level.crisp.of == CrispRanges::Of::kError && limit > 0 && limit < end) cells_.push_back(limit);
    }
    std::sort(cells_.begin(), cells_.end());
    cells_.erase(std::unique(cells_.begin(), cells_.end(), [](double a, double b) { return b - a < 1e-12; }),
                 cells_.end());
  }

  void append_findings(std::vector<RuleBaseFinding>& findings) const {
    append_where(findings, Kind::kMembershipNotMonotone, "a worse error has a larger membership of Good",
                 [&](double from, double to) { return rises(Verdict::kGood, from, to); });
    append_where(findings, Kind::kMembershipNotMonotone, "a worse error has a smaller membership of Severe",
                 [&](double from, double to) { return rises(Verdict::kSevere, to, from); });
    append_where(findings, Kind::kConclusionDisagrees, "the verdict is not the class of the largest membership",
                 [&](double from, double to) { return disagrees((from + to) / 2); });
  }

 private:
  void append_crossings(const FuzzyInput& error) {
    const std::vector<double> corners = cells_;
    for (std::size_t k = 0; k + 1 < corners.size(); ++k) {
      const double from = corners[k];
      const double to = corners[k + 1];
      for (const InputSet& f : error.sets) {
        for (const InputSet& g : error.sets) {
          const double at_left = membership(f.shape, from) - membership(g.shape, from);
          const double at_right = membership(f.shape, to) - membership(g.shape, to);
          if (at_left * at_right < 0) cells_.push_back(from + (to - from) * at_left / (at_left - at_right));
        }
      }
    }
  }

  std::optional<LevelClassification> at(double error) const {
    auto classified = classify_level(base_, level_, {.level_a = level_.level_a, .error_eq20 = error});
    return classified ? std::optional(std::move(*classified)) : std::nullopt;
  }

  bool rises(Verdict verdict, double from, double to) const {
    // Inner points: an edge of a set may be vertical.
    const auto first = at(std::lerp(from, to, 0.25));
    const auto second = at(std::lerp(from, to, 0.75));
    constexpr double kRounding = 1e-12;
    return first && second &&
           second->memberships[index_of(verdict)] > first->memberships[index_of(verdict)] + kRounding;
  }

  bool disagrees(double error) const {
    const auto here = at(error);
    return here && largest_membership(here->memberships) != here->verdict;
  }

  /// One finding per run of neighbouring cells for which `holds` is true.
  template <typename Predicate>
  void append_where(std::vector<RuleBaseFinding>& findings, Kind kind, std::string_view what, Predicate holds) const {
    for (std::size_t k = 0; k + 1 < cells_.size(); ++k) {
      if (!holds(cells_[k], cells_[k + 1])) continue;
      const double from = cells_[k];
      while (k + 2 < cells_.size() && holds(cells_[k + 1], cells_[k + 2])) ++k;
      const double to = cells_[k + 1];
      findings.push_back({kind, level_.name, Quantity::kError, from, to,
                          fmt::format("level {}: from error {:.6g} to {:.6g} {}", level_.name, from, to, what)});
    }
  }

  const RuleBase& base_;
  const LevelRules& level_;
  std::vector<double> cells_;
};

}  // namespace

std::vector<RuleBaseFinding> check_rule_base(const RuleBase& base) {
  std::vector<RuleBaseFinding> findings;
  for (const LevelRules& level : base.levels) {
    for (auto& inputs : measurable_inputs(level)) VerdictGrid(base, level, std::move(inputs)).append_findings(findings);
    ErrorCurve(base, level).append_findings(findings);
  }
  return findings;
}

Result<void> require_sound(const RuleBase& base) {
  for (const RuleBaseFinding& finding : check_rule_base(base)) {
    if (!finding.is_fault()) continue;
    const bool hole = finding.kind == Kind::kUncovered;
    return fail(hole ? "rule_base_uncovered" : "rule_base_not_monotone",
                fmt::format("rule base '{}': {}", base.name, finding.text));
  }
  return {};
}

}  // namespace valvetriage
