#include "core/analysis/frequency_analysis.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/identify/identification.h"
#include "core/model/linear_filter.h"
#include "core/recording/segments.h"

namespace valvetriage {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kAlikeShare = 0.1;     // of the amplitude: repeats of one test differ by less
constexpr int kGridPerDecade = 200;     // on which features are read off the model
constexpr double kCoveredShare = 1.01;  // of the amplitude: its estimate errs
constexpr double kPeaks =
    0.5 * std::numbers::ln2;                // 3 dB above the lowest frequency: falls from its peak, not a corner
constexpr double kRolloffFrom = 2;          // bandwidths
constexpr double kRolloffTo = 8;            // two octaves further, so that the slope does not depend on the band
constexpr double kShortestRolloff = 1.5;    // ratio of frequencies that gives a slope
constexpr double kSettledShare = 0.2;       // the end of a hold
constexpr std::size_t kShortestHold = 50;   // samples: a settled end of ten
constexpr double kSettledBandwidths = 1.5;  // a hold this many 1/bandwidth long has settled to a percent

struct Excitation {
  double mean = 0, amplitude = 0;
};

Excitation excitation_of(const Recording& recording) {
  std::vector<double> u = recording.input.values;
  std::sort(u.begin(), u.end());
  const auto at = [&](double share) { return u[static_cast<std::size_t>(share * static_cast<double>(u.size() - 1))]; };
  Excitation e{.mean = 0.5 * (at(0.01) + at(0.99)), .amplitude = 0.5 * (at(0.99) - at(0.01))};
  return e;
}

struct Group {
  std::vector<std::size_t> members;
  Excitation excitation;
};

bool alike(const Recording& a, const Excitation& ea, const Recording& b, const Excitation& eb) {
  const double amplitude = std::max(ea.amplitude, eb.amplitude);
  return a.samples() == b.samples() && std::abs(a.sample_period_s / b.sample_period_s - 1) < 1e-6 &&
         std::abs(ea.mean - eb.mean) <= kAlikeShare * amplitude &&
         std::abs(ea.amplitude - eb.amplitude) <= kAlikeShare * amplitude;
}

std::vector<Group> groups_of(std::span<const Recording> recordings) {
  std::vector<Group> groups;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    if (!oscillates(recordings[r])) continue;
    const Excitation own = excitation_of(recordings[r]);
    auto known = std::find_if(groups.begin(), groups.end(), [&](const Group& group) {
      return alike(recordings[group.members.front()], group.excitation, recordings[r], own);
    });
    if (known == groups.end()) known = groups.insert(groups.end(), Group{{}, own});
    known->members.push_back(r);
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& a, const Group& b) { return a.excitation.amplitude < b.excitation.amplitude; });
  return groups;
}

FrequencyResult result_of(std::span<const Recording> recordings, const Group& group) {
  FrequencyResult result{.recordings = group.members};
  std::vector<const Recording*> repeats;
  for (const std::size_t r : group.members) repeats.push_back(&recordings[r]);
  auto response = estimate_frequency_response(repeats);
  if (!response) {
    result.refused = response.error().message;
    return result;
  }
  result.response = std::move(*response);
  auto choice = choose_response_order(result.response, {});
  if (!choice) {
    result.order_reason = choice.error().message;
    return result;
  }
  result.model = std::move(choice->model);
  result.tried = std::move(choice->tried);
  result.order_reason = std::move(choice->reason);
  result.features = response_features(result.response, *result.model);
  const auto run = free_run_of_response(repeats, result.model->transfer_function, result.response.hold);
  if (run) result.fit_percent = run->fit_percent;
  return result;
}

/// The model on a fine logarithmic grid of its band, relative to the lowest frequency: ln f, ln gain, phase [rad].
struct Curve {
  std::vector<double> x, y, phase;
};

Curve curve_of(const FrequencyResponse& response, const TransferFunction& g) {
  const double from = response.points.front().frequency_hz, to = response.points.back().frequency_hz;
  const auto n = static_cast<std::size_t>(std::ceil(std::log10(to / from) * kGridPerDecade)) + 2;
  std::vector<double> f;
  for (std::size_t i = 0; i < n; ++i) {
    f.push_back(from * std::pow(to / from, static_cast<double>(i) / static_cast<double>(n - 1)));
  }
  const auto gain = frequency_response(g, f);
  Curve curve;
  double phase = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) phase += std::arg(gain[i] / gain[i - 1]);
    curve.x.push_back(std::log(f[i]));
    curve.y.push_back(std::log(std::abs(gain[i]) / std::abs(gain[0])));
    curve.phase.push_back(phase);
  }
  return curve;
}

