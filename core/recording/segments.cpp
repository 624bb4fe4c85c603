#include "core/recording/segments.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace valvetriage {
namespace {

constexpr std::size_t kSide = 3;              ///< samples of a median on either side of a jump
constexpr std::size_t kSlew = 3;              ///< samples that a jump may take
constexpr double kJumpSigmas = 10;            ///< a jump's height over the input's noise
constexpr double kJumpOfRange = 0.015;        ///< and over the input's range
constexpr double kJumpOverMovement = 4;       ///< and over the movement just before and after it
constexpr double kNoiseOfRange = 0.05;        ///< above it what looks like noise is the excitation
constexpr double kHoldOfRange = 0.02;         ///< most movement within a hold
constexpr double kStraightOfRange = 0.015;    ///< a straight piece follows the input this closely
constexpr std::size_t kMaxPolyPoints = 4096;  ///< points that the polyline is searched on: bounds its cost
constexpr double kMeantSamples = 8;           ///< mean length of pieces that somebody drew, rather than noise
constexpr double kPiecesPerTurn = 2.5;    ///< straight pieces per monotone leg: a triangle 1, with plateaus 2, a sine 4
constexpr double kFewestJumpSamples = 8;  ///< mean samples between jumps; below, the jumps are a random excitation

double median3(const double* x) {
  return std::max(std::min(x[0], x[1]), std::min(std::max(x[0], x[1]), x[2]));
}

struct Range {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t size() const { return end - begin; }
};

double mean_of(std::span<const double> u, Range r) {
  double sum = 0;
  for (std::size_t i = r.begin; i < r.end; ++i) sum += u[i];
  return sum / static_cast<double>(r.size());
}

/// Range of the input without single spikes.
double range_without_spikes(std::span<const double> u) {
  double low = u[0], high = u[0];
  for (std::size_t i = 0; i + kSide <= u.size(); ++i) {
    const double middle = median3(&u[i]);
    low = i == 0 ? middle : std::min(low, middle);
    high = i == 0 ? middle : std::max(high, middle);
  }
  return high - low;
}

/// Jump at `i`: what comes kSlew samples later minus what came before; 0 where the surroundings move too.
double jump_at(std::span<const double> u, std::size_t i, double threshold) {
  const double before = median3(&u[i - kSide]);
  const double after = median3(&u[i + kSlew]);
  const double jump = after - before;
  if (std::abs(jump) < threshold) return 0;
  const double moved_before = std::abs(before - median3(&u[i - 2 * kSide]));
  const double moved_after = std::abs(median3(&u[i + kSlew + kSide]) - after);
  return std::abs(jump) > kJumpOverMovement * (moved_before + moved_after) ? jump : 0;
}

/// First sample past half of the jump found around [first, last].
std::size_t edge_of(std::span<const double> u, std::size_t first, std::size_t last, double jump) {
  const double from = median3(&u[first - kSide]);
  for (std::size_t i = first; i <= last + kSlew; ++i) {
    if (std::abs(u[i] - from) > 0.5 * std::abs(jump) && (u[i] > from) == (jump > 0)) return i;
  }
  return last + kSlew;
}

std::vector<std::size_t> find_edges(std::span<const double> u, double sigma, double range) {
  std::vector<std::size_t> edges;
  const double threshold = std::max(kJumpSigmas * sigma, kJumpOfRange * range);
  const std::size_t reach = kSlew + 2 * kSide;
  for (std::size_t i = 2 * kSide; i + reach <= u.size(); ++i) {
    double jump = jump_at(u, i, threshold);
    if (jump == 0) continue;
    const std::size_t first = i;
    for (double next = jump; i + 1 + reach <= u.size() && next != 0; ++i) {
      next = jump_at(u, i + 1, threshold);
      if (std::abs(next) > std::abs(jump)) jump = next;
      if (next == 0) break;
    }
    const std::size_t edge = edge_of(u, first, i, jump);
    if (edges.empty() || edge > edges.back() + kSide) edges.push_back(edge);
    i = std::max(i, edge);
  }
  return edges;
}

/// The input thinned to at most kMaxPolyPoints means of equal blocks.
struct Thinned {
  std::vector<double> values;
  std::size_t block = 1;
};

Thinned thin(std::span<const double> u, Range r) {
  Thinned thinned;
  thinned.block = (r.size() + kMaxPolyPoints - 1) / kMaxPolyPoints;
  for (std::size_t at = r.begin; at < r.end; at += thinned.block) {
    thinned.values.push_back(mean_of(u, {at, std::min(at + thinned.block, r.end)}));
  }
  return thinned;
}

/// Corners of the polyline that follows `x` within `tolerance` (Douglas and Peucker 1973), first and last included.
std::vector<std::size_t> corners_of(const std::vector<double>& x, double tolerance) {
  std::vector<std::size_t> corners{0, x.size() - 1};
  std::vector<Range> open{{0, x.size() - 1}};
  while (!open.empty()) {
    const Range chord = open.back();
    open.pop_back();
    if (chord.size() < 2) continue;
    const double slope = (x[chord.end] - x[chord.begin]) / static_cast<double>(chord.size());
    double worst = tolerance;
    std::size_t at = 0;
    for (std::size_t i = chord.begin + 1; i < chord.end; ++i) {
      const double off = std::abs(x[i] - x[chord.begin] - slope * static_cast<double>(i - chord.begin));
      if (off > worst) {
        worst = off;
        at = i;
      }
    }
    if (at == 0) continue;
    corners.push_back(at);
    open.push_back({chord.begin, at});
    open.push_back({at, chord.end});
  }
  std::ranges::sort(corners);
  return corners;
}

/// Monotone legs of `x`, movements below `threshold` ignored.
std::size_t count_legs(const std::vector<double>& x, double threshold) {
  std::size_t legs = 1;
  double low = x[0], high = x[0];
  int direction = 0;
  for (const double value : x) {
    low = std::min(low, value);
    high = std::max(high, value);
    if (direction >= 0 && value < high - threshold) {
      legs += direction > 0;
      direction = -1;
      low = value;
    } else if (direction <= 0 && value > low + threshold) {
      legs += direction < 0;
      direction = 1;
      high = value;
    }
    if (direction > 0) low = value;
    if (direction < 0) high = value;
  }
  return legs;
}

Segment hold_of(std::span<const double> u, Range r) {
  return {.kind = SegmentKind::kHold, .begin = r.begin, .end = r.end, .level = mean_of(u, r)};
}

/// Straight pieces of a stretch that moves, as ramps and holds; one sweep where straight pieces do not describe it.
void split_movement(std::span<const double> u, Range r, double range, double sigma, double period_s,
                    std::vector<Segment>& out) {
  const Thinned thinned = thin(u, r);
  const double noise = 4 * sigma / std::sqrt(static_cast<double>(thinned.block));
  const double tolerance = std::max(kStraightOfRange * range, noise);
  const std::vector<std::size_t> corners = corners_of(thinned.values, tolerance);
  const auto pieces = static_cast<double>(corners.size() - 1);
  const auto legs = static_cast<double>(count_legs(thinned.values, 2 * tolerance));
  if (pieces > kPiecesPerTurn * legs || static_cast<double>(thinned.values.size()) < kMeantSamples * pieces) {
    Segment sweep = hold_of(u, r);
    sweep.kind = SegmentKind::kSweep;
    out.push_back(sweep);
    return;
  }
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const bool last = c + 2 == corners.size();
    const Range piece{r.begin + corners[c] * thinned.block, last ? r.end : r.begin + corners[c + 1] * thinned.block};
    const double from = thinned.values[corners[c]];
    const double to = thinned.values[corners[c + 1]];
    Segment segment = hold_of(u, piece);
    if (std::abs(to - from) > kHoldOfRange * range) {
      segment.kind = SegmentKind::kRamp;
      segment.level = to;
      segment.from_level = from;
      segment.rate_per_s = (to - from) / (static_cast<double>(piece.size()) * period_s);
    }
    out.push_back(segment);
  }
}

