#include "core/discrepancy/tones.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <utility>

#include "core/identify/spectrum.h"

namespace valvetriage {
namespace {

using Eigen::Index;

// Fewer periods do not tell a tone from what wanders slowly.
constexpr double kFewestPeriods = 10;
// A spectrum of fewer samples tells no line from its neighbours.
constexpr std::size_t kShortestSeries = 16;
// What a driver needs to reach the current of a step.
constexpr double kDriverSettling_s = 0.1;
// Hunting shows in several rests, each of them short: what has fewer periods in a rest is a drift there.
constexpr double kFewestInRest = 3;
// The background of a line: the median over this many bins to either side.
constexpr std::size_t kBackgroundBins = 24;

/// The whitened residual on the grid of every row, zero where there is none.
std::vector<double> on_grid(const LinearisedValve& fit, std::size_t r, std::size_t length) {
  std::vector<double> series(length, 0.0);
  const auto& samples = fit.rows()[r].sample;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    series[samples[i]] = fit.error()[r](static_cast<Index>(i));
  }
  return series;
}

void divide_by_background(std::vector<double>& power) {
  std::vector<double> background(power.size());
  std::vector<double> window;
  for (std::size_t k = 0; k < power.size(); ++k) {
    const std::size_t first = k > kBackgroundBins ? k - kBackgroundBins : 0;
    const std::size_t last = std::min(power.size(), k + kBackgroundBins + 1);
    window.assign(power.begin() + static_cast<std::ptrdiff_t>(first),
                  power.begin() + static_cast<std::ptrdiff_t>(last));
    const auto middle = window.begin() + static_cast<std::ptrdiff_t>(window.size() / 2);
    std::nth_element(window.begin(), middle, window.end());
    background[k] = *middle;
  }
  for (std::size_t k = 0; k < power.size(); ++k) power[k] /= std::max(background[k], 1e-300);
}

/// A spectrum's power over its local background.
std::vector<double> prominence(const std::vector<double>& series) {
  const std::vector<std::complex<double>> lines = spectrum(series);
  std::vector<double> power(series.size() / 2);
  for (std::size_t k = 0; k < power.size(); ++k) power[k] = std::norm(lines[k]);
  divide_by_background(power);
  return power;
}

struct Peak {
  double frequency_hz = 0;
  double prominence = 0;
};

/// The highest local maxima of prominences, by the top of a parabola through three bins.
///
/// longest  samples of the longest series; of fewer than kFewestPeriods in it nothing is told
std::vector<Peak> peaks_of(const std::vector<double>& power, std::size_t longest, std::size_t length, double grid_s,
                           std::size_t most) {
  const double bin_hz = 1.0 / (static_cast<double>(length) * grid_s);
  const auto first =
      static_cast<std::size_t>(std::ceil(kFewestPeriods / (static_cast<double>(longest) * grid_s) / bin_hz));
  std::vector<std::size_t> order;
  for (std::size_t k = std::max<std::size_t>(first, 1); k + 1 < power.size(); ++k) {
    if (power[k] >= power[k - 1] && power[k] > power[k + 1]) order.push_back(k);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return power[a] > power[b]; });
  if (order.size() > most) order.resize(most);
  std::vector<Peak> peaks;
  for (const std::size_t k : order) {
    const double left = power[k - 1], mid = power[k], right = power[k + 1];
    const double bend = left - 2 * mid + right;
    const double shift = bend < 0 ? 0.5 * (left - right) / bend : 0;
    peaks.push_back({(static_cast<double>(k) + shift) * bin_hz, mid});
  }
  return peaks;
}

/// The logged input where it rests, a straight line taken off each rest, zero elsewhere; empty where it never rests.
std::vector<double> input_at_rest(const Recording& recording, std::size_t length) {
  const auto settling = static_cast<std::size_t>(kDriverSettling_s / recording.sample_period_s) + 1;
  std::vector<double> series;
  for (const Segment& segment : recording.segments) {
    if (segment.kind != SegmentKind::kHold && segment.kind != SegmentKind::kStep) continue;
    const std::size_t begin = segment.begin + settling;
    if (segment.end < begin + kShortestSeries) continue;
    const auto n = static_cast<Index>(segment.end - begin);
    const auto input = Eigen::Map<const Eigen::VectorXd>(recording.input.values.data() + begin, n);
    const Eigen::VectorXd ramp = Eigen::VectorXd::LinSpaced(n, -1, 1);
    const Eigen::VectorXd level = input.array() - input.mean();
    series.resize(length, 0.0);
    Eigen::Map<Eigen::VectorXd>(series.data() + begin, n) = level - ramp * (ramp.dot(level) / ramp.squaredNorm());
  }
  return series;
}

