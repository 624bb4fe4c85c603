#include "core/discrepancy/input_lines.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <set>

#include "core/discrepancy/evidence.h"
#include "core/discrepancy/tones.h"
#include "core/discrepancy/valve_contest.h"
#include "core/linear_algebra/solve.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostLines = 3;
// A line of the log stands in this many recordings at least, where there are so many.
constexpr std::size_t kEnough = 2;
// Of a sine and a cosine at a known frequency: χ² of two freedoms at 1e-4.
constexpr double kInInput = 18.4;
// A line, not a wander: this many times what stands two or three resolved frequencies beside it.
constexpr double kOverNeighbours = 4;
// That the output does not follow it: what the squared error of a recording loses without it, in noise variances. The
// line itself is certain, so no search is paid for: χ² of two freedoms at 1e-2.
constexpr double kInResidual = 9.2;
// What is a jump of the input: this many of the median step.
constexpr double kJump = 12;
constexpr std::size_t kShortestStretch = 16;
// Variance beside the line over that of the fast noise: 1 where the input rests or goes straight.
constexpr double kAtRest = 2;

/// First samples of the stretches that go straight, by jumps of the input and by the corners of its ramps, and the end.
std::vector<std::size_t> stretches_of(const Recording& recording) {
  const std::vector<double>& input = recording.input.values;
  std::vector<double> steps;
  for (std::size_t i = 1; i < input.size(); ++i) steps.push_back(std::abs(input[i] - input[i - 1]));
  std::vector<double> sorted = steps;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double jump = kJump * std::max(*middle, 1e-12);
  std::set<std::size_t> first{0, input.size()};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] > jump) first.insert(i + 1);
  }
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kRamp) first.insert({segment.begin, segment.end});
  }
  return {first.begin(), first.end()};
}

/// Σ over the stretches of what a sine and a cosine share with the input, straight lines taken off each.
struct LineSums {
  Eigen::Matrix2d a = Eigen::Matrix2d::Zero();
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  double squares = 0;
  double freedoms = 0;
  double fast = 0, fasts = 0;  ///< squares of second differences: six noise variances each
};

void add_stretch(const Recording& recording, double rad_s, std::size_t first, std::size_t last, LineSums& sums) {
  const auto n = static_cast<Index>(last - first);
  MatrixXd columns(n, 3);  // sine, cosine, input
  VectorXd ramp(n);
  for (Index i = 0; i < n; ++i) {
    const std::size_t at = first + static_cast<std::size_t>(i);
    const double phase = rad_s * recording.sample_period_s * static_cast<double>(at);
    columns.row(i) << std::sin(phase), std::cos(phase), recording.input.values[at];
    ramp(i) = static_cast<double>(i) - 0.5 * static_cast<double>(n - 1);
  }
  columns.rowwise() -= columns.colwise().mean().eval();
  columns -= ramp * (ramp.transpose() * columns / ramp.squaredNorm()).eval();
  const Eigen::Matrix3d products = columns.transpose() * columns;
  sums.a += products.topLeftCorner<2, 2>();
  sums.b += products.topRightCorner<2, 1>();
  sums.squares += products(2, 2);
  sums.freedoms += static_cast<double>(n - 2);
  const auto u = columns.col(2);
  sums.fast += (u.tail(n - 2) - 2 * u.segment(1, n - 2) + u.head(n - 2)).squaredNorm();
  sums.fasts += 6 * static_cast<double>(n - 2);
}

/// A line as one recording's input shows it.
struct SeenLine {
  double statistic = 0;                                 ///< twice F; 0 where there are too few samples, or it moves
  Eigen::Vector2d amplitude = Eigen::Vector2d::Zero();  ///< of a sine and a cosine
};

SeenLine line_in(const Recording& recording, double frequency_hz) {
  const std::vector<std::size_t> first = stretches_of(recording);
  LineSums sums;
  for (std::size_t s = 0; s + 1 < first.size(); ++s) {
    if (first[s + 1] - first[s] < kShortestStretch) continue;
    add_stretch(recording, 2 * std::numbers::pi * frequency_hz, first[s], first[s + 1], sums);
  }
  if (sums.freedoms < 3 * kShortestStretch || !(sums.a.determinant() > 0)) return {};
  const Eigen::Vector2d amplitude = sums.a.inverse() * sums.b;
  const double explained = sums.b.dot(amplitude);
  const double left = (sums.squares - explained) / (sums.freedoms - 2);
  // A moving input has lines of its own making: only where nothing but noise stands beside the line does it count.
  const bool at_rest = left < kAtRest * sums.fast / sums.fasts;
  if (!at_rest || !(left > 0)) return {};
  return {explained / left, amplitude};
}

