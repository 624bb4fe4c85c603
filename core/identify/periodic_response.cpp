#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/identify/response_spectra.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;

constexpr std::size_t kNeighbours = 10;       // lines between harmonics that tell transient and noise at one
constexpr double kExcitedOfStrongest = 1e-4;  // power of an excited line over that of the strongest
constexpr double kExcitedOverNoise = 30;      // and over that of the lines between harmonics
constexpr std::size_t kDistortionLines = 4;   // empty lines averaged for the distortion at an excited one
constexpr double kSomeDistortionLines = 3;    // fewer tell nothing

/// Transient and noise of the output at one harmonic, from the lines between harmonics around it.
struct Background {
  Complex transient;
  double noise = 0;     ///< E|V|² of one line
  double leverage = 0;  ///< of the transient: its variance over `noise`
  double freedom = 0;
};

Background background_at(const std::vector<Complex>& output, std::size_t line, std::size_t periods) {
  const std::size_t reach = kNeighbours * periods / (2 * (periods - 1)) + 1;
  std::vector<std::size_t> lines;
  const std::size_t first = line > reach ? line - reach : 1;
  for (std::size_t k = first; k <= line + reach && k < output.size(); ++k) {
    if (k % periods != 0) lines.push_back(k);
  }
  const auto n = static_cast<Index>(lines.size());
  Eigen::MatrixXd columns(n, 3);
  Eigen::VectorXcd values(n);
  for (Index i = 0; i < n; ++i) {
    const double x = (static_cast<double>(lines[static_cast<std::size_t>(i)]) - static_cast<double>(line)) /
                     static_cast<double>(reach);
    columns.row(i) << 1, x, x * x;
    values(i) = output[lines[static_cast<std::size_t>(i)]];
  }
  if (n < 5) return {};
  const Eigen::MatrixXd inverse = inverse_of_symmetric(columns.transpose() * columns);
  const Eigen::VectorXcd theta = inverse * (columns.transpose() * values);
  Background background;
  background.transient = theta(0);
  background.freedom = static_cast<double>(n - 3);
  background.noise = (values - columns * theta).squaredNorm() / background.freedom;
  background.leverage = inverse(0, 0);
  return background;
}

std::vector<std::uint8_t> excited_harmonics(const std::vector<Complex>& input, std::size_t periods, std::size_t last) {
  double strongest = 0;
  std::vector<double> between;
  for (std::size_t k = 1; k <= last * periods; ++k) {
    if (k % periods == 0) {
      strongest = std::max(strongest, std::norm(input[k]));
    } else {
      between.push_back(std::norm(input[k]));
    }
  }
  const auto middle = between.begin() + static_cast<std::ptrdiff_t>(between.size() / 2);
  std::nth_element(between.begin(), middle, between.end());
  const double least = std::max(kExcitedOfStrongest * strongest, kExcitedOverNoise * *middle);
  std::vector<std::uint8_t> excited(last + 1, 0);
  for (std::size_t h = 1; h <= last; ++h) excited[h] = std::norm(input[h * periods]) > least;
  return excited;
}

/// One record: excited lines with their noise, and what stands in empty harmonics.
struct HarmonicLines {
  std::vector<ResponsePoint> points;  ///< std_error of noise alone
  std::vector<std::size_t> harmonic;  ///< of each point
  std::vector<double> input_power;    ///< |U|² of each point
  std::map<std::size_t, double> empty_power, empty_noise;
  double line_hz = 0;
};

Complex gain_near(const HarmonicLines& lines, std::size_t harmonic) {
  const auto above = std::lower_bound(lines.harmonic.begin(), lines.harmonic.end(), harmonic);
  if (above == lines.harmonic.end()) return lines.points.back().gain;
  const auto i = static_cast<std::size_t>(above - lines.harmonic.begin());
  if (i == 0) return lines.points.front().gain;
  const double share = static_cast<double>(harmonic - lines.harmonic[i - 1]) /
                       static_cast<double>(lines.harmonic[i] - lines.harmonic[i - 1]);
  return (1 - share) * lines.points[i - 1].gain + share * lines.points[i].gain;
}

HarmonicLines harmonic_lines(const RecordSpectra& record, std::size_t periods, double highest_hz) {
  HarmonicLines lines;
  lines.line_hz = record.line_hz * static_cast<double>(periods);
  const auto last = std::min(static_cast<std::size_t>(highest_hz / lines.line_hz), (record.input.size() - 1) / periods);
  const auto excited = excited_harmonics(record.input, periods, last);
  for (std::size_t h = 1; h <= last; ++h) {
    if (!excited[h]) continue;
    const Complex u = record.input[h * periods];
    const Background background = background_at(record.output, h * periods, periods);
    if (background.freedom == 0) continue;
    const Complex y = record.output[h * periods] - background.transient;
    const double variance = background.noise * (1 + background.leverage);
    lines.points.push_back({.frequency_hz = static_cast<double>(h) * lines.line_hz,
                            .gain = y / u,
                            .std_error = std::sqrt(variance / std::norm(u)),
                            .degrees_of_freedom = background.freedom,
                            .group = static_cast<int>(h)});
    lines.harmonic.push_back(h);
    lines.input_power.push_back(std::norm(u));
  }
  if (lines.points.empty()) return lines;
  for (std::size_t h = lines.harmonic.front(); h <= lines.harmonic.back(); ++h) {
    if (excited[h]) continue;
    const Background background = background_at(record.output, h * periods, periods);
    const Complex linear = gain_near(lines, h) * record.input[h * periods];
    lines.empty_power[h] = std::norm(record.output[h * periods] - background.transient - linear);
    lines.empty_noise[h] = background.noise * (1 + background.leverage);
  }
  return lines;
}