/// Least squares of a sine and a cosine in each recording.
void fit_phases(const LinearisedValve& fit, Tone& tone) {
  double squares = 0;
  for (std::size_t r = 0; r < fit.error().size(); ++r) {
    SineFit sine;
    const double whiten = std::sqrt(fit.problem().inverse_variance(r));
    const double period_s = fit.problem().recording(r).sample_period_s;
    for (std::size_t i = 0; i < fit.rows()[r].sample.size(); ++i) {
      const double t = static_cast<double>(fit.rows()[r].sample[i]) * period_s;
      sine.add(2 * std::numbers::pi * tone.frequency_hz * t, fit.error()[r](static_cast<Index>(i)) / whiten);
    }
    tone.phase_rad.push_back(sine.amplitudes().phase_rad());
    squares += sine.amplitudes().power();
  }
  tone.amplitude = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(fit.error().size(), 1)));
}

/// The residual while the input rests, after the valve has settled, by level.
struct Rest {
  double level = 0;
  std::vector<double> power;       ///< chi-square of 2 in white noise
  std::vector<double> prominence;  ///< power over that of its neighbours
  double samples = 0;
  double noise_squares = 0;  ///< over all of them, unit of the output squared
};

// A rest begins to tell this long after the step, and must last this much longer.
constexpr double kSettling_s = 0.5, kShortestRest_s = 0.6;
// Rests nearer than this share of the range are at one level.
constexpr double kSameLevel = 0.03;

std::vector<Rest> rests_of(const LinearisedValve& fit, double range, double sample_period_s, std::size_t length) {
  std::vector<Rest> rests;
  const auto settling = static_cast<std::size_t>(kSettling_s / sample_period_s);
  const auto shortest = static_cast<std::size_t>(kShortestRest_s / sample_period_s);
  for (std::size_t r = 0; r < fit.error().size(); ++r) {
    const Recording& recording = fit.problem().recording(r);
    if (recording.sample_period_s != sample_period_s) continue;
    const std::vector<double> error = on_grid(fit, r, recording.samples());
    for (const Segment& segment : recording.segments) {
      if (segment.kind != SegmentKind::kHold && segment.kind != SegmentKind::kStep) continue;
      const std::size_t begin = segment.begin + settling, end = std::min(segment.end, begin + length);
      if (end < begin + shortest) continue;
      double level = 0, mean = 0;
      for (std::size_t i = begin; i < end; ++i) {
        level += fit.run(r).output[i] / static_cast<double>(end - begin);
        mean += error[i] / static_cast<double>(end - begin);
      }
      std::vector<double> series(length, 0.0);
      for (std::size_t i = begin; i < end; ++i) series[i - begin] = error[i] - mean;
      const std::vector<std::complex<double>> lines = spectrum(series);
      auto known = std::find_if(rests.begin(), rests.end(),
                                [&](const Rest& rest) { return std::abs(rest.level - level) < kSameLevel * range; });
      if (known == rests.end()) {
        rests.push_back({.level = level, .power = std::vector<double>(length / 2, 0.0)});
        known = rests.end() - 1;
      }
      const double samples = static_cast<double>(end - begin);
      const auto first = static_cast<std::size_t>(std::ceil(kFewestInRest * static_cast<double>(length) / samples));
      for (std::size_t k = first; k < length / 2; ++k) known->power[k] += 2 / samples * std::norm(lines[k]);
      known->samples += samples;
      known->noise_squares += samples / fit.problem().inverse_variance(r);
    }
  }
  for (Rest& rest : rests) {
    const auto first = std::find_if(rest.power.begin(), rest.power.end(), [](double power) { return power > 0; });
    std::vector<double> seen(first, rest.power.end());
    divide_by_background(seen);
    rest.prominence.assign(rest.power.size() - seen.size(), 0.0);
    rest.prominence.insert(rest.prominence.end(), seen.begin(), seen.end());
  }
  return rests;
}

}  // namespace