/// Whether the input neither rests nor goes straight in some part of it.
bool is_swept(const Recording& recording) {
  return std::ranges::any_of(recording.segments,
                             [](const Segment& segment) { return segment.kind == SegmentKind::kSweep; });
}

/// What is taken for the same amplitude and phase: within this share of it, and these standard errors.
constexpr double kAlike = 0.3, kErrors = 2;

/// A line that the output does not follow, as its residual shows it.
struct Unfollowed {
  double frequency_hz = 0;
  Eigen::Vector2d amplitude = Eigen::Vector2d::Zero();  ///< of a sine and a cosine
  double evidence = 0;                                  ///< what the squared error loses without it [noise variances]

  bool is(const Eigen::Vector2d& seen) const {
    return (seen - amplitude).norm() < amplitude.norm() * (kAlike + kErrors / std::sqrt(evidence));
  }
};

/// A mean over an odd number of samples around each, twice; those at the ends stay as they are.
std::vector<double> smoothed(std::vector<double> values, std::size_t length) {
  for (int pass = 0; pass < 2; ++pass) {
    std::vector<double> sums(values.size() + 1, 0.0);
    for (std::size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
    for (std::size_t i = length / 2; i + length / 2 < values.size(); ++i) {
      const std::size_t first = i - length / 2;
      values[i] = (sums[first + length] - sums[first]) / static_cast<double>(length);
    }
  }
  return values;
}

/// The line in the log of an input whose own motion is now slower, now faster: rid of what is far faster, by a cubic, a
/// sine and a cosine in windows of a few periods. Where the motion passes the line's frequency a window shows anything;
/// but two windows that show this line, and more than show none, are no chance.
std::optional<Eigen::Vector2d> seen_in_windows(const Recording& recording, const Unfollowed& line) {
  constexpr double kPeriods = 3, kSmoothing = 0.6;
  constexpr Index kColumns = 6;  // 1, t, t², t³, sine, cosine
  const double rad = 2 * std::numbers::pi * line.frequency_hz * recording.sample_period_s;
  const double period = 2 * std::numbers::pi / rad;
  const std::size_t length = 2 * static_cast<std::size_t>(0.5 * kSmoothing * period) + 1;
  const std::vector<double> input = smoothed(recording.input.values, length);
  const double of_mean =
      std::sin(0.5 * static_cast<double>(length) * rad) / (static_cast<double>(length) * std::sin(0.5 * rad));
  const double gain = of_mean * of_mean;
  const auto window = std::max<Index>(2 * kColumns, std::lround(kPeriods * period));
  const auto samples = static_cast<Index>(input.size());
  Eigen::Vector2d sum(0, 0);
  int alike = 0, none = 0;
  for (auto first = static_cast<Index>(length); first + window + static_cast<Index>(length) <= samples;
       first += window / 2) {
    MatrixXd columns(window, kColumns);
    for (Index i = 0; i < window; ++i) {
      const double t = 2 * static_cast<double>(i) / static_cast<double>(window - 1) - 1;
      const double phase = rad * static_cast<double>(first + i);
      columns.row(i) << 1, t, t * t, t * t * t, gain * std::sin(phase), gain * std::cos(phase);
    }
    const VectorXd there = least_squares(columns, Eigen::Map<const VectorXd>(input.data() + first, window));
    const Eigen::Vector2d amplitude = there.tail<2>();
    if (line.is(amplitude)) {
      sum += amplitude;
      ++alike;
    } else if (amplitude.norm() < 0.5 * line.amplitude.norm()) {
      ++none;
    }
  }
  if (alike < 2 || alike <= none) return std::nullopt;
  return sum / alike;
}

/// The same where all that moves are lines of a periodic input, between which it stands: under Hann's window.
std::optional<Eigen::Vector2d> seen_between_lines(const Recording& recording, const Unfollowed& line) {
  const auto n = static_cast<double>(recording.samples());
  const double rad = 2 * std::numbers::pi * line.frequency_hz * recording.sample_period_s;
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    const double at = static_cast<double>(i);
    const double weight = 0.5 - 0.5 * std::cos(2 * std::numbers::pi * (at + 0.5) / n);
    const Eigen::Vector3d column(1, std::sin(rad * at), std::cos(rad * at));
    a += weight * column * column.transpose();
    b += weight * recording.input.values[i] * column;
  }
  const Eigen::Vector2d amplitude = a.ldlt().solve(b).tail<2>();
  return line.is(amplitude) ? std::optional(amplitude) : std::nullopt;
}

