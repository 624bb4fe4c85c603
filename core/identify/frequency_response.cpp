#include "core/identify/frequency_response.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/identify/response_spectra.h"
#include "core/identify/spectrum.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

constexpr double kHighestOfRate = 0.45;        // of the sampling rate: above it images weigh as much as the signal
constexpr double kInvalidShare = 0.02;         // more than this is not a few repaired samples
constexpr double kLargestRelativeError = 0.5;  // a gain known no better is not known
constexpr double kRepeatsWithin = 0.02;        // of its power: a period differs from the next by noise alone
constexpr std::size_t kShortestPeriod = 16;    // samples
constexpr std::size_t kMostPeriodCandidates = 20;
constexpr double kClippedShare = 0.002;  // of the samples; fewer bend nothing that shows
constexpr std::size_t kClippedRun = 3;   // samples at the limit that count as held
constexpr double kTailShare = 0.01;

/// One repeat in time, cut to what can be transformed.
struct Stretch {
  std::vector<double> input, output;
  double period_s = 0;
};

/// The record, or its longest part without invalid samples where those are many.
Stretch usable_stretch(const Recording& recording) {
  const std::size_t n = recording.samples();
  std::size_t invalid = 0, begin = 0, end = n, run_begin = 0, longest = 0;
  for (std::size_t i = 0; i < n; ++i) invalid += !recording.is_valid(i);
  if (static_cast<double>(invalid) > kInvalidShare * static_cast<double>(n)) {
    for (std::size_t i = 0; i <= n; ++i) {
      if (i < n && recording.is_valid(i)) continue;
      if (i - run_begin > longest) {
        longest = i - run_begin;
        begin = run_begin;
        end = i;
      }
      run_begin = i + 1;
    }
  }
  const auto part = [&](const std::vector<double>& values) {
    return std::vector<double>(values.begin() + static_cast<std::ptrdiff_t>(begin),
                               values.begin() + static_cast<std::ptrdiff_t>(end));
  };
  return {part(recording.input.values), part(recording.output.values), recording.sample_period_s};
}

std::vector<Complex> lines_of(std::span<const double> values) {
  std::vector<double> about_mean(values.begin(), values.end());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  for (double& value : about_mean) value -= mean;
  return spectrum(about_mean);
}

RecordSpectra spectra_of(const Stretch& stretch, std::size_t samples) {
  // A periodic record is in its steady state at its end rather than at its beginning.
  const auto tail = [&](const std::vector<double>& v) { return std::span(v).last(samples); };
  return {lines_of(tail(stretch.input)), lines_of(tail(stretch.output)),
          1 / (static_cast<double>(samples) * stretch.period_s)};
}

/// Steps hold the input between samples, everything else draws it straight: what most of the movement is made of.
Hold hold_of(const Recording& recording) {
  std::size_t moving = 0, steps = 0;
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kStep) ++steps;
    if (segment.kind == SegmentKind::kRamp || segment.kind == SegmentKind::kSweep)
      moving += segment.end - segment.begin;
  }
  return steps > 0 && moving < recording.samples() / 2 ? Hold::kHeld : Hold::kLinear;
}

