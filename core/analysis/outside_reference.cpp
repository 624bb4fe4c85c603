#include "core/analysis/outside_reference.h"

namespace valvetriage {
namespace {

// Inputs this far beyond the reference's still lie in its end knots, half a spacing away.
constexpr double kMargin_a = 0.0125;
constexpr std::size_t kInterruption = 10;

}  // namespace

bool outside_reference(const Reference& reference, double input_a) {
  return input_a < reference.input_min - kMargin_a || input_a > reference.input_max + kMargin_a;
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

}  // namespace valvetriage