/// Whether it is there at the 1e-4 level, and no wander.
bool stands_in(const Recording& recording, double frequency_hz) {
  const double there = line_in(recording, frequency_hz).statistic;
  if (there < kInInput) return false;
  double beside = 0;
  for (const double bins : {-3.0, -2.0, 2.0, 3.0}) {
    const double bin_hz = 1 / (recording.sample_period_s * static_cast<double>(recording.samples()));
    const double other = frequency_hz + bins * bin_hz;
    if (other > 0) beside = std::max(beside, line_in(recording, other).statistic);
  }
  return there > kOverNeighbours * beside;
}

/// A line of the logged input, its sine and cosine amplitude in each recording.
struct InputLine {
  double frequency_hz = 0;
  std::vector<Eigen::Vector2d> amplitude;
  double evidence = 0;  ///< what the squared error of a recording loses without it, in noise variances: χ² of two

  Recording taken_off(Recording recording, std::size_t r) const {
    const double rad = 2 * std::numbers::pi * frequency_hz * recording.sample_period_s;
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      const double phase = rad * static_cast<double>(i);
      recording.input.values[i] -= amplitude[r].dot(Eigen::Vector2d(std::sin(phase), std::cos(phase)));
    }
    return recording;
  }
};

double longest_s(const ValveFitProblem& problem) {
  double longest = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    longest = std::max(longest, static_cast<double>(recording.samples()) * recording.sample_period_s);
  }
  return longest;
}

/// Frequencies at which a line may stand: what the residual has, and what the input has at rest, where a weak one
/// stands out that the residual hides behind stronger lines.
std::vector<double> candidates(const LinearisedValve& fit) {
  std::vector<double> frequencies_hz;
  for (const Tone& tone : strongest_tones(fit, kMostLines)) frequencies_hz.push_back(tone.frequency_hz);
  const double bin_hz = 1 / longest_s(fit.problem());
  for (const double line_hz : strongest_input_lines(fit.problem(), kMostLines)) {
    const bool is_known =
        std::ranges::any_of(frequencies_hz, [&](double known_hz) { return std::abs(known_hz - line_hz) < bin_hz; });
    if (!is_known) frequencies_hz.push_back(line_hz);
  }
  return frequencies_hz;
}

/// Where between the bins the recordings at rest have it.
double refined(const ValveFitProblem& problem, double frequency_hz) {
  constexpr int kBits = 12;
  const double half_hz = 0.5 / longest_s(problem);
  const auto unexplained = [&](double hz) {
    double sum = 0;
    for (std::size_t r = 0; r < problem.recordings(); ++r) sum -= line_in(problem.recording(r), hz).statistic;
    return sum;
  };
  return boost::math::tools::brent_find_minima(unexplained, frequency_hz - half_hz, frequency_hz + half_hz, kBits)
      .first;
}

/// What the free runs change by where the input is rid of the line, whitened; nothing where its amplitude is zero.
Stack effect_of(const LinearisedValve& fit, const ValveFitOptions& options, const InputLine& line) {
  std::vector<Recording> rid;
  for (std::size_t r = 0; r < fit.problem().recordings(); ++r) {
    rid.push_back(line.taken_off(fit.problem().recording(r), r));
  }
  const ValveFitProblem problem(rid, options);
  Stack effect;
  for (std::size_t r = 0; r < rid.size(); ++r) {
    effect.push_back(line.amplitude[r].isZero() ? VectorXd::Zero(fit.error()[r].size())
                                                : fit.whitened(r, problem.simulate(fit.at(), r)));
  }
  return effect;
}

