#include "core/recording/quality.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "core/recording/feedback.h"
#include "core/recording/segments.h"

namespace valvetriage {
namespace {

constexpr double kCoarseSigmas = 2;      ///< a level step over the noise: its rounding error is then 0.6 of it
constexpr double kCoarseOfRange = 1e-3;  ///< and over the range: ten bits
constexpr std::size_t kLevelVisits = 5;  ///< samples that make a value a level
constexpr std::size_t kFewestLevelSteps = 3;
constexpr double kEqualSteps = 0.2;  ///< relative difference of steps that count as equal

constexpr double kRunChance = 1e-9;  ///< of a run of equal values by the output's own repeats
constexpr std::size_t kFewestClipped = 8;
constexpr std::size_t kFewestStuck = 20;
constexpr double kNoiselessRepeats = 0.8;   ///< share of repeats above which a run says nothing by itself
constexpr double kNoiselessOfRange = 1e-5;  ///< noise below this part of the range: a simulated output
constexpr double kInputTravel = 0.05;       ///< of the input's range, while the output stays
constexpr double kTravelRatio = 4;          ///< and over what the other levels of a coarse output see

constexpr double kOutlierSigmas = 10;  ///< 8 deviations of a second difference: 2e-16 a sample in white noise
constexpr double kOutlierOfRange = 0.03;
constexpr double kOutlierOverMovement = 4;
constexpr double kOutlierOverStep = 1.5;  ///< a flicker between two levels is no outlier
constexpr double kRepairableShare = 0.01;

struct Extremes {
  double low = 0;
  double high = 0;
  double range() const { return high - low; }
};

Extremes extremes_of(const std::vector<double>& values) {
  const auto [low, high] = std::ranges::minmax(values);
  return {low, high};
}

double time_at(const Recording& recording, std::size_t i) {
  return recording.start_s + static_cast<double>(i) * recording.sample_period_s;
}

std::string quantity(double value, const std::string& unit) {
  return unit.empty() ? fmt::format("{:.6g}", value) : fmt::format("{:.6g} {}", value, unit);
}

// ---- quantised ----------------------------------------------------------------------------------------------------

struct Level {
  double value = 0;
  std::size_t samples = 0;
};

std::vector<Level> levels_of(std::vector<double> values) {
  std::ranges::sort(values);
  std::vector<Level> levels;
  for (const double value : values) {
    if (levels.empty() || levels.back().value != value) levels.push_back({value, 0});
    ++levels.back().samples;
  }
  return levels;
}

/// Indices k where levels k and k + 1 are neighbours in a coarse scale.
std::vector<std::size_t> coarse_steps(const std::vector<Level>& levels, double least) {
  std::vector<std::size_t> steps;
  std::vector<double> sizes;
  for (std::size_t k = 0; k + 1 < levels.size(); ++k) {
    const double size = levels[k + 1].value - levels[k].value;
    if (size < least || levels[k].samples < kLevelVisits || levels[k + 1].samples < kLevelVisits) continue;
    steps.push_back(k);
    sizes.push_back(size);
  }
  if (steps.empty()) return steps;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::ranges::nth_element(sizes, middle);
  const double typical = *middle;
  std::erase_if(steps, [&](std::size_t k) {
    return std::abs(levels[k + 1].value - levels[k].value - typical) > kEqualSteps * typical;
  });
  return steps;
}

/// The largest coarse step; 0 where there is none.
double largest_of(const std::vector<Level>& levels, const std::vector<std::size_t>& steps) {
  double largest = 0;
  for (const std::size_t k : steps) largest = std::max(largest, levels[k + 1].value - levels[k].value);
  return largest;
}

double coarse_step_of(const std::vector<double>& output, const Extremes& extremes, double sigma) {
  const std::vector<Level> levels = levels_of(output);
  return largest_of(levels, coarse_steps(levels, std::max(kCoarseSigmas * sigma, kCoarseOfRange * extremes.range())));
}

/// The largest coarse step; 0 where the output is fine.
double judge_quantisation(Recording& recording, const Extremes& extremes, double sigma) {
  const Channel& output = recording.output;
  const std::vector<Level> levels = levels_of(output.values);
  const std::vector<std::size_t> steps =
      coarse_steps(levels, std::max(kCoarseSigmas * sigma, kCoarseOfRange * extremes.range()));
  if (steps.size() < kFewestLevelSteps) return 0;

  std::size_t samples = 0;
  std::string where;
  for (std::size_t at = 0; at < steps.size();) {
    std::size_t last = at;
    while (last + 1 < steps.size() && steps[last + 1] == steps[last] + 1) ++last;
    for (std::size_t k = steps[at]; k <= steps[last] + 1; ++k) samples += levels[k].samples;
    where += fmt::format("{}from {:.6g} to {}", where.empty() ? "" : " and ", levels[steps[at]].value,
                         quantity(levels[steps[last] + 1].value, output.unit));
    at = last + 1;
  }
  const double step = levels[steps[steps.size() / 2] + 1].value - levels[steps[steps.size() / 2]].value;
  if (where.size() > 200)
    where = fmt::format("in parts of {:.6g} to {}", extremes.low, quantity(extremes.high, output.unit));
  recording.quality.push_back(
      {.code = "quantised",
       .detail = fmt::format("{} comes in steps of {} {}", output.quantity, quantity(step, output.unit), where),
       .count = samples});
  return largest_of(levels, steps);
}

// ---- clipped, stuck -----------------------------------------------------------------------------------------------

struct Run {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t size() const { return end - begin; }
};

std::vector<Run> runs_of(const std::vector<double>& values) {
  std::vector<Run> runs;
  for (std::size_t i = 0; i < values.size();) {
    std::size_t end = i + 1;
    while (end < values.size() && values[end] == values[i]) ++end;
    runs.push_back({i, end});
    i = end;
  }
  return runs;
}

/// Runs of equal values by the output's own habit: how often neighbours are equal, and how far the input goes
/// meanwhile.
struct Repeats {
  double share = 0;           ///< of neighbours that are equal, in runs too short to be judged
  double longest = 0;         ///< samples; a run above it is not chance
  double typical_travel = 0;  ///< of the input during a run of two samples or more
};

double travel_of(const std::vector<double>& input, Run run) {
  const auto [low, high] = std::ranges::minmax(std::span(input).subspan(run.begin, run.size()));
  return high - low;
}

Repeats repeats_of(const std::vector<Run>& runs, const std::vector<double>& input) {
  std::size_t equal = 0, pairs = 1;
  std::vector<double> travels{0};
  for (const Run& run : runs) {
    if (run.size() > 1) travels.push_back(travel_of(input, run));
    if (run.size() >= kFewestStuck) continue;
    equal += run.size() - 1;
    pairs += run.size();
  }
  Repeats repeats;
  const double share = static_cast<double>(equal) / static_cast<double>(pairs);
  repeats.share = equal == 0 && runs.size() < 2 * kFewestStuck ? 1.0 : std::max(share, 0.01);
  repeats.longest =
      1 + std::log(kRunChance / static_cast<double>(input.size())) / std::log(std::min(repeats.share, 0.999));
  const auto middle = travels.begin() + static_cast<std::ptrdiff_t>(travels.size() / 2);
  std::ranges::nth_element(travels, middle);
  repeats.typical_travel = *middle;
  return repeats;
}

/// Runs of equal output that say something.
struct TellingRuns {
  std::vector<Run> at_low, at_high;  ///< at the output's least or greatest value
  std::vector<Run> stuck;            ///< at any other
};

/// A coarse output, or one without noise, repeats its values: there only what the input does tells a limit, and nothing
/// tells a stuck sensor.
TellingRuns telling_runs(const Recording& recording, const Extremes& extremes, bool can_repeat) {
  const std::vector<double>& output = recording.output.values;
  const std::vector<Run> runs = runs_of(output);
  const Repeats repeats = repeats_of(runs, recording.input.values);
  const bool noisy = !can_repeat && repeats.share < kNoiselessRepeats;
  const double far =
      std::max(kInputTravel * extremes_of(recording.input.values).range(), kTravelRatio * repeats.typical_travel);
  TellingRuns telling;
  for (const Run& run : runs) {
    const double level = output[run.begin];
    const bool improbable = noisy && static_cast<double>(run.size()) > repeats.longest;
    if (level == extremes.low || level == extremes.high) {
      const bool held = run.size() >= kFewestClipped && (improbable || travel_of(recording.input.values, run) > far);
      if (held) (level == extremes.low ? telling.at_low : telling.at_high).push_back(run);
    } else if (run.size() >= kFewestStuck && improbable) {
      telling.stuck.push_back(run);
    }
  }
  return telling;
}

bool repeats_by_itself(const Extremes& extremes, double sigma, double level_step) {
  return level_step > 0 || sigma < kNoiselessOfRange * extremes.range();
}

/// One value from the first sample to the last: a live gauge has noise, at rest too.
bool is_frozen(const Recording& recording, const Extremes& output) {
  return output.range() == 0 && recording.samples() >= kFewestStuck && extremes_of(recording.input.values).range() > 0;
}

std::size_t samples_of(const std::vector<Run>& runs) {
  std::size_t samples = 0;
  for (const Run& run : runs) samples += run.size();
  return samples;
}

void judge_runs(Recording& recording, const Extremes& extremes, bool can_repeat) {
  const auto [at_low, at_high, stuck] = telling_runs(recording, extremes, can_repeat);
  std::string where;
  for (const auto* visits : {&at_low, &at_high}) {
    if (visits->empty()) continue;
    where += fmt::format("{}exactly {} on {} visit{}, the first after {:.6g} s", where.empty() ? "" : " and ",
                         quantity(visits == &at_low ? extremes.low : extremes.high, recording.output.unit),
                         visits->size(), visits->size() == 1 ? "" : "s", time_at(recording, visits->front().begin));
  }
  if (!where.empty()) {
    recording.quality.push_back({.code = "clipped",
                                 .detail = fmt::format("{} held at {}", recording.output.quantity, where),
                                 .count = samples_of(at_low) + samples_of(at_high)});
  }
  if (is_frozen(recording, extremes)) {
    recording.quality.push_back(
        {.code = "stuck",
         .detail = fmt::format("{} is exactly {} throughout while the input moves: the gauge or its cable is dead, or "
                               "the valve does not follow at all",
                               recording.output.quantity, quantity(extremes.low, recording.output.unit)),
         .count = recording.samples()});
  }
  if (!stuck.empty()) {
    recording.quality.push_back(
        {.code = "stuck",
         .detail = fmt::format("{} does not change at all in {} stretch{}, the first after {:.6g} s",
                               recording.output.quantity, stuck.size(), stuck.size() == 1 ? "" : "es",
                               time_at(recording, stuck.front().begin)),
         .count = samples_of(stuck)});
  }
}

// ---- outliers -----------------------------------------------------------------------------------------------------

/// Whether `width` samples from `i` on stand off both neighbours by more than `least`, which stand together.
bool is_spike(const std::vector<double>& y, std::size_t i, std::size_t width, double least) {
  const double before = y[i - 1], after = y[i + width];
  const double movement =
      std::max({std::abs(after - before), std::abs(before - y[i - 2]), std::abs(y[i + width + 1] - after)});
  const double base = 0.5 * (before + after);
  const double threshold = std::max(least, kOutlierOverMovement * movement);
  const bool up = y[i] > base;
  for (std::size_t k = i; k < i + width; ++k) {
    if (std::abs(y[k] - base) <= threshold || (y[k] > base) != up) return false;
  }
  return true;
}

std::vector<Run> spikes_of(const std::vector<double>& y, const Extremes& extremes, double sigma, double level_step) {
  const double least =
      std::max({kOutlierSigmas * sigma, kOutlierOfRange * extremes.range(), kOutlierOverStep * level_step});
  std::vector<Run> spikes;
  for (std::size_t i = 2; i + 3 < y.size(); ++i) {
    for (const std::size_t width : {std::size_t{1}, std::size_t{2}}) {
      if (!is_spike(y, i, width, least)) continue;
      spikes.push_back({i, i + width});
      i += width;
      break;
    }
  }
  return spikes;
}

void judge_outliers(Recording& recording, const Extremes& extremes, double sigma, double level_step) {
  std::vector<double>& y = recording.output.values;
  const std::vector<Run> spikes = spikes_of(y, extremes, sigma, level_step);
  const std::size_t samples = samples_of(spikes);
  if (spikes.empty()) return;

  const bool repaired = static_cast<double>(samples) <= kRepairableShare * static_cast<double>(y.size());
  if (repaired) {
    if (recording.valid.empty()) recording.valid.assign(y.size(), 1);
    for (const Run& spike : spikes) {
      for (std::size_t k = spike.begin; k < spike.end; ++k) {
        y[k] = 0.5 * (y[spike.begin - 1] + y[spike.end]);
        recording.valid[k] = 0;
      }
    }
  }
  recording.quality.push_back(
      {.code = "outliers",
       .detail = fmt::format("{} single samples of {} far off their neighbours, the first after "
                             "{:.6g} s; {}",
                             samples, recording.output.quantity, time_at(recording, spikes.front().begin),
                             repaired ? "left out" : "too many to leave out"),
       .count = samples});
}

/// Whether the file has a stamp within the run.
bool is_stamped(const Recording& recording, Run run) {
  const double half = 0.5 * recording.sample_period_s;
  const auto stamp = std::ranges::lower_bound(recording.time_s, time_at(recording, run.begin) - half);
  return stamp != recording.time_s.end() && *stamp < time_at(recording, run.end) - half;
}

// ---- feedback -----------------------------------------------------------------------------------------------------

void judge_feedback(Recording& recording) {
  const OutputFollowed followed = output_followed(recording);
  if (!followed.is_regulated()) return;
  recording.quality.push_back(
      {.code = "feedback",
       .detail = fmt::format("{:.0f} % of the changes of {} follow from {}: the record shows a "
                             "controller rather than the plant",
                             100 * followed.of_all, recording.input.quantity, recording.output.quantity),
       .count = recording.samples()});
}

}  // namespace

void judge_quality(Recording& recording) {
  const Extremes extremes = extremes_of(recording.output.values);
  const double sigma = noise_of(recording.output.values);
  const double level_step = judge_quantisation(recording, extremes, sigma);
  judge_runs(recording, extremes, repeats_by_itself(extremes, sigma, level_step));
  judge_feedback(recording);
  judge_outliers(recording, extremes, sigma, level_step);
}

std::vector<QualityPlace> quality_places(const Recording& recording) {
  const auto has = [&](std::string_view code) {
    return std::ranges::any_of(recording.quality, [&](const QualityItem& item) { return item.code == code; });
  };
  std::vector<QualityPlace> places;
  const auto add = [&](const char* code, const std::vector<Run>& runs) {
    for (const Run& run : runs) places.push_back({.code = code, .begin = run.begin, .end = run.end});
  };
  // What was left out is marked so: in a gap there are no stamps, at an outlier there is one.
  std::vector<Run> gaps, outliers;
  for (std::size_t i = 0; i < recording.valid.size(); ++i) {
    if (recording.is_valid(i)) continue;
    Run run{i, i + 1};
    while (run.end < recording.valid.size() && !recording.is_valid(run.end)) ++run.end;
    (is_stamped(recording, run) ? outliers : gaps).push_back(run);
    i = run.end;
  }
  const std::vector<double>& y = recording.output.values;
  const Extremes extremes = extremes_of(y);
  const double sigma = noise_of(y);
  const double level_step = has("quantised") ? coarse_step_of(y, extremes, sigma) : 0;
  if (has("gap")) add("gap", gaps);
  if (has("outliers")) add("outliers", outliers.empty() ? spikes_of(y, extremes, sigma, level_step) : outliers);
  if (has("stuck") && is_frozen(recording, extremes)) add("stuck", {{0, y.size()}});
  const auto [at_low, at_high, stuck] =
      telling_runs(recording, extremes, repeats_by_itself(extremes, sigma, level_step));
  if (has("clipped")) {
    add("clipped", at_low);
    add("clipped", at_high);
  }
  if (has("stuck")) add("stuck", stuck);
  std::ranges::stable_sort(places, {}, &QualityPlace::begin);
  return places;
}

}  // namespace valvetriage