double quantile_of(std::vector<double> values, double probability) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(probability * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Which samples the output spends at its greatest or least value, where quality found it clipped.
std::vector<std::uint8_t> clipped_samples(const Recording& recording) {
  std::vector<std::uint8_t> clipped(recording.samples(), 0);
  const bool found = std::any_of(recording.quality.begin(), recording.quality.end(),
                                 [](const QualityItem& item) { return item.code == "clipped"; });
  if (!found) return clipped;
  const auto& y = recording.output.values;
  const auto [low, high] = std::minmax_element(y.begin(), y.end());
  for (std::size_t i = 0; i < y.size();) {
    std::size_t end = i + 1;
    while (end < y.size() && y[end] == y[i]) ++end;
    if ((y[i] == *low || y[i] == *high) && end - i >= kClippedRun) {
      std::fill(clipped.begin() + static_cast<std::ptrdiff_t>(i), clipped.begin() + static_cast<std::ptrdiff_t>(end),
                1);
    }
    i = end;
  }
  return clipped;
}

/// Frequency of a swept sine at every sample from its zero crossings; empty where the input is no single tone.
std::vector<double> local_frequency_hz(const Recording& recording) {
  const auto& u = recording.input.values;
  const double middle = 0.5 * (quantile_of(u, kTailShare) + quantile_of(u, 1 - kTailShare));
  std::vector<std::size_t> crossings;
  for (std::size_t i = 1; i < u.size(); ++i) {
    if ((u[i] > middle) != (u[i - 1] > middle)) crossings.push_back(i);
  }
  if (crossings.size() < 8) return {};
  std::size_t steady = 0;
  for (std::size_t c = 2; c < crossings.size(); ++c) {
    const auto before = static_cast<double>(crossings[c - 1] - crossings[c - 2]);
    const auto after = static_cast<double>(crossings[c] - crossings[c - 1]);
    steady += std::abs(after - before) <= 0.5 * before + 2;
  }
  if (static_cast<double>(steady) < 0.9 * static_cast<double>(crossings.size() - 2)) return {};
  std::vector<double> frequency(u.size());
  std::size_t c = 1;
  for (std::size_t i = 0; i < u.size(); ++i) {
    while (c + 1 < crossings.size() && i >= crossings[c]) ++c;
    frequency[i] = 0.5 / (static_cast<double>(crossings[c] - crossings[c - 1]) * recording.sample_period_s);
  }
  return frequency;
}

/// The band a swept sine was in while the output was held at a limit; everything for other inputs; none where little
/// is.
std::optional<UnusableBand> clipped_band(std::span<const Recording* const> repeats) {
  constexpr double kBeside = 1.15;  // lines beside a tone see it too
  std::optional<UnusableBand> band;
  const auto widen = [&](double from_hz, double to_hz) {
    if (!band) band = UnusableBand{from_hz, to_hz, "clipped"};
    band->from_hz = std::min(band->from_hz, from_hz);
    band->to_hz = std::max(band->to_hz, to_hz);
  };
  for (const Recording* recording : repeats) {
    const auto clipped = clipped_samples(*recording);
    const auto count = static_cast<double>(std::count(clipped.begin(), clipped.end(), 1));
    if (count <= kClippedShare * static_cast<double>(clipped.size())) continue;
    const auto frequency = local_frequency_hz(*recording);
    if (frequency.empty()) {
      widen(0, recording->sample_rate_hz());
      continue;
    }
    for (std::size_t i = 0; i < clipped.size(); ++i) {
      if (clipped[i] != 0) widen(frequency[i] / kBeside, frequency[i] * kBeside);
    }
  }
  return band;
}

/// Takes points that cannot be relied on out, and says why.
void refuse_points(FrequencyResponse& response, const std::optional<UnusableBand>& clipped, double least_coherence) {
  std::vector<ResponsePoint> kept;
  for (const ResponsePoint& point : response.points) {
    const auto refuse = [&](const char* reason) {
      response.unusable.push_back({point.frequency_hz, point.frequency_hz, reason});
    };
    if (clipped && point.frequency_hz >= clipped->from_hz && point.frequency_hz <= clipped->to_hz) {
      refuse("clipped");
    } else if (!(point.coherence >= least_coherence) ||
               !(point.std_error <= kLargestRelativeError * std::abs(point.gain))) {
      refuse("low_coherence");
    } else {
      kept.push_back(point);
    }
  }
  response.points = std::move(kept);
}

/// Neighbouring bands of one reason become one, unless a usable point lies between them.
void merge_bands(FrequencyResponse& response) {
  auto& bands = response.unusable;
  std::sort(bands.begin(), bands.end(), [](const auto& a, const auto& b) { return a.from_hz < b.from_hz; });
  std::vector<UnusableBand> merged;
  for (const UnusableBand& band : bands) {
    const bool joins = !merged.empty() && merged.back().reason == band.reason &&
                       std::none_of(response.points.begin(), response.points.end(), [&](const ResponsePoint& point) {
                         return point.frequency_hz > merged.back().to_hz && point.frequency_hz < band.from_hz;
                       });
    if (joins) {
      merged.back().to_hz = std::max(merged.back().to_hz, band.to_hz);
    } else {
      merged.push_back(band);
    }
  }
  bands = std::move(merged);
}

std::string usable_text(const FrequencyResponse& response) {
  if (response.points.empty()) return "no frequency is usable";
  std::string text = fmt::format("usable: {} frequencies from {:.4g} to {:.4g} Hz", response.points.size(),
                                 response.points.front().frequency_hz, response.points.back().frequency_hz);
  return text;
}

const char* meaning_of(const std::string& reason) {
  if (reason == "clipped") return "the output stands at a limit";
  if (reason == "not_excited") return "the input holds too little there";
  return "the output does not follow the input there: noise, or something else moves it";
}

tl::unexpected<Error> too_little(const FrequencyResponse& response, const Recording& recording) {
  if (response.unusable.empty()) {
    return fail(
        "too_short",
        fmt::format("{} samples over {:.4g} s are too short for a frequency response: {}, at least {} are needed",
                    recording.samples(), static_cast<double>(recording.samples()) * recording.sample_period_s,
                    usable_text(response), kFewestResponsePoints));
  }
  const auto widest =
      std::max_element(response.unusable.begin(), response.unusable.end(),
                       [](const auto& a, const auto& b) { return a.to_hz - a.from_hz < b.to_hz - b.from_hz; });
  const auto clipped = std::find_if(response.unusable.begin(), response.unusable.end(),
                                    [](const auto& band) { return band.reason == "clipped"; });
  const UnusableBand& band = clipped != response.unusable.end() ? *clipped : *widest;
  return fail(band.reason, fmt::format("no frequency response: from {:.4g} to {:.4g} Hz {}; {}, at least {} are needed",
                                       band.from_hz, band.to_hz, meaning_of(band.reason), usable_text(response),
                                       kFewestResponsePoints));
}

Result<void> check_repeats(std::span<const Recording* const> repeats) {
  if (repeats.empty()) return tl::unexpected(fail("no_samples", "no recording was given").value());
  for (const Recording* recording : repeats) {
    if (recording->output.values.size() != recording->samples()) {
      return fail("no_samples", fmt::format("{} has no output", recording->name));
    }
    if (std::abs(recording->sample_period_s / repeats.front()->sample_period_s - 1) > 1e-6) {
      return fail("sample_time_differs",
                  fmt::format("{} is sampled at {:.6g} Hz, {} at {:.6g} Hz", recording->name,
                              recording->sample_rate_hz(), repeats.front()->name, repeats.front()->sample_rate_hz()));
    }
  }
  return {};
}

/// The period that all repeats share, 0 where they do not.
std::size_t common_period(const std::vector<Stretch>& stretches) {
  std::size_t period = 0;
  for (const Stretch& stretch : stretches) {
    const std::size_t own = period_of(stretch.input);
    if (own == 0 || (period != 0 && own != period)) return 0;
    period = own;
  }
  return period;
}

void estimate(const std::vector<Stretch>& stretches, const FrequencyResponseOptions& options,
              FrequencyResponse& response) {
  std::size_t shortest = stretches.front().input.size();
  for (const Stretch& stretch : stretches) shortest = std::min(shortest, stretch.input.size());
  const double highest_hz = kHighestOfRate / response.sample_period_s;
  const std::size_t period = common_period(stretches);
  std::vector<RecordSpectra> spectra;
  if (period > 0) {
    response.method = ResponseMethod::kPeriods;
    response.periods = static_cast<int>(shortest / period);
    const std::size_t samples = static_cast<std::size_t>(response.periods) * period;
    for (const Stretch& stretch : stretches) spectra.push_back(spectra_of(stretch, samples));
    PeriodicEstimate periodic =
        estimate_by_periods(spectra, static_cast<std::size_t>(response.periods), highest_hz, options.points_per_decade);
    response.points = std::move(periodic.response.points);
    response.distortion = std::move(periodic.distortion);
    return;
  }
  for (const Stretch& stretch : stretches) {
    spectra.push_back(spectra_of(stretch, smooth_length_below(stretch.input.size())));
  }
  ResponseEstimate local = estimate_by_local_polynomials(spectra, highest_hz, options.points_per_decade);
  response.points = std::move(local.points);
  response.unusable = std::move(local.unusable);
}

}  // namespace