/// First x at which y falls below a level; NaN where it does not.
double first_fall(const Curve& curve, double level, double& slope) {
  for (std::size_t i = 1; i < curve.y.size(); ++i) {
    if (curve.y[i] >= level) continue;
    slope = (curve.y[i] - curve.y[i - 1]) / (curve.x[i] - curve.x[i - 1]);
    return curve.x[i - 1] + (level - curve.y[i - 1]) / slope;
  }
  return kNone;
}

double relative_error_near(const FrequencyResponse& response, double frequency_hz) {
  const auto nearest =
      std::min_element(response.points.begin(), response.points.end(), [&](const auto& a, const auto& b) {
        return std::abs(std::log(a.frequency_hz / frequency_hz)) < std::abs(std::log(b.frequency_hz / frequency_hz));
      });
  return nearest->std_error / std::abs(nearest->gain) / std::numbers::sqrt2;
}

/// The part of a curve in which it rolls off, as indices; empty where the band is too short for a slope.
struct Stretch {
  std::size_t begin = 0, end = 0;
};
Stretch rolloff_of(const Curve& curve, double bandwidth) {
  const double from = bandwidth + std::log(kRolloffFrom);
  const double to = std::min(curve.x.back(), bandwidth + std::log(kRolloffTo));
  if (!(to - from > std::log(kShortestRolloff))) return {};
  const auto at = [&](double x) {
    return static_cast<std::size_t>(std::lower_bound(curve.x.begin(), curve.x.end(), x) - curve.x.begin());
  };
  return {at(from), std::min(at(to) + 1, curve.x.size())};
}

/// dy/dx by least squares.
double slope_of(const Curve& curve, const Stretch& stretch) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = stretch.begin; i < stretch.end; ++i) {
    n += 1;
    sx += curve.x[i];
    sy += curve.y[i];
    sxx += curve.x[i] * curve.x[i];
    sxy += curve.x[i] * curve.y[i];
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

/// Where the tangent of −20 dB/decade meets y = 0: at the first point that falls as steeply, else at the steepest one
/// up to `end` (a lag seen an octave or two beyond its corner has nearly reached its asymptote).
double first_corner_of(const Curve& curve, std::size_t end) {
  double steepest = 0, corner = kNone;
  for (std::size_t i = 1; i < end; ++i) {
    const double slope = (curve.y[i] - curve.y[i - 1]) / (curve.x[i] - curve.x[i - 1]);
    if (slope >= steepest) continue;
    steepest = slope;
    corner = curve.x[i] + curve.y[i];
    if (slope <= -1) break;
  }
  return corner;
}

/// A hold entered by a step, in samples.
struct SettledHold {
  std::size_t begin = 0, end = 0;
  double level = 0;    ///< of the input
  double settled = 0;  ///< of the output
  bool by_step = false;
};

std::vector<SettledHold> holds_of(const Recording& recording) {
  std::vector<SettledHold> holds;
  for (const Segment& segment : recording.segments) {
    if (segment.kind != SegmentKind::kStep && segment.kind != SegmentKind::kHold) return {};
    SettledHold hold{segment.begin, segment.end, segment.level, 0, segment.kind == SegmentKind::kStep};
    const auto tail = std::max<std::size_t>(
        1, static_cast<std::size_t>(kSettledShare * static_cast<double>(segment.end - segment.begin)));
    for (std::size_t i = segment.end - tail; i < segment.end; ++i) {
      hold.settled += recording.output.values[i] / static_cast<double>(tail);
    }
    holds.push_back(hold);
  }
  return holds;
}

struct Squares {
  double inside = 0, all = 0;
  std::size_t inside_samples = 0, all_samples = 0;
};

void add_disagreement(const Recording& recording, const TransferFunction& dynamics, const FrequencyResponse& response,
                      double least_hold_s, Squares& squares) {
  const auto holds = holds_of(recording);
  const auto filter = LinearFilter::sampled(dynamics, recording.sample_period_s);
  if (holds.size() < 2 || !filter) return;
  std::vector<double> steady(recording.samples()), simulated(recording.samples());
  for (const SettledHold& hold : holds) {
    std::fill(steady.begin() + static_cast<std::ptrdiff_t>(hold.begin),
              steady.begin() + static_cast<std::ptrdiff_t>(hold.end), hold.settled);
  }
  auto state = filter->steady(steady.front());
  if (!state) return;
  filter->run(*state, steady, steady, simulated);
  for (const SettledHold& hold : holds) {
    const std::size_t samples = hold.end - hold.begin;
    if (!hold.by_step || samples < kShortestHold) continue;
    if (static_cast<double>(samples) * recording.sample_period_s < least_hold_s) continue;
    const bool inside = std::abs(hold.level - response.input_mean) <= response.input_amplitude;
    for (std::size_t i = hold.begin; i < hold.end; ++i) {
      if (!recording.is_valid(i)) continue;
      const double square = std::pow(recording.output.values[i] - simulated[i], 2);
      squares.all += square;
      ++squares.all_samples;
      if (!inside) continue;
      squares.inside += square;
      ++squares.inside_samples;
    }
  }
}

double feature_or(const FrequencyResult& result, const char* name, double otherwise) {
  const auto found = std::find_if(result.features.begin(), result.features.end(),
                                  [&](const ResponseFeature& feature) { return feature.name == name; });
  return found == result.features.end() ? otherwise : found->value;
}

/// Slope, and where there is one the first corner and the phase there; `add` takes name, value, standard error and
/// unit.
template <typename Add>
void add_rolloff(const Curve& curve, double bandwidth, bool has_corner, const Add& add) {
  const Stretch stretch = rolloff_of(curve, bandwidth);
  if (stretch.begin == stretch.end) return;
  const double slope = slope_of(curve, stretch);
  const double corner = first_corner_of(curve, stretch.end);
  if (has_corner && corner > curve.x.front() && corner < curve.x.back()) {
    const auto at = std::lower_bound(curve.x.begin(), curve.x.end(), corner) - curve.x.begin();
    add("corner_hz", std::exp(corner), kNone, "Hz");
    add("phase_at_corner_deg", curve.phase[static_cast<std::size_t>(at)] * 180 / std::numbers::pi, kNone, "deg");
  }
  add("rolloff_db_per_decade", decibels(slope * std::numbers::ln10), kNone, "dB/decade");
}

}  // namespace

