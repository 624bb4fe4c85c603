#include "core/discrepancy/valve_catalogue.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/discrepancy/input_lines.h"
#include "core/discrepancy/tones.h"

namespace valvetriage {
namespace {

constexpr std::size_t kTones = 3;
constexpr std::size_t kHuntingTones = 3;
// A stop keeps this share of the readings at least, or it is not worth a look.
constexpr double kAtTheStop = 0.02;
// An abrupt change is looked for at this many instants of each recording; the fit moves them.
constexpr int kInstants = 24;
// Of a recording's energy, on either side of such an instant.
constexpr double kEnergyBesideInstant = 0.1;

double quantile_of_readings(const LinearisedValve& fit, double share) {
  std::vector<double> readings;
  for (std::size_t r = 0; r < fit.problem().recordings(); ++r) {
    const Recording& recording = fit.problem().recording(r);
    for (const std::size_t i : fit.rows()[r].sample) readings.push_back(recording.output.values[i]);
  }
  if (readings.empty()) return 0;
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(readings.size() - 1));
  std::nth_element(readings.begin(), readings.begin() + at, readings.end());
  return readings[static_cast<std::size_t>(at)];
}

MechanismScales scales_of(const LinearisedValve& fit, const ValveFitOptions& options) {
  MechanismScales scales;
  scales.sample_period_s = std::numeric_limits<double>::infinity();
  scales.input_low = scales.output_low = std::numeric_limits<double>::infinity();
  scales.input_high = scales.output_high = -std::numeric_limits<double>::infinity();
  for (std::size_t r = 0; r < fit.problem().recordings(); ++r) {
    const Recording& recording = fit.problem().recording(r);
    const double length_s = static_cast<double>(recording.samples()) * recording.sample_period_s;
    scales.sample_period_s = std::min(scales.sample_period_s, recording.sample_period_s);
    scales.longest_s = std::max(scales.longest_s, length_s);
    const auto [low, high] = std::minmax_element(recording.input.values.begin(), recording.input.values.end());
    scales.input_low = std::min(scales.input_low, *low);
    scales.input_high = std::max(scales.input_high, *high);
    const auto& output = fit.run(r).output;
    const auto [least, most] = std::minmax_element(output.begin(), output.end());
    scales.output_low = std::min(scales.output_low, *least);
    scales.output_high = std::max(scales.output_high, *most);
  }
  scales.reading_low = quantile_of_readings(fit, kAtTheStop);
  scales.reading_high = quantile_of_readings(fit, 1 - kAtTheStop);
  scales.output_range = 2 * options.reference_psi;
  scales.recordings = fit.problem().recordings();
  for (std::size_t c = 0; c < fit.problem().recording(0).side.size(); ++c) {
    std::vector<double> values;
    for (std::size_t r = 0; r < fit.problem().recordings(); ++r) {
      const std::vector<Channel>& side = fit.problem().recording(r).side;
      if (c < side.size()) values.insert(values.end(), side[c].values.begin(), side[c].values.end());
    }
    if (values.empty()) values.push_back(0);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    const double sum = std::accumulate(values.begin(), values.end(), 0.0);
    scales.side.push_back({*low, *high, sum / static_cast<double>(values.size())});
  }
  for (std::size_t k = 0; k + 1 < options.knots.size(); ++k) {
    const auto knot = ValveFitProblem::kParameters + static_cast<Eigen::Index>(k);
    const double rise = fit.at()(knot + 1) - fit.at()(knot);
    scales.slope = std::max(scales.slope, std::abs(rise) / (options.knots[k + 1] - options.knots[k]));
  }
  return scales;
}

LawInFit law_in_fit(const Mechanism& mechanism, const MechanismBounds& bounds) {
  return {.law = &mechanism,
          .start = bounds.starts.empty() ? bounds.lower : bounds.starts.front(),
          .lower = bounds.lower,
          .upper = bounds.upper,
          .step = bounds.step};
}

/// Own parameters repeated for every recording behind the shared ones.
std::vector<double> for_all_recordings(const LawInFit& law, const std::vector<double>& start, std::size_t recordings) {
  std::vector<double> all(start.begin(), start.begin() + static_cast<std::ptrdiff_t>(law.shared()));
  for (std::size_t r = 0; r < recordings; ++r) {
    all.insert(all.end(), start.begin() + static_cast<std::ptrdiff_t>(law.shared()), start.end());
  }
  return all;
}

void add_tones(const LinearisedValve& fit, const LawInFit& law, std::vector<LawVariant>& variants) {
  LawVariant variant{.law = law};
  for (const Tone& tone : strongest_tones(fit, kTones)) {
    if (stands_in_input(fit.problem(), tone.frequency_hz)) continue;
    std::vector<double> start{tone.frequency_hz, tone.amplitude};
    start.insert(start.end(), tone.phase_rad.begin(), tone.phase_rad.end());
    variant.starts.push_back(std::move(start));
  }
  if (!variant.starts.empty()) variants.push_back(std::move(variant));
}

/// How near to a rest a cycle's own level lies and how far it reaches are nobody's guess: a few of each, with the
/// frequency and the amplitude that were seen at the rest. Where nothing rests, a cycle that reaches far around one of
/// the levels that are there is as good an account of a tone as a disturbance. Its phase is followed in the reading.
void add_hunting(const LinearisedValve& fit, const MechanismScales& scales, const LawInFit& law,
                 std::vector<LawVariant>& variants) {
  constexpr double kGrowth_per_s = 10;
  LawVariant variant{.law = law};
  for (const HuntingTone& tone : hunting_tones(fit, scales.output_range, kHuntingTones)) {
    for (const double beside : {-0.06, 0.0, 0.06}) {
      for (const double width : {0.2, 0.35}) {
        const double at_rest = std::sqrt(1 - beside * beside / (width * width));
        variant.starts.push_back({tone.frequency_hz * (1 + tone.slope * beside), tone.amplitude / at_rest,
                                  tone.level + beside * scales.output_range, width * scales.output_range, tone.slope,
                                  kGrowth_per_s, 0.0});
      }
    }
  }
  if (variant.starts.empty()) {
    for (const Tone& tone : strongest_tones(fit, kHuntingTones)) {
      if (stands_in_input(fit.problem(), tone.frequency_hz)) continue;
      for (const double share : {0.25, 0.5, 0.75}) {
        const double level = scales.output_low + share * (scales.output_high - scales.output_low);
        variant.starts.push_back(
            {tone.frequency_hz, tone.amplitude, level, 0.35 * scales.output_range, 0.0, kGrowth_per_s, 0.0});
      }
    }
  }
  if (!variant.starts.empty()) variants.push_back(std::move(variant));
}

/// The time by which a recording's output has spent a share of its energy.
double time_of_share(const std::vector<double>& output, double sample_period_s, double share) {
  const double energy = std::inner_product(output.begin(), output.end(), output.begin(), 0.0);
  double spent = 0;
  std::size_t i = 0;
  while (i < output.size() && spent < share * energy) {
    spent += output[i] * output[i];
    ++i;
  }
  return static_cast<double>(i) * sample_period_s;
}

/// An abrupt change of gain is one where the output before it and the output after it tell their gains: at the ends of
/// a recording it is a gain that one recording has as a whole.
void add_instants(const LinearisedValve& fit, const LawInFit& law, std::vector<LawVariant>& variants) {
  for (std::size_t r = 0; r < fit.problem().recordings(); ++r) {
    const double period_s = fit.problem().recording(r).sample_period_s;
    LawVariant variant{.law = law};
    variant.law.recording = r;
    const double first_s = time_of_share(fit.run(r).output, period_s, kEnergyBesideInstant);
    const double last_s = time_of_share(fit.run(r).output, period_s, 1 - kEnergyBesideInstant);
    variant.law.lower[kInstantOf] = first_s;
    variant.law.upper[kInstantOf] = last_s;
    variant.law.lower.back() = variant.law.upper.back() = static_cast<double>(r);
    for (int i = 0; i < kInstants; ++i) {
      std::vector<double> start = law.start;
      start[kInstantOf] = first_s + (last_s - first_s) * (i + 0.25) / kInstants;
      start.back() = static_cast<double>(r);
      variant.starts.push_back(std::move(start));
    }
    variants.push_back(std::move(variant));
  }
}

/// Its last parameter, a whole number, says whether it acts in the valve's blocks.
bool acts_at_two_places(const Mechanism& mechanism, const MechanismBounds& bounds) {
  return mechanism.is_in_blocks && bounds.step.back() == 0;
}

/// A law that acts at one of two places is searched at each of them.
void add_places(const LawInFit& law, const MechanismBounds& bounds, std::vector<LawVariant>& variants) {
  for (const double place : {0.0, 1.0}) {
    LawVariant variant{.law = law};
    variant.law.lower.back() = variant.law.upper.back() = place;
    for (const auto& start : bounds.starts) {
      if (start.back() == place) variant.starts.push_back(start);
    }
    variants.push_back(std::move(variant));
  }
}

void add_channels(const LinearisedValve& fit, const LawInFit& law, const MechanismBounds& bounds,
                  const MechanismScales& scales, ValveCatalogue& catalogue) {
  constexpr std::size_t kReference = 1;
  const std::size_t channels = fit.problem().recording(0).side.size();
  for (std::size_t c = 0; c < channels; ++c) {
    LawVariant variant{.law = law};
    variant.law.channel = c;
    variant.law.lower.back() = variant.law.upper.back() = static_cast<double>(c);
    variant.law.lower[kReference] = scales.side[c].least;
    variant.law.upper[kReference] = scales.side[c].largest;
    for (const auto& start : bounds.starts) {
      if (start.back() == static_cast<double>(c)) variant.starts.push_back(start);
    }
    catalogue.variants.push_back(std::move(variant));
  }
  if (channels == 0) {
    catalogue.untestable.push_back({.cause = std::string(law.law->cause),
                                    .status = CandidateStatus::kNotIdentifiable,
                                    .reason = "no side channel was named"});
  }
}

}  // namespace

