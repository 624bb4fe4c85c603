#include "core/analysis/outside_reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace valvetriage {
namespace {

// Inputs this far beyond the reference's still lie in its end knots, half a spacing away.
constexpr double kMargin_a = 0.0125;
constexpr std::size_t kInterruption = 10;
// A recording may go beyond the reference by this share of its inputs and still be taken for one of the same valve.
constexpr double kSlack = 0.25;

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void add(std::span<const double> values) {
    for (const double value : values) {
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  Range times(double factor) const {
    return {std::min(factor * low, factor * high), std::max(factor * low, factor * high)};
  }
};

/// What the numbers would have to be for the reference to know them; empty where nothing is known that would do.
std::string likely_slip(const Range& inputs, const Range& outputs, const Reference& reference) {
  const double slack = kSlack * (reference.input_max - reference.input_min);
  const auto is_known = [&](const Range& range) {
    return range.low >= reference.input_min - slack && range.high <= reference.input_max + slack;
  };
  if (is_known(inputs.times(-1))) return "with the other sign they would lie within: check the sign of the current";
  if (is_known(outputs)) return "the other column would lie within: check whether the columns are swapped";
  if (is_known(inputs.times(1e-3))) return "a thousandth of it would lie within: check whether mA are called A";
  if (is_known(inputs.times(1e3))) return "a thousand times it would lie within: check whether A are called mA";
  return {};
}

std::string inputs_of(const Reference& reference) {
  return fmt::format("the reference's inputs of {:.3g} to {:.3g} A", reference.input_min, reference.input_max);
}

std::string run_from(std::span<const Recording> recordings, const Range& inputs) {
  return fmt::format("the recording{} from {:.3g} to {:.3g} A", recordings.size() == 1 ? " runs" : "s run", inputs.low,
                     inputs.high);
}

double margin_a(const Reference& reference) {
  return reference.model.loop ? kMargin_a * reference.model.loop->reach : kMargin_a;
}

}  // namespace

bool outside_reference(const Reference& reference, double input_a) {
  const double margin = margin_a(reference);
  return input_a < reference.input_min - margin || input_a > reference.input_max + margin;
}

std::vector<QualityPlace> outside_reference_places(const Recording& recording, const Reference& reference) {
  std::vector<QualityPlace> places;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    if (!outside_reference(reference, recording.input.values[i])) continue;
    if (!places.empty() && i < places.back().end + kInterruption) {
      places.back().end = i + 1;
    } else {
      places.push_back({.code = "outside_reference", .begin = i, .end = i + 1});
    }
  }
  return places;
}

std::string outside_throughout(std::span<const Recording> recordings, const Reference& reference) {
  Range inputs, outputs;
  for (const Recording& recording : recordings) {
    inputs.add(recording.input.values);
    outputs.add(recording.output.values);
  }
  const std::string slip = likely_slip(inputs, outputs, reference);
  return fmt::format("no sample lies within {}: {}; {}", inputs_of(reference), run_from(recordings, inputs),
                     slip.empty() ? "a wrong sign, swapped columns or a wrong unit look like this" : slip);
}

std::string not_comparable(std::span<const Recording> recordings, std::span<const Recording> kept,
                           const Reference& reference, double least_s) {
  double kept_s = 0;
  std::size_t samples = 0, within = 0;
  Range inputs, outputs;
  for (const Recording& recording : kept) {
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (recording.is_valid(i)) kept_s += recording.sample_period_s;
    }
  }
  for (const Recording& recording : recordings) {
    inputs.add(recording.input.values);
    outputs.add(recording.output.values);
    samples += recording.samples();
    within += static_cast<std::size_t>(std::ranges::count_if(
        recording.input.values, [&](double input) { return !outside_reference(reference, input); }));
  }
  if (within == 0) return outside_throughout(recordings, reference);
  const std::string slip = 2 * within < samples ? likely_slip(inputs, outputs, reference) : std::string{};
  if (!slip.empty()) {
    return fmt::format("most samples lie outside {}: {}; {}", inputs_of(reference), run_from(recordings, inputs), slip);
  }
  if (kept_s >= least_s) return {};
  return fmt::format("only {:.2g} s of the recordings can be compared within {}; {:.2g} s are needed at the least",
                     kept_s, inputs_of(reference), least_s);
}

}  // namespace valvetriage