std::vector<ResponseFeature> response_features(const FrequencyResponse& response, const ResponseModel& model) {
  const Curve curve = curve_of(response, model.transfer_function);
  std::vector<ResponseFeature> features;
  const auto add = [&](const char* name, double value, double std_error, const char* unit) {
    if (std::isfinite(value)) features.push_back({name, value, std_error, unit});
  };
  const auto peak = std::max_element(curve.y.begin(), curve.y.end());
  double slope = kNone;
  const double x3 = first_fall(curve, -0.5 * std::numbers::ln2, slope);
  const double bandwidth_hz = std::exp(x3);
  if (std::isfinite(x3)) {
    add("bandwidth_hz", bandwidth_hz, bandwidth_hz * relative_error_near(response, bandwidth_hz) / std::abs(slope),
        "Hz");
    add_rolloff(curve, x3, *peak < kPeaks, add);
  }
  add("resonance_peak_db", decibels(*peak), kNone, "dB");
  if (*peak > 0) {
    add("resonance_hz", std::exp(curve.x[static_cast<std::size_t>(peak - curve.y.begin())]), kNone, "Hz");
  }
  add("delay_s", model.transfer_function.delay_s, model.delay_std_error_s, "s");
  return features;
}

std::vector<FrequencyResult> analyze_frequency(std::span<const Recording> recordings) {
  std::vector<FrequencyResult> results;
  for (const Group& group : groups_of(recordings)) results.push_back(result_of(recordings, group));
  for (std::size_t i = 0; i < results.size(); ++i) {
    for (std::size_t j = i; j-- > 0;) {
      const bool comparable = results[i].refused.empty() && results[j].refused.empty() &&
                              results[i].response.method == results[j].response.method;
      if (!comparable) continue;
      results[i].amplitude_dependence = compare_amplitudes(results[j].response, results[i].response);
      break;
    }
  }
  return results;
}

std::optional<double> bandwidth_at(std::span<const FrequencyResult> results, double level) {
  for (const FrequencyResult& result : results) {
    const double distance = std::abs(level - result.response.input_mean);
    const double bandwidth_hz = feature_or(result, "bandwidth_hz", kNone);
    if (distance <= kCoveredShare * result.response.input_amplitude && std::isfinite(bandwidth_hz)) return bandwidth_hz;
  }
  return std::nullopt;
}

std::optional<double> cross_domain_rmse(std::span<const Recording> recordings,
                                        std::span<const FrequencyResult> results) {
  const auto found =
      std::find_if(results.begin(), results.end(), [](const FrequencyResult& r) { return r.model.has_value(); });
  if (found == results.end()) return std::nullopt;
  TransferFunction dynamics = found->model->transfer_function;
  const double gain = static_gain(dynamics);
  if (!std::isfinite(gain) || gain == 0 || !is_stable(dynamics)) return std::nullopt;
  dynamics.gain /= gain;
  const double bandwidth_hz = feature_or(*found, "bandwidth_hz", found->response.points.back().frequency_hz);
  Squares squares;
  for (const Recording& recording : recordings) {
    if (oscillates(recording)) continue;
    add_disagreement(recording, dynamics, found->response, kSettledBandwidths / bandwidth_hz, squares);
  }
  if (squares.inside_samples > 0) return std::sqrt(squares.inside / static_cast<double>(squares.inside_samples));
  if (squares.all_samples > 0) return std::sqrt(squares.all / static_cast<double>(squares.all_samples));
  return std::nullopt;
}

}  // namespace valvetriage
