#include "core/classify/learn.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/classify/check.h"

namespace valvetriage {
namespace {

/// Further inputs must separate neighbouring classes at least this well (Somers' D, 1 = perfectly).
constexpr double kLeastSeparation = 0.5;

/// Values of one quantity at one level, by class.
using ByClass = std::array<std::vector<double>, kVerdictCount>;

/// Where two neighbouring classes cross, and half the width of their ramps.
struct Crossing {
  double at = 0;
  double half_width = 0;
};

struct LearnedInput {
  Quantity quantity = Quantity::kError;
  std::vector<Crossing> crossings{};  ///< one less than classes
  double weight = 0;                  ///< mean Somers' D of neighbouring classes
};

struct LearnedLevel {
  double level_a = 0;
  std::vector<LearnedInput> inputs;  ///< the error first
};

const LevelFeatures* level_of(const LabelledValve& valve, double level_a) {
  for (const LevelFeatures& features : valve.levels) {
    if (std::abs(features.level_a - level_a) < kLevelTolerance) return &features;
  }
  return nullptr;
}

std::vector<double> distinct_levels(std::span<const LabelledValve> valves) {
  std::vector<double> levels;
  for (const LabelledValve& valve : valves) {
    for (const LevelFeatures& features : valve.levels) levels.push_back(features.level_a);
  }
  std::sort(levels.begin(), levels.end());
  const auto same = [](double a, double b) { return b - a < kLevelTolerance; };
  levels.erase(std::unique(levels.begin(), levels.end(), same), levels.end());
  return levels;
}

ByClass values_by_class(std::span<const LabelledValve> valves, double level_a, Quantity quantity) {
  ByClass values;
  for (const LabelledValve& valve : valves) {
    const LevelFeatures* features = level_of(valve, level_a);
    if (features == nullptr) continue;
    if (const auto value = value_of(*features, quantity)) values[index_of(valve.verdict)].push_back(*value);
  }
  return values;
}

bool has_enough(const ByClass& values, const std::vector<Verdict>& classes, std::size_t fewest) {
  return std::all_of(classes.begin(), classes.end(), [&](Verdict c) { return values[index_of(c)].size() >= fewest; });
}

/// Somers' D of two samples: P(worse > better) − P(worse < better).
double somers_d(std::vector<double> better, const std::vector<double>& worse) {
  std::sort(better.begin(), better.end());
  double sum = 0;
  for (const double value : worse) {
    const auto below = std::lower_bound(better.begin(), better.end(), value) - better.begin();
    const auto above = better.end() - std::upper_bound(better.begin(), better.end(), value);
    sum += double(below - above);
  }
  return sum / (double(better.size()) * double(worse.size()));
}

LearnedInput place_input(const ByClass& values, const std::vector<Verdict>& classes, Quantity quantity) {
  LearnedInput input{.quantity = quantity};
  for (std::size_t k = 0; k + 1 < classes.size(); ++k) {
    const auto& better = values[index_of(classes[k])];
    const auto& worse = values[index_of(classes[k + 1])];
    const double upper = quantile(better, 0.75);
    const double lower = quantile(worse, 0.25);
    input.crossings.push_back({(upper + lower) / 2, std::abs(lower - upper) / 2});
    input.weight += somers_d(better, worse) / double(classes.size() - 1);
  }
  return input;
}

bool separates(const LearnedInput& input) {
  const auto ordered = [](const Crossing& a, const Crossing& b) { return a.at < b.at; };
  return input.weight >= kLeastSeparation && std::is_sorted(input.crossings.begin(), input.crossings.end(), ordered);
}

/// Keeps crossings in order and ramps from overlapping: classes that overlap wholly leave a steep, still monotone set.
void make_monotone(LearnedInput& input) {
  double scale = 1e-9;
  for (const Crossing& c : input.crossings) scale = std::max(scale, std::abs(c.at));
  const double least_gap = 1e-6 * scale;
  for (Crossing& c : input.crossings) c.half_width = std::max(c.half_width, least_gap / 2);
  if (input.crossings.size() < 2) return;
  Crossing& low = input.crossings[0];
  Crossing& high = input.crossings[1];
  if (high.at - low.at < least_gap) {
    const double middle = (low.at + high.at) / 2;
    low.at = middle - least_gap / 2;
    high.at = middle + least_gap / 2;
  }
  const double room = (high.at - low.at) / (low.half_width + high.half_width);
  if (room < 1) {
    low.half_width *= room;
    high.half_width *= room;
  }
}

/// Whether the crossings of every level put every labelled valve on its own side, level by level.
bool every_level_separates(std::span<const LabelledValve> valves, const std::vector<Verdict>& classes,
                           const std::vector<LearnedLevel>& levels) {
  for (const LearnedLevel& level : levels) {
    for (const LabelledValve& valve : valves) {
      const LevelFeatures* features = level_of(valve, level.level_a);
      if (features == nullptr) continue;
      std::size_t verdict = 0;
      for (const Crossing& crossing : level.inputs.front().crossings) verdict += features->error_eq20 >= crossing.at;
      if (classes[verdict] != valve.verdict) return false;
    }
  }
  return true;
}

/// How bad a valve is by its worst level: the largest error over what the better class shows at that level.
double worst_score(const LabelledValve& valve, const std::vector<LearnedLevel>& levels,
                   const std::vector<double>& scale) {
  double score = 0;
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const LevelFeatures* features = level_of(valve, levels[l].level_a);
    if (features != nullptr) score = std::max(score, features->error_eq20 / scale[l]);
  }
  return score;
}

/// Places boundary k of all levels together, by the valves' worst levels. Errors are positive and grow by factors, so
/// the crossing is the geometric middle of the quartiles.
void place_jointly(std::span<const LabelledValve> valves, const std::vector<Verdict>& classes, std::size_t k,
                   std::vector<LearnedLevel>& levels) {
  std::vector<double> scale;
  for (const LearnedLevel& level : levels) {
    const ByClass errors = values_by_class(valves, level.level_a, Quantity::kError);
    scale.push_back(std::max(quantile(errors[index_of(classes[k])], 0.75), 1e-9));
  }
  std::vector<double> better, worse;
  for (const LabelledValve& valve : valves) {
    if (valve.verdict == classes[k]) better.push_back(worst_score(valve, levels, scale));
    if (valve.verdict == classes[k + 1]) worse.push_back(worst_score(valve, levels, scale));
  }
  const double upper = quantile(better, 0.75);
  const double lower = std::max(quantile(worse, 0.25), 1e-9);
  const double middle = std::sqrt(upper * lower);
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const double half_width = std::min(std::abs(middle - upper), std::abs(lower - middle));
    levels[l].inputs.front().crossings[k] = {middle * scale[l], half_width * scale[l]};
  }
}

