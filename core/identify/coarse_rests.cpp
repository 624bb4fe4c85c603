#include "core/identify/coarse_rests.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/recording/segments.h"
#include "core/recording/white_noise.h"

namespace valvetriage {
namespace {

// Fewer codes may be the levels of a test.
constexpr std::size_t kFewestCodes = 20;
constexpr double kSameSpacing = 0.02;  // of a quantum: what text rounds
constexpr double kNextCode = 0.5;      // of the gaps between codes that are seen: more are one quantum where it moves
// Of a quantum: an error of less than a hundredth of it is no reason to look at rests.
constexpr double kLeastOfVariance = 1e-4;

/// The spacing of the values of one input; 0 where they lie anyhow.
double quantum_of(const std::vector<double>& input) {
  std::vector<double> codes = input;
  std::sort(codes.begin(), codes.end());
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
  if (codes.size() < kFewestCodes || 4 * codes.size() > input.size()) return 0;
  std::vector<double> gaps;
  for (std::size_t i = 1; i < codes.size(); ++i) gaps.push_back(codes[i] - codes[i - 1]);
  const double least = *std::min_element(gaps.begin(), gaps.end());
  std::size_t next = 0;
  for (const double gap : gaps) {
    const double quanta = gap / least;
    if (std::abs(quanta - std::round(quanta)) > kSameSpacing * std::round(quanta)) return 0;
    next += quanta < 1.5;
  }
  return static_cast<double>(next) >= kNextCode * static_cast<double>(gaps.size()) ? least : 0;
}

}  // namespace

double input_quantum(std::span<const Recording> recordings) {
  double quantum = 0;
  for (const Recording& recording : recordings) {
    const double own = oscillates(recording) ? quantum_of(recording.input.values) : 0;
    if (own > 0 && (quantum == 0 || own < quantum)) quantum = own;
  }
  return quantum;
}

std::vector<CoarseRest> coarse_rests(const Recording& recording, double quantum) {
  if (!(quantum > 0)) return {};
  const double uniform = quantum * quantum / 12, logged = white_noise(recording.input.values);
  const double ahead = std::max(0.0, logged * logged - uniform);  // variance of the noise that was rounded
  const double share = std::exp(-4 * std::numbers::pi * std::numbers::pi * ahead / (quantum * quantum));
  if (share < kLeastOfVariance) return {};
  std::vector<CoarseRest> rests;
  for (const Segment& segment : recording.segments) {
    if (segment.kind != SegmentKind::kHold && segment.kind != SegmentKind::kStep) continue;
    rests.push_back({segment.begin, segment.end, share * uniform});
  }
  return rests;
}

}  // namespace valvetriage