std::vector<HuntingTone> hunting_tones(const LinearisedValve& fit, double range, std::size_t most) {
  constexpr double kLongestRest_s = 5;
  constexpr double kReach = 0.4;  // of the range: farther from its level a cycle has died out
  const double sample_period_s = fit.problem().recording(0).sample_period_s;
  const std::size_t length = smooth_length_above(2 * static_cast<std::size_t>(kLongestRest_s / sample_period_s));
  const std::vector<Rest> rests = rests_of(fit, range, sample_period_s, length);
  const double bin_hz = 1 / (static_cast<double>(length) * sample_period_s);
  struct Line {
    HuntingTone tone;
    double power;
  };
  std::vector<Line> lines;
  for (const Rest& strongest : rests) {
    for (std::size_t k = 1; k + 1 < strongest.power.size(); ++k) {
      const double own = strongest.prominence[k];
      if (own < strongest.prominence[k - 1] || own <= strongest.prominence[k + 1]) continue;
      Line line{.tone = {.frequency_hz = static_cast<double>(k) * bin_hz, .level = strongest.level}, .power = 0};
      line.tone.amplitude = std::sqrt(2 * strongest.power[k] * strongest.noise_squares) / strongest.samples;
      for (double slope = -0.5; slope <= 0.5; slope += 0.05) {
        double power = own;
        for (const Rest& rest : rests) {
          const double away = (rest.level - strongest.level) / range;
          if (&rest == &strongest || std::abs(away) > kReach) continue;
          const auto at = static_cast<std::size_t>(std::llround(static_cast<double>(k) * (1 + slope * away)));
          if (at + 1 < rest.power.size()) power += rest.prominence[at];
        }
        if (power > line.power) {
          line.power = power;
          line.tone.slope = slope;
        }
      }
      lines.push_back(line);
    }
  }
  std::sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) { return a.power > b.power; });
  std::vector<HuntingTone> tones;
  for (const Line& line : lines) {
    if (tones.size() == most) break;
    const bool is_known = std::any_of(tones.begin(), tones.end(), [&](const HuntingTone& t) {
      return t.level == line.tone.level && std::abs(t.frequency_hz - line.tone.frequency_hz) < 4 * bin_hz;
    });
    if (!is_known) tones.push_back(line.tone);
  }
  return tones;
}

std::vector<Tone> strongest_tones(const LinearisedValve& fit, std::size_t most) {
  const double sample_period_s = fit.problem().recording(0).sample_period_s;
  std::size_t longest = 0;
  for (const auto& rows : fit.rows()) {
    if (!rows.sample.empty()) {
      longest = std::max(longest, rows.sample.back() + 1);
    }
  }
  if (longest < kShortestSeries) return {};
  const std::size_t length = smooth_length_above(2 * longest);
  std::vector<double> sum(length / 2, 0.0);
  for (std::size_t r = 0; r < fit.error().size(); ++r) {
    if (fit.problem().recording(r).sample_period_s != sample_period_s) continue;
    const std::vector<double> power = prominence(on_grid(fit, r, length));
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += power[k];
  }
  std::vector<Tone> tones;
  for (const Peak& peak : peaks_of(sum, longest, length, sample_period_s, most)) {
    Tone tone{.frequency_hz = peak.frequency_hz, .prominence = peak.prominence};
    fit_phases(fit, tone);
    tones.push_back(std::move(tone));
  }
  return tones;
}

std::vector<double> strongest_input_lines(const ValveFitProblem& problem, std::size_t most) {
  const double sample_period_s = problem.recording(0).sample_period_s;
  std::size_t longest = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) longest = std::max(longest, problem.recording(r).samples());
  if (longest < kShortestSeries) return {};
  const std::size_t length = smooth_length_above(2 * longest);
  std::vector<double> sum(length / 2, 0.0);
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    if (recording.sample_period_s != sample_period_s) continue;
    const std::vector<double> series = input_at_rest(recording, length);
    if (series.empty()) continue;
    const std::vector<double> power = prominence(series);
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += power[k];
  }
  std::vector<double> lines;
  for (const Peak& peak : peaks_of(sum, longest, length, sample_period_s, most)) lines.push_back(peak.frequency_hz);
  return lines;
}

}  // namespace valvetriage