std::string to_string(ResponseMethod method) {
  return method == ResponseMethod::kPeriods ? "periods" : "local_polynomial";
}

Complex hold_factor(Hold hold, double frequency_hz, double sample_period_s) {
  const double x = std::numbers::pi * frequency_hz * sample_period_s;
  const double sinc = x == 0 ? 1 : std::sin(x) / x;
  return hold == Hold::kLinear ? Complex(sinc * sinc) : std::polar(1.0, -x) * sinc;
}

std::size_t period_of(std::span<const double> input) {
  const std::size_t n = input.size();
  if (n < 2 * kShortestPeriod) return 0;
  const std::vector<double> r = autocovariance(input);
  const auto correlation = [&](std::size_t l) {
    return r[l] / r[0] * static_cast<double>(n) / static_cast<double>(n - l);
  };
  std::size_t l = 1;
  while (l < n / 2 && correlation(l) > 0.5) ++l;
  std::size_t candidates = 0;
  for (l = std::max(l, kShortestPeriod); l <= n / 2 && candidates < kMostPeriodCandidates; ++l) {
    const double here = correlation(l);
    if (here < 0.9 || here < correlation(l - 1) || (l + 1 < n && here < correlation(l + 1))) continue;
    ++candidates;
    double difference = 0;
    for (std::size_t t = 0; t + l < n; ++t) difference += (input[t + l] - input[t]) * (input[t + l] - input[t]);
    // Two periods with noise σ² each differ by 2 σ²; the last periods count, the first may begin with a hold.
    if (difference / static_cast<double>(n - l) < 2 * kRepeatsWithin * r[0] / static_cast<double>(n)) return l;
  }
  return 0;
}

