#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/model/model.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// Samples of one valve that are fitted and searched for causes: a session at 1 kHz twice over, twenty minutes at
/// 200 Hz. So many take a minute, where the spool sticks five; ten times as many would not end within the time and
/// memory of a job, and the verdict would be lost.
inline constexpr std::size_t kMostFittedSamples = 240'000;

/// Recordings as they are fitted: what is sampled faster than a reference is thinned, what is still too much is cut.
///
/// stride   every how many samples one is kept, by recording
/// covered  samples of the given recording up to which it is fitted, by recording
struct PartToFit {
  std::vector<Recording> recordings;
  std::vector<std::size_t> stride, covered;

  bool is_whole = true;  ///< every sample is fitted
};

/// Keeps every n-th sample down to the rate of the reference, for what good valves show is known of so many samples a
/// second: a tenth of a noise is nothing there and a certain fault in ten times as many. Where more than `most` are
/// left, keeps fewer, down to 200 Hz; then the first part of the longest recordings. The instant of a step stays where
/// it was. Side channels are the same in every recording, in the same order, empty where a recording lacks one.
///
/// period_s  of the reference's recordings [s]; 0: as they are
/// Cost      O(n)
PartToFit part_to_fit(std::span<const Recording> recordings, double period_s, std::size_t most = kMostFittedSamples);

/// A free run of each recording of a part, on the samples of the given recordings: straight between the samples that
/// were kept, and of a recording that was cut the free run of `model` from there on.
Result<std::vector<std::vector<double>>> on_all_samples(const PartToFit& part, std::vector<std::vector<double>> runs,
                                                        const Model& model, std::span<const Recording> recordings);

}  // namespace valvetriage