/// The same line a quarter of a period later, in the recordings that have one.
InputLine turned(InputLine line) {
  for (Eigen::Vector2d& amplitude : line.amplitude) amplitude = Eigen::Vector2d(-amplitude.y(), amplitude.x());
  return line;
}

/// A stack that is zero in all recordings but one.
Stack only(const Stack& all, std::size_t recording) {
  Stack one;
  for (const VectorXd& column : all) one.push_back(VectorXd::Zero(column.size()));
  one[recording] = all[recording];
  return one;
}

/// How much of a line the output does not follow, and what the squared error loses without it [noise variances]: by
/// least squares beside what the valve's own parameters make of it, for the fit has gone along with the line.
struct Share {
  Eigen::Vector2d of_line = Eigen::Vector2d::Zero();  ///< of the line itself, and of it a quarter of a period later
  double evidence = 0;
};

/// most  of the line: a valve that sees nothing of it leaves all of it, there is no more where its size is known
Share share_of(const LinearisedValve& fit, const Stack& straight, const Stack& quarter, double most = 1) {
  const auto signatures = fit.signatures({straight, quarter});
  const double across = fit.product(signatures[0], signatures[1]);
  Eigen::Matrix2d products;
  products << fit.product(signatures[0], signatures[0]), across, across, fit.product(signatures[1], signatures[1]);
  const Eigen::Vector2d with_error(fit.against_error(signatures[0]), fit.against_error(signatures[1]));
  Share share{.of_line = products.ldlt().solve(with_error)};
  share.of_line /= std::max(1.0, share.of_line.norm() / most);
  share.evidence = 2 * share.of_line.dot(with_error) - share.of_line.dot(products * share.of_line);
  return share;
}

/// An amplitude as much of it, and as much later, as a share says.
Eigen::Vector2d times(const Eigen::Vector2d& amplitude, const Eigen::Vector2d& share) {
  return {amplitude.x() * share.x() - amplitude.y() * share.y(), amplitude.y() * share.x() + amplitude.x() * share.y()};
}

/// What is to be taken off the input. At rest the input shows the line, but a valve's loops answer a small motion there
/// as they please; where the input moves, it hides the line, but the answer is plain. So where it moves amplitude and
/// phase are the residual's, at most as large as the line at rest, and at rest as much of it is taken off as there in
/// the mean. Empty where the output follows the line as the simulation does.
std::optional<InputLine> line_behind(const LinearisedValve& fit, const ValveFitOptions& options, double frequency_hz) {
  const ValveFitProblem& problem = fit.problem();
  const std::size_t recordings = problem.recordings();
  InputLine line{.frequency_hz = refined(problem, frequency_hz),
                 .amplitude = std::vector<Eigen::Vector2d>(recordings, Eigen::Vector2d::Zero())};
  InputLine probe = line;  // in the recordings that do not show it
  std::vector<std::size_t> at_rest, moving;
  double squares = 0;
  for (std::size_t r = 0; r < recordings; ++r) {
    const SeenLine seen = line_in(problem.recording(r), line.frequency_hz);
    (seen.statistic < kInInput ? moving : at_rest).push_back(r);
    if (seen.statistic < kInInput) continue;
    line.amplitude[r] = seen.amplitude;
    squares += seen.amplitude.squaredNorm();
  }
  if (at_rest.empty()) return std::nullopt;
  Eigen::Vector2d everywhere(0, 0);
  if (moving.empty()) {
    const Share share = share_of(fit, effect_of(fit, options, line), effect_of(fit, options, turned(line)));
    line.evidence = share.evidence;
    everywhere = share.of_line;
  } else {
    for (const std::size_t r : moving)
      probe.amplitude[r].x() = std::sqrt(squares / static_cast<double>(at_rest.size()));
    const Stack straight = effect_of(fit, options, probe), quarter = effect_of(fit, options, turned(probe));
    for (const std::size_t r : moving) {
      const Share share = share_of(fit, only(straight, r), only(quarter, r));
      line.amplitude[r] = times(probe.amplitude[r], share.of_line);
      line.evidence += share.evidence / static_cast<double>(moving.size());
      everywhere.x() += share.of_line.norm() / static_cast<double>(moving.size());
    }
  }
  if (!(line.evidence >= kInResidual)) return std::nullopt;
  for (const std::size_t r : at_rest) line.amplitude[r] = times(line.amplitude[r], everywhere);
  return line;
}

