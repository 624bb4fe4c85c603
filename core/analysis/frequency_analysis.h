#pragma once

#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/identify/response_order.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// A gain of so many nepers in dB.
inline double decibels(double neper) {
  return 20 * neper / std::numbers::ln10;
}

/// One figure of a frequency response. std_error is NaN where it has none.
struct ResponseFeature {
  std::string name;  ///< as in response_features
  double value = 0;
  double std_error = 0;
  std::string unit;  ///< Hz, dB, dB/decade, deg, s
};

/// What an analysis says of the recordings that hold one sweep (or multisine, or noise) at one amplitude.
struct FrequencyResult {
  std::vector<std::size_t> recordings;  ///< indices in the analysed set: repeats of one test
  std::string refused;                  ///< why there is no response; empty where there is one
  FrequencyResponse response;
  std::optional<ResponseModel> model;
  std::vector<TriedResponseOrder> tried;
  std::string order_reason;
  std::optional<double> fit_percent;  ///< of the model's free run over these recordings
  std::vector<ResponseFeature> features;
  std::optional<AmplitudeDependence> amplitude_dependence;  ///< against the next smaller amplitude
};

/// Frequency responses of a valve's recordings, by test and amplitude.
///
/// A recording whose input oscillates for more than half of its time is one; those of equal length, rate, operating
/// point (within a tenth of the amplitude) and amplitude (within a tenth) are repeats and averaged.
///
/// returns  by rising amplitude; a group that gives no response has `refused`
/// Cost     O(n log n) and about half a second per group; pure
std::vector<FrequencyResult> analyze_frequency(std::span<const Recording> recordings);

/// Features of a fitted response within its band.
///
///   bandwidth_hz             gain falls below 1/√2 of its value at the lowest frequency (−3 dB)
///   corner_hz                the first corner: where the tangent of −20 dB/decade meets that value. A second lag moves
///   it
///                            down, as it does the bandwidth; a corner of the whole roll-off would jump up by half an
///                            octave where the roll-off comes nearer to 40 than to 20 dB/decade. None where the gain
///                            peaks by 3 dB: resonance_hz tells where it falls
///   rolloff_db_per_decade    slope of ln gain over ln f from twice the bandwidth to eight times, or the band's end
///   resonance_peak_db, resonance_hz   largest gain over that at the lowest frequency; 0 dB without one
///   phase_at_corner_deg      at corner_hz, from the phase at the lowest frequency
///   delay_s                  of the model
///
/// What the band does not reach is absent. Standard errors: of the bandwidth by the gain's own at the next point over
/// the slope there; of the delay from the fit.
std::vector<ResponseFeature> response_features(const FrequencyResponse& response, const ResponseModel& model);

/// −3 dB bandwidth [Hz] at a level of the input: of the response of the smallest amplitude whose input covers it (mean
/// ± amplitude, a hundredth of it to spare). Empty where none does or its band ends before.
std::optional<double> bandwidth_at(std::span<const FrequencyResult> results, double level);

/// How far the transfer function of a sweep and the steps of the same valve are apart: rms of measured − simulated
/// [unit of the output].
///
/// Every hold of a step recording has its settled output (mean of its last fifth). Steps from one settled output to the
/// next, held, go through G / G(0) sampled exactly at the recording's rate; compared are the holds entered by a step
/// whose level lies within what the sweep covered (operating point ± amplitude), else, where there is none, all. So the
/// steady map and its curvature do not count: the dynamics are compared, and only there where the sweep has seen them.
/// Empty without a model, without such steps, or where the model has no static gain.
std::optional<double> cross_domain_rmse(std::span<const Recording> recordings,
                                        std::span<const FrequencyResult> results);

}  // namespace valvetriage