FuzzyInput fuzzy_input(const LearnedInput& learned, const std::vector<Verdict>& classes) {
  FuzzyInput input{.quantity = learned.quantity};
  for (std::size_t k = 0; k < classes.size(); ++k) {
    Trapezoid shape{-kOpen, -kOpen, kOpen, kOpen};
    if (k > 0) {
      const Crossing& below = learned.crossings[k - 1];
      shape.a = below.at - below.half_width;
      shape.b = below.at + below.half_width;
    }
    if (k + 1 < classes.size()) {
      const Crossing& above = learned.crossings[k];
      shape.c = std::max(above.at - above.half_width, shape.b);
      shape.d = above.at + above.half_width;
    }
    input.sets.push_back({std::string(membership_key(classes[k])), shape});
  }
  return input;
}

/// Symmetric conclusions at 0, 1/2 and 1: two neighbours of equal strength meet half way between their peaks.
OutputSet output_set(Verdict verdict) {
  const double peak = 0.5 * double(index_of(verdict));
  return {verdict, triangle(peak - 0.5, peak, peak + 0.5)};
}

CrispRanges crisp_ranges(const std::vector<Verdict>& classes) {
  constexpr double kNever = 1.5;  // the end of the output axis, which no centroid reaches
  const bool malfunctioned = std::find(classes.begin(), classes.end(), Verdict::kMalfunctioned) != classes.end();
  const bool severe = std::find(classes.begin(), classes.end(), Verdict::kSevere) != classes.end();
  if (malfunctioned && severe) return {CrispRanges::Of::kCentroid, 0.25, 0.75};
  if (malfunctioned) return {CrispRanges::Of::kCentroid, 0.25, kNever};
  return {CrispRanges::Of::kCentroid, 0.5, 0.5};
}