/// The same where too few inputs rest or go straight to be sure of a line: the one that the residual of the others
/// shows as one which the output does not follow must be the one that their log has, in amplitude and phase.
std::optional<InputLine> line_in_motion(const LinearisedValve& fit, const ValveFitOptions& options,
                                        double frequency_hz) {
  // Of the range of inputs: small enough for the valve's answer to be in proportion.
  constexpr double kProbe = 1e-3;
  const ValveFitProblem& problem = fit.problem();
  const double probe_a = kProbe * (options.knots.back() - options.knots.front());
  InputLine line{.frequency_hz = frequency_hz,
                 .amplitude = std::vector<Eigen::Vector2d>(problem.recordings(), Eigen::Vector2d(probe_a, 0))};
  const Stack straight = effect_of(fit, options, line), quarter = effect_of(fit, options, turned(line));
  const double inflation = noise_inflation(fit.error());
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    const Eigen::Vector2d probe = line.amplitude[r];
    line.amplitude[r].setZero();
    if (!is_swept(recording)) {
      const SeenLine at_rest = line_in(recording, frequency_hz);
      if (at_rest.statistic >= kInInput) line.amplitude[r] = at_rest.amplitude;
      continue;
    }
    const Share share = share_of(fit, only(straight, r), only(quarter, r), std::numeric_limits<double>::infinity());
    const Unfollowed unfollowed{frequency_hz, times(probe, share.of_line), share.evidence / inflation};
    if (unfollowed.evidence < kLeastEvidence) continue;
    auto seen = seen_in_windows(recording, unfollowed);
    if (!seen) seen = seen_between_lines(recording, unfollowed);
    if (!seen) continue;
    line.amplitude[r] = *seen;
    line.evidence += unfollowed.evidence;
  }
  return line.evidence > 0 ? std::optional(line) : std::nullopt;
}

/// Recordings whose logged input shows any line that it has.
std::size_t straight_recordings(const ValveFitProblem& problem) {
  std::size_t straight = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) straight += is_swept(problem.recording(r)) ? 0 : 1;
  return straight;
}

}  // namespace

bool stands_in_input(const ValveFitProblem& problem, double frequency_hz) {
  std::size_t with = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) with += stands_in(problem.recording(r), frequency_hz) ? 1 : 0;
  return with >= std::min(kEnough, problem.recordings());
}

CleanInputs without_aliased_lines(const LinearisedValve& fit, const ValveFitOptions& options) {
  CleanInputs clean;
  const bool is_told_at_rest = straight_recordings(fit.problem()) >= std::min(kEnough, fit.problem().recordings());
  for (const double frequency_hz : candidates(fit)) {
    std::optional<InputLine> line;
    if (stands_in_input(fit.problem(), frequency_hz)) {
      line = line_behind(fit, options, frequency_hz);
    } else if (!is_told_at_rest) {
      line = line_in_motion(fit, options, frequency_hz);
    }
    if (!line) continue;
    if (clean.recordings.empty()) {
      for (std::size_t r = 0; r < fit.error().size(); ++r) clean.recordings.push_back(fit.problem().recording(r));
    }
    double squares = 0;
    for (std::size_t r = 0; r < clean.recordings.size(); ++r) {
      clean.recordings[r] = line->taken_off(std::move(clean.recordings[r]), r);
      squares += line->amplitude[r].squaredNorm() / static_cast<double>(clean.recordings.size());
    }
    clean.findings.push_back(
        {.what = fmt::format("a line of {:.3g} Hz and {:.2g} {} in the logged input that the output does not follow: "
                             "ripple or dither folded back by the sampling; taken off before the simulation",
                             line->frequency_hz, std::sqrt(squares), clean.recordings.front().input.unit),
         .where = "input",
         .statistic = line->evidence,
         .p_value = chi_squared_upper_tail(2, std::min(line->evidence, 1400.0)),
         .share_of_structured_residual = std::numeric_limits<double>::quiet_NaN()});
  }
  return clean;
}

}  // namespace valvetriage
