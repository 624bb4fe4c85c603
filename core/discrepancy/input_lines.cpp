#include "core/discrepancy/input_lines.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/discrepancy/law_search.h"
#include "core/discrepancy/tones.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostLines = 3;
constexpr int kSteps = 4;
// Of a sine and a cosine at a known frequency: χ² of two freedoms at 1e-4.
constexpr double kInInput = 18.4;
// A line, not a wander: this many times what stands two or three resolved frequencies beside it.
constexpr double kOverNeighbours = 4;
// That the output does not follow it: the line itself is certain and its frequency known, so no search is paid for.
// χ² of two freedoms at 1e-2.
constexpr double kInResidual = 9.2;
// A jump of the input ends a straight stretch: this many of the median step.
constexpr double kJump = 12;
constexpr std::size_t kShortestStretch = 16;
// Variance beside the line over that of the fast noise: 1 where the input rests or goes straight.
constexpr double kAtRest = 2;

/// First samples of the stretches without a jump, and the end.
std::vector<std::size_t> stretches_of(const std::vector<double>& input) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < input.size(); ++i) steps.push_back(std::abs(input[i] - input[i - 1]));
  std::vector<double> sorted = steps;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double jump = kJump * std::max(*middle, 1e-12);
  std::vector<std::size_t> first{0};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] > jump) first.push_back(i + 1);
  }
  first.push_back(input.size());
  return first;
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

/// Twice the F statistic of the line in one recording's input; 0 where there are too few samples.
double line_in(const Recording& recording, double frequency_hz) {
  const std::vector<std::size_t> first = stretches_of(recording.input.values);
  LineSums sums;
  for (std::size_t s = 0; s + 1 < first.size(); ++s) {
    if (first[s + 1] - first[s] < kShortestStretch) continue;
    add_stretch(recording, 2 * std::numbers::pi * frequency_hz, first[s], first[s + 1], sums);
  }
  if (sums.freedoms < 3 * kShortestStretch || !(sums.a.determinant() > 0)) return 0;
  const double explained = sums.b.dot(sums.a.inverse() * sums.b);
  const double left = (sums.squares - explained) / (sums.freedoms - 2);
  // A moving input has lines of its own making: only where nothing but noise stands beside the line does it count.
  const bool at_rest = left < kAtRest * sums.fast / sums.fasts;
  return at_rest && left > 0 ? explained / left : 0;
}

// The line as a law of the input: f, and in each recording its cosine and sine amplitude.
constexpr std::array<MechanismParameter, 3> kParameters{{{"frequency_hz", "Hz", "of the line as logged"},
                                                         {"cosine_A", "A", "amplitude", 0},
                                                         {"sine_A", "A", "amplitude", 0}}};

void add_line(std::span<const double> parameters, const LawContext& context, std::span<double> u) {
  const double rad_s = 2 * std::numbers::pi * parameters[0];
  for (std::size_t i = 0; i < u.size(); ++i) {
    const double phase = rad_s * context.time_s[i];
    u[i] -= parameters[1] * std::cos(phase) + parameters[2] * std::sin(phase);
  }
}

constinit const Mechanism kLine{.order = 0,
                                .cause = "line in the logged input",
                                .family = "",
                                .origin = "stand",
                                .wrong = "a line that the valve never saw",
                                .law = "u ← u − a cos(2π f t) − b sin(2π f t)",
                                .source = "",
                                .signature = "",
                                .confused_with = {},
                                .place = Place::kInput,
                                .parameters = kParameters,
                                .size_parameter = 3,
                                .neutral = 0,
                                .bounds = nullptr,
                                .apply = add_line,
                                .tangent = nullptr,
                                .reshape = nullptr,
                                .own_per_recording = 2};

/// The line that explains a tone of the residual, fitted to it.
std::optional<LawFit> line_behind(const LinearisedValve& fit, const ValveFitOptions& options, double frequency_hz) {
  const ValveFitProblem& problem = fit.problem();
  double longest_s = 0, range = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    longest_s = std::max(longest_s, static_cast<double>(recording.samples()) * recording.sample_period_s);
    const auto [low, high] = std::minmax_element(recording.input.values.begin(), recording.input.values.end());
    range = std::max(range, *high - *low);
  }
  const double start = 1e-3 * range, most = 0.1 * range;
  LawInFit law{.law = &kLine,
               .start = {frequency_hz, start, start},
               .lower = {frequency_hz - 1 / longest_s, -most, -most},
               .upper = {frequency_hz + 1 / longest_s, most, most},
               .step = {1e-3 / longest_s, 1e-3 * range, 1e-3 * range}};
  std::vector<double> starts{frequency_hz};
  for (std::size_t r = 0; r < problem.recordings(); ++r) starts.insert(starts.end(), {start, start});
  return search_law(fit, options, law, {starts}, kSteps, 0);
}

}  // namespace

bool stands_in_input(const ValveFitProblem& problem, double frequency_hz) {
  std::size_t with = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    const double there = line_in(recording, frequency_hz);
    if (there < kInInput) continue;
    double beside = 0;
    for (const double bins : {-3.0, -2.0, 2.0, 3.0}) {
      const double bin_hz = 1 / (recording.sample_period_s * static_cast<double>(recording.samples()));
      const double other = frequency_hz + bins * bin_hz;
      if (other > 0) beside = std::max(beside, line_in(recording, other));
    }
    with += there > kOverNeighbours * beside ? 1 : 0;
  }
  return with >= std::min<std::size_t>(2, problem.recordings());
}

CleanInputs without_aliased_lines(const LinearisedValve& fit, const ValveFitOptions& options) {
  CleanInputs clean;
  for (const Tone& tone : strongest_tones(fit, kMostLines)) {
    if (!stands_in_input(fit.problem(), tone.frequency_hz)) continue;
    const auto line = line_behind(fit, options, tone.frequency_hz);
    if (!line || line->consistent_verified.at_most(line->verified).as_normal() < kInResidual) continue;
    const double evidence = line->consistent_verified.as_normal();
    if (clean.recordings.empty()) {
      for (std::size_t r = 0; r < fit.error().size(); ++r) clean.recordings.push_back(fit.problem().recording(r));
    }
    double squares = 0;
    for (std::size_t r = 0; r < clean.recordings.size(); ++r) {
      Recording& recording = clean.recordings[r];
      const double a = line->parameters[1 + 2 * r], b = line->parameters[2 + 2 * r];
      for (std::size_t i = 0; i < recording.samples(); ++i) {
        const double phase =
            2 * std::numbers::pi * line->parameters[0] * recording.sample_period_s * static_cast<double>(i);
        recording.input.values[i] -= a * std::cos(phase) + b * std::sin(phase);
      }
      squares += (a * a + b * b) / static_cast<double>(clean.recordings.size());
    }
    const boost::math::chi_squared two(2);
    clean.findings.push_back(
        {.what = fmt::format("a line of {:.3g} Hz and {:.2g} {} in the logged input that the output does not follow: "
                             "ripple or dither folded back by the sampling; taken off before the simulation",
                             line->parameters[0], std::sqrt(squares), clean.recordings.front().input.unit),
         .where = "input",
         .statistic = evidence,
         .p_value = boost::math::cdf(boost::math::complement(two, std::min(evidence, 1400.0))),
         .share_of_structured_residual = std::numeric_limits<double>::quiet_NaN()});
  }
  return clean;
}

}  // namespace valvetriage