/// The class a rule concludes: the weighted mean of its sets' positions, a half counting as the worse one.
Verdict conclude(const Rule& rule, const LearnedLevel& level, const std::vector<Verdict>& classes) {
  double sum = 0;
  double weights = 0;
  for (std::size_t i = 0; i < rule.sets.size(); ++i) {
    if (!rule.sets[i]) continue;
    const double weight = std::max(level.inputs[i].weight, 0.05);
    sum += weight * double(*rule.sets[i]);
    weights += weight;
  }
  return classes[std::size_t(std::floor(sum / weights + 0.5))];
}

/// One rule for every combination of sets, for every set of inputs that may be measured.
std::vector<Rule> all_rules(const LearnedLevel& level, const std::vector<Verdict>& classes) {
  std::vector<Rule> rules{Rule{}};
  for (std::size_t i = 0; i < level.inputs.size(); ++i) {
    std::vector<Rule> longer;
    for (const Rule& rule : rules) {
      const bool may_be_absent = level.inputs[i].quantity != Quantity::kError;
      for (std::size_t set = 0; set < classes.size() + (may_be_absent ? 1 : 0); ++set) {
        Rule extended = rule;
        extended.sets.push_back(set < classes.size() ? std::optional(set) : std::nullopt);
        longer.push_back(std::move(extended));
      }
    }
    rules = std::move(longer);
  }
  for (Rule& rule : rules) rule.then = conclude(rule, level, classes);
  return rules;
}

RuleBase build(const std::vector<LearnedLevel>& levels, const std::vector<Verdict>& classes,
               const LearnOptions& options) {
  RuleBase base{.name = options.name, .version = options.version, .description = options.description};
  base.window = options.window;
  // The degrees of an input's sets add up to 1 and the conclusions are triangles of one area, so with products and sums
  // the centroid interpolates between the conclusions of a monotone rule table: several inputs stay monotone.
  base.conjunction = Conjunction::kProduct;
  const bool several = std::any_of(levels.begin(), levels.end(), [](const auto& l) { return l.inputs.size() > 1; });
  if (several) {
    base.implication = Implication::kProduct;
    base.aggregation = Aggregation::kSum;
  }
  for (const LearnedLevel& learned : levels) {
    LevelRules level{.name = level_name(learned.level_a), .level_a = learned.level_a};
    for (const LearnedInput& input : learned.inputs) level.inputs.push_back(fuzzy_input(input, classes));
    for (const Verdict verdict : classes) level.output.push_back(output_set(verdict));
    level.rules = all_rules(learned, classes);
    level.crisp = crisp_ranges(classes);
    base.levels.push_back(std::move(level));
  }
  return base;
}

/// Valves of the labels that the base gets wrong, on the levels each of them has.
std::size_t count_wrong(const RuleBase& base, std::span<const LabelledValve> valves) {
  std::size_t wrong = 0;
  for (const LabelledValve& valve : valves) {
    const auto classified = classify(base, valve.levels);
    Verdict verdict = Verdict::kGood;
    if (classified) {
      for (const LevelClassification& level : classified->per_level) verdict = std::max(verdict, level.verdict);
    }
    if (!classified || verdict != valve.verdict) ++wrong;
  }
  return wrong;
}

Result<std::vector<Verdict>> labelled_classes(std::span<const LabelledValve> valves, std::size_t fewest) {
  std::array<std::size_t, kVerdictCount> count{};
  for (const LabelledValve& valve : valves) ++count[index_of(valve.verdict)];
  std::vector<Verdict> classes;
  bool enough = count[index_of(Verdict::kGood)] > 0;
  for (const Verdict verdict : kVerdicts) {
    const std::size_t n = count[index_of(verdict)];
    if (n > 0) classes.push_back(verdict);
    enough = enough && (n == 0 || n >= fewest);
  }
  if (!enough || classes.size() < 2) {
    return fail(
        "too_few_labels",
        fmt::format("a rule base needs at least {0} valves labelled Good and at least {0} of each other class that "
                    "is labelled; found {1} Good, {2} Malfunctioned, {3} Severe",
                    fewest, count[0], count[1], count[2]));
  }
  return classes;
}

Result<void> require_finite(std::span<const LabelledValve> valves) {
  for (std::size_t v = 0; v < valves.size(); ++v) {
    for (const LevelFeatures& features : valves[v].levels) {
      for (const Quantity quantity : kQuantities) {
        const auto value = value_of(features, quantity);
        if (!std::isfinite(value.value_or(0)) || !std::isfinite(features.level_a)) {
          return fail("not_finite", fmt::format("valve {}: {} is not a finite number", v + 1, to_string(quantity)));
        }
      }
    }
  }
  return {};
}