/// Whether the input stays within its noise and kHoldOfRange of the range, by the means of eight parts.
bool is_hold(std::span<const double> u, Range r, double range, double sigma) {
  const std::size_t parts = std::min<std::size_t>(8, r.size());
  double low = 0, high = 0;
  for (std::size_t k = 0; k < parts; ++k) {
    const Range part{r.begin + k * r.size() / parts, r.begin + (k + 1) * r.size() / parts};
    const double mean = mean_of(u, part);
    low = k == 0 ? mean : std::min(low, mean);
    high = k == 0 ? mean : std::max(high, mean);
  }
  const double level = mean_of(u, r);
  double square = 0;
  for (std::size_t i = r.begin; i < r.end; ++i) square += (u[i] - level) * (u[i] - level);
  const double spread = std::sqrt(square / static_cast<double>(r.size()));
  return high - low <= kHoldOfRange * range + sigma && spread <= kHoldOfRange * range + 1.5 * sigma;
}

/// A hold behind a jump is a step.
void mark_jump(std::span<const double> u, std::size_t edge, Segment& after) {
  if (after.kind != SegmentKind::kHold) {
    after.from_jump = true;
    return;
  }
  after.kind = SegmentKind::kStep;
  // the level just before the edge, whatever came before: a hold's mean, a ramp's end
  const Range before{edge >= 2 * kSide ? edge - 2 * kSide : 0, edge - std::min<std::size_t>(edge, kSide)};
  after.from_level = before.size() > 0 ? mean_of(u, before) : u[0];
}