ValveCatalogue valve_catalogue(const LinearisedValve& fit, const ValveFitOptions& options) {
  const MechanismScales scales = scales_of(fit, options);
  ValveCatalogue catalogue;
  for (const Mechanism* mechanism : all_mechanisms()) {
    const MechanismBounds bounds = mechanism->bounds(scales);
    const LawInFit law = law_in_fit(*mechanism, bounds);
    if (mechanism->cause == "rectified_sensor") {
      if (scales.output_low < -0.02 * scales.output_range) {
        catalogue.variants.push_back({.law = law, .starts = {{}}});
      } else {
        catalogue.untestable.push_back({.cause = "rectified_sensor",
                                        .status = CandidateStatus::kNotExcited,
                                        .reason = "the output is never negative, so its magnitude is itself"});
      }
    } else if (mechanism->cause == "periodic_disturbance") {
      add_tones(fit, law, catalogue.variants);
    } else if (mechanism->cause == "self_oscillation") {
      add_hunting(fit, scales, law, catalogue.variants);
    } else if (mechanism->cause == "intermittent") {
      add_instants(fit, law, catalogue.variants);
    } else if (acts_at_two_places(*mechanism, bounds)) {
      add_places(law, bounds, catalogue.variants);
    } else if (mechanism->cause == "side_input") {
      add_channels(fit, law, bounds, scales, catalogue);
    } else {
      LawVariant variant{.law = law};
      for (const auto& start : bounds.starts) {
        variant.starts.push_back(for_all_recordings(law, start, fit.problem().recordings()));
      }
      catalogue.variants.push_back(std::move(variant));
    }
  }
  return catalogue;
}

}  // namespace valvetriage