void append_further_inputs(std::span<const LabelledValve> valves, const std::vector<Verdict>& classes,
                           const LearnOptions& options, LearnedLevel& level, std::vector<std::string>& notes) {
  for (const Quantity quantity : {Quantity::kSettlingError, Quantity::kRiseTime, Quantity::kBandwidthTime}) {
    const ByClass values = values_by_class(valves, level.level_a, quantity);
    const bool measured = std::any_of(values.begin(), values.end(), [](const auto& v) { return !v.empty(); });
    if (!measured) continue;
    const std::string what = fmt::format("level {}: {}", level_name(level.level_a), to_string(quantity));
    if (!has_enough(values, classes, options.fewest_per_class)) {
      notes.push_back(fmt::format("{} left out: fewer than {} values of a class", what, options.fewest_per_class));
      continue;
    }
    LearnedInput input = place_input(values, classes, quantity);
    if (!separates(input)) {
      notes.push_back(fmt::format("{} left out: it does not separate the classes (Somers' D {:.2f}, needs {:.2f})",
                                  what, input.weight, kLeastSeparation));
      continue;
    }
    make_monotone(input);
    level.inputs.push_back(std::move(input));
  }
}

/// The levels with enough valves of every class, with the error placed.
Result<std::vector<LearnedLevel>> place_levels(std::span<const LabelledValve> valves,
                                               const std::vector<Verdict>& classes, const LearnOptions& options,
                                               std::vector<std::string>& notes) {
  std::vector<LearnedLevel> levels;
  for (const double level_a : distinct_levels(valves)) {
    const ByClass errors = values_by_class(valves, level_a, Quantity::kError);
    if (!has_enough(errors, classes, options.fewest_per_class)) {
      notes.push_back(fmt::format("level {} left out: fewer than {} valves of a class", level_name(level_a),
                                  options.fewest_per_class));
      continue;
    }
    levels.push_back({level_a, {place_input(errors, classes, Quantity::kError)}});
    make_monotone(levels.back().inputs.front());
  }
  if (levels.empty()) {
    return fail("level_missing", fmt::format("no current level has at least {} valves of every labelled class",
                                             options.fewest_per_class));
  }
  return levels;
}

}  // namespace

double quantile(std::vector<double> values, double probability) {
  std::sort(values.begin(), values.end());
  const double position = probability * double(values.size() - 1);
  const auto below = std::size_t(position);
  if (below + 1 >= values.size()) return values.back();
  return std::lerp(values[below], values[below + 1], position - double(below));
}

Result<LearnedRuleBase> learn_rule_base(std::span<const LabelledValve> valves, const LearnOptions& options) {
  if (auto finite = require_finite(valves); !finite) return tl::unexpected(finite.error());
  const auto classes = labelled_classes(valves, options.fewest_per_class);
  if (!classes) return tl::unexpected(classes.error());
  LearnedRuleBase learned;
  for (const Verdict verdict : kVerdicts) {
    if (std::find(classes->begin(), classes->end(), verdict) == classes->end()) {
      learned.notes.push_back(
          fmt::format("no valve is labelled {}: this rule base never gives that verdict", to_string(verdict)));
    }
  }
  auto levels = place_levels(valves, *classes, options, learned.notes);
  if (!levels) return tl::unexpected(levels.error());
  if (!every_level_separates(valves, *classes, *levels)) {
    for (std::size_t k = 0; k + 1 < classes->size(); ++k) place_jointly(valves, *classes, k, *levels);
  }
  for (LearnedLevel& level : *levels) make_monotone(level.inputs.front());
  learned.base = build(*levels, *classes, options);
  learned.wrong = count_wrong(learned.base, valves);

  std::vector<LearnedLevel> extended = *levels;
  for (LearnedLevel& level : extended) append_further_inputs(valves, *classes, options, level, learned.notes);
  RuleBase richer = build(extended, *classes, options);
  const std::size_t richer_wrong = count_wrong(richer, valves);
  const auto sound = require_sound(richer);
  if (sound && richer_wrong <= learned.wrong) {
    learned.base = std::move(richer);
    learned.wrong = richer_wrong;
  } else {
    learned.notes.push_back(sound ? "further inputs left out: with them more of the labelled valves are wrong"
                                  : "further inputs left out: " + sound.error().message);
  }
  return learned;
}

}  // namespace valvetriage