/// A hold's level is its mean past the samples that the step may take.
double settled_level(std::span<const double> u, const Segment& step) {
  const std::size_t begin = std::min(step.begin + kSlew, step.end - 1);
  return mean_of(u, {begin, step.end});
}

std::size_t samples_of(const std::vector<Segment>& segments, SegmentKind kind) {
  std::size_t samples = 0;
  for (const Segment& segment : segments) samples += segment.kind == kind ? segment.end - segment.begin : 0;
  return samples;
}

/// A random excitation has jumps and pauses that nobody drew: where most of the input is a sweep, all of it is one but
/// for a hold at its start and its end.
void join_sweeps(std::span<const double> u, std::vector<Segment>& segments) {
  if (2 * samples_of(segments, SegmentKind::kSweep) <= u.size()) return;
  const auto moves = [](const Segment& segment) { return segment.kind != SegmentKind::kHold; };
  const auto first = std::ranges::find_if(segments, moves);
  const auto last = std::find_if(segments.rbegin(), segments.rend(), moves).base();
  *first = hold_of(u, {first->begin, std::prev(last)->end});
  first->kind = SegmentKind::kSweep;
  segments.erase(std::next(first), last);
}

}  // namespace

double noise_of(std::span<const double> values) {
  if (values.size() < 3) return 0;
  std::vector<double> second(values.size() - 2);
  for (std::size_t i = 0; i + 2 < values.size(); ++i)
    second[i] = std::abs(values[i] - 2 * values[i + 1] + values[i + 2]);
  const auto middle = second.begin() + static_cast<std::ptrdiff_t>(second.size() / 2);
  std::ranges::nth_element(second, middle);
  return *middle / (0.6745 * std::sqrt(6.0));
}

std::vector<Segment> find_segments(std::span<const double> input, double sample_period_s) {
  if (input.size() < 4 * kSide + kSlew) return {};
  const double range = range_without_spikes(input);
  const double sigma = std::min(noise_of(input), kNoiseOfRange * range);
  std::vector<std::size_t> edges = find_edges(input, sigma, range);
  if (static_cast<double>(edges.size()) * kFewestJumpSamples > static_cast<double>(input.size())) edges.clear();

  std::vector<Segment> segments;
  std::size_t begin = 0;
  for (std::size_t k = 0; k <= edges.size(); ++k) {
    const Range piece{begin, k < edges.size() ? edges[k] : input.size()};
    const std::size_t first = segments.size();
    if (is_hold(input, piece, range, sigma)) {
      segments.push_back(hold_of(input, piece));
    } else {
      split_movement(input, piece, range, sigma, sample_period_s, segments);
    }
    if (k > 0) {
      mark_jump(input, begin, segments[first]);
      if (segments[first].kind == SegmentKind::kStep) {
        segments[first].level = settled_level(input, segments[first]);
        if (first > 0 && segments[first - 1].kind != SegmentKind::kRamp &&
            segments[first - 1].kind != SegmentKind::kSweep) {
          segments[first].from_level = segments[first - 1].level;
        }
      }
    }
    begin = piece.end;
  }
  join_sweeps(input, segments);
  return segments;
}

TestKind infer_test(const std::vector<Segment>& segments) {
  std::size_t total = 0, ramps = 0, sweeps = 0, steps = 0, onward = 0;
  double last_rise = 0;
  for (const Segment& segment : segments) {
    const std::size_t size = segment.end - segment.begin;
    total += size;
    if (segment.kind == SegmentKind::kRamp) ramps += size;
    if (segment.kind == SegmentKind::kSweep) sweeps += size;
    if (segment.kind != SegmentKind::kStep) continue;
    const double rise = segment.level - segment.from_level;
    onward += rise * last_rise > 0;
    last_rise = rise;
    ++steps;
  }
  if (2 * sweeps > total) return TestKind::kSweep;
  if (2 * ramps > total) return TestKind::kTriangle;
  if (steps >= 3 && 2 * onward >= steps - 1) return TestKind::kStaircase;
  return steps > 0 ? TestKind::kStep : TestKind::kOther;
}

bool oscillates(const Recording& recording) {
  std::size_t moving = 0;
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kSweep) moving += segment.end - segment.begin;
  }
  return 2 * moving > recording.samples();
}

}  // namespace valvetriage