bool only_odd(const HarmonicLines& lines) {
  return std::all_of(lines.harmonic.begin(), lines.harmonic.end(), [](std::size_t h) { return h % 2 == 1; });
}

/// Mean power of the nearest empty odd harmonics: noise and odd distortion; nothing where there are none.
std::optional<double> odd_power_near(const HarmonicLines& lines, std::size_t harmonic) {
  std::vector<std::pair<std::size_t, double>> nearest;
  for (const auto& [h, power] : lines.empty_power) {
    if (h % 2 == 1) nearest.emplace_back(h > harmonic ? h - harmonic : harmonic - h, power);
  }
  if (nearest.size() < kDistortionLines) return std::nullopt;
  std::sort(nearest.begin(), nearest.end());
  double sum = 0;
  for (std::size_t i = 0; i < kDistortionLines; ++i) sum += nearest[i].second;
  return sum / static_cast<double>(kDistortionLines);
}

void add_distortion_to_errors(HarmonicLines& lines) {
  const bool separable = only_odd(lines);
  for (std::size_t i = 0; i < lines.points.size(); ++i) {
    ResponsePoint& point = lines.points[i];
    const auto odd = separable ? odd_power_near(lines, lines.harmonic[i]) : std::nullopt;
    const double noise = point.std_error * point.std_error;
    if (odd && *odd / lines.input_power[i] > noise) {
      point.std_error = std::sqrt(*odd / lines.input_power[i]);
      point.degrees_of_freedom = static_cast<double>(kDistortionLines);
    }
    const double signal = std::norm(point.gain), variance = point.std_error * point.std_error;
    point.coherence = signal + variance > 0 ? signal / (signal + variance) : 0;
  }
}

double mean_level(const DistortionLines& lines) {
  double sum = 0;
  for (const double level : lines.level) sum += level * level;
  return lines.level.empty() ? 0 : std::sqrt(sum / static_cast<double>(lines.level.size()));
}

/// Levels of one record, rms of a line's sinusoid: √2 |Y_k| / n.
std::optional<Distortion> distortion_of(const HarmonicLines& lines, double samples) {
  if (!only_odd(lines)) return std::nullopt;
  Distortion d;
  const auto rms = [&](double power) { return std::sqrt(2 * std::max(power, 0.0)) / samples; };
  const auto add = [&](DistortionLines& to, std::size_t h, double level) {
    to.frequency_hz.push_back(static_cast<double>(h) * lines.line_hz);
    to.level.push_back(level);
  };
  double odd = 0, even = 0, noise_at_odd = 0, noise_at_even = 0;
  for (std::size_t i = 0; i < lines.points.size(); ++i) {
    add(d.linear, lines.harmonic[i], rms(std::norm(lines.points[i].gain) * lines.input_power[i]));
  }
  for (const auto& [h, power] : lines.empty_power) {
    const double noise = lines.empty_noise.at(h);
    add(d.noise, h, rms(noise));
    add(h % 2 == 1 ? d.odd : d.even, h, rms(power));
    (h % 2 == 1 ? odd : even) += power;
    (h % 2 == 1 ? noise_at_odd : noise_at_even) += noise;
  }
  if (static_cast<double>(d.odd.level.size()) < kSomeDistortionLines ||
      static_cast<double>(d.even.level.size()) < kSomeDistortionLines) {
    return std::nullopt;
  }
  const double linear = mean_level(d.linear);
  if (!(linear > 0)) return std::nullopt;
  d.noise_ratio = mean_level(d.noise) / linear;
  d.odd_ratio = rms((odd - noise_at_odd) / static_cast<double>(d.odd.level.size())) / linear;
  d.even_ratio = rms((even - noise_at_even) / static_cast<double>(d.even.level.size())) / linear;
  return d;
}

/// Repeats line by line, weighted by their variances; frequencies that only some have keep what these give.
std::vector<ResponsePoint> averaged(const std::vector<std::vector<ResponsePoint>>& repeats) {
  struct Sum {
    double frequency_hz = 0, weight = 0, coherence = 0, freedom = 0;
    Complex gain;
    int n = 0;
  };
  std::map<int, Sum> sums;
  for (const auto& points : repeats) {
    for (const ResponsePoint& point : points) {
      Sum& sum = sums[point.group];
      const double weight = 1 / std::max(point.std_error * point.std_error, 1e-300);
      sum.frequency_hz = point.frequency_hz;
      sum.gain += weight * point.gain;
      sum.weight += weight;
      sum.coherence += point.coherence;
      sum.freedom += point.degrees_of_freedom;
      ++sum.n;
    }
  }
  std::vector<ResponsePoint> points;
  for (const auto& [group, sum] : sums) {
    points.push_back({.frequency_hz = sum.frequency_hz,
                      .gain = sum.gain / sum.weight,
                      .std_error = std::sqrt(1 / sum.weight),
                      .coherence = sum.coherence / sum.n,
                      .degrees_of_freedom = sum.freedom,
                      .group = group});
  }
  return points;
}

}  // namespace

PeriodicEstimate estimate_by_periods(std::span<const RecordSpectra> records, std::size_t periods, double highest_hz,
                                     int points_per_decade) {
  PeriodicEstimate estimate;
  std::vector<std::vector<ResponsePoint>> repeats;
  for (const RecordSpectra& record : records) {
    HarmonicLines lines = harmonic_lines(record, periods, highest_hz);
    if (lines.points.empty()) continue;
    add_distortion_to_errors(lines);
    const auto samples = 2.0 * static_cast<double>(record.input.size() - 1);
    if (!estimate.distortion) estimate.distortion = distortion_of(lines, samples);
    repeats.push_back(std::move(lines.points));
  }
  estimate.response.points = thinned(averaged(repeats), points_per_decade);
  return estimate;
}

}  // namespace valvetriage