Result<FrequencyResponse> estimate_frequency_response(std::span<const Recording* const> repeats,
                                                      const FrequencyResponseOptions& options) {
  if (auto checked = check_repeats(repeats); !checked) return tl::unexpected(checked.error());
  FrequencyResponse response;
  response.hold = hold_of(*repeats.front());
  response.sample_period_s = repeats.front()->sample_period_s;
  response.repeats = static_cast<int>(repeats.size());
  std::vector<Stretch> stretches;
  for (const Recording* recording : repeats) {
    stretches.push_back(usable_stretch(*recording));
    const auto& u = recording->input.values;
    const double share = 1 / static_cast<double>(repeats.size());
    response.input_mean += share * std::accumulate(u.begin(), u.end(), 0.0) / static_cast<double>(u.size());
    response.input_amplitude += share * 0.5 * (quantile_of(u, 1 - kTailShare) - quantile_of(u, kTailShare));
  }
  const bool empty =
      std::any_of(stretches.begin(), stretches.end(), [](const Stretch& s) { return s.input.size() < 4; });
  if (!empty) estimate(stretches, options, response);
  for (ResponsePoint& point : response.points) {
    const Complex factor = hold_factor(response.hold, point.frequency_hz, response.sample_period_s);
    point.gain /= factor;
    point.std_error /= std::abs(factor);
  }
  refuse_points(response, clipped_band(repeats), options.least_coherence);
  merge_bands(response);
  if (response.points.size() < kFewestResponsePoints) return too_little(response, *repeats.front());
  return response;
}

std::vector<double> normalised_gain(std::span<const ResponsePoint> points) {
  std::vector<double> gain;
  for (const ResponsePoint& point : points) gain.push_back(std::abs(point.gain) / std::abs(points.front().gain));
  return gain;
}

std::vector<double> unwrapped_phase_deg(std::span<const ResponsePoint> points) {
  std::vector<double> phase_deg;
  Complex before = 1;
  double phase = 0;
  for (const ResponsePoint& point : points) {
    phase += std::arg(point.gain / before);
    before = point.gain;
    phase_deg.push_back(phase * 180 / std::numbers::pi);
  }
  return phase_deg;
}

double gain_half_width95(const ResponsePoint& point) {
  return student_t_half_width95(std::max(1.0, 2 * point.degrees_of_freedom)) * point.std_error / std::numbers::sqrt2;
}

std::optional<AmplitudeDependence> compare_amplitudes(const FrequencyResponse& low, const FrequencyResponse& high) {
  constexpr std::size_t kFewestShared = 4;
  AmplitudeDependence d{.amplitude_low = low.input_amplitude, .amplitude_high = high.input_amplitude};
  double change = 0, expected = 0, statistic = 0, freedom = 1e9;
  for (const ResponsePoint& point : low.points) {
    const auto above =
        std::lower_bound(high.points.begin(), high.points.end(), point.frequency_hz,
                         [](const ResponsePoint& p, double f) { return p.frequency_hz < f * (1 - 1e-9); });
    if (above == high.points.end()) break;
    ResponsePoint other = *above;
    if (above->frequency_hz > point.frequency_hz * (1 + 1e-9)) {
      if (above == high.points.begin()) continue;
      const ResponsePoint& below = *(above - 1);
      if (above->frequency_hz > 1.5 * below.frequency_hz) continue;
      const double share = (point.frequency_hz - below.frequency_hz) / (above->frequency_hz - below.frequency_hz);
      other.gain = (1 - share) * below.gain + share * above->gain;
      other.std_error = std::hypot((1 - share) * below.std_error, share * above->std_error);
    }
    const double variance = point.std_error * point.std_error + other.std_error * other.std_error;
    change += std::norm(other.gain - point.gain) / std::norm(point.gain);
    expected += variance / std::norm(point.gain);
    statistic += std::norm(other.gain - point.gain) / std::max(variance, 1e-300);
    freedom = std::min({freedom, point.degrees_of_freedom, other.degrees_of_freedom});
    ++d.points;
  }
  if (d.points < kFewestShared) return std::nullopt;
  const auto n = static_cast<double>(d.points);
  d.change_rms = std::sqrt(std::max(0.0, (change - expected) / n));
  d.expected = std::sqrt(expected / n);
  d.p_value = fisher_f_upper_tail(2 * n, 2 * std::max(freedom, 1.0), statistic / n);
  return d;
}

}  // namespace valvetriage
