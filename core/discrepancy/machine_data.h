#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/recording/intersample.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// A stretch of one recording as the search sees it: input and output in their own standard deviations about their
/// means, every stride-th sample.
struct MachineRecord {
  std::vector<double> input, output;
  std::vector<std::size_t> valid;  ///< samples that take part, ascending
  std::vector<Channel> side;       ///< on the same samples, own units
  double start_s = 0;              ///< of the first sample, from the start of its recording
  std::size_t recording = 0;       ///< index of the recording it comes from
};

/// What is fitted and what is judged. Judged samples come in groups, each a block of one record.
struct MachineFold {
  std::vector<std::vector<std::size_t>> fit;  ///< per record
  struct Group {
    std::size_t record = 0;
    std::vector<std::size_t> rows;
  };
  std::vector<Group> judged;
  bool whole_records = false;  ///< the judged records take no part in the fit: their start is fitted on themselves
};

/// Recordings brought to the size and scale of a search.
struct MachineData {
  std::vector<MachineRecord> records;
  double period_s = 0;  ///< of a record: stride samples of the recordings
  std::size_t stride = 1;
  bool interval_means = false;  ///< inputs are means over the intervals between samples
  bool windows = false;         ///< records are windows of longer recordings
  double input_mean = 0, input_scale = 1, output_mean = 0, output_scale = 1;
  std::vector<MachineFold> folds;
  std::string heldout;  ///< what is held out, for a reader

  std::size_t samples() const;
  std::vector<std::vector<std::size_t>> all_rows() const;
};

/// Thins a slow recording by whole strides as long as straight lines between the kept samples stay within
/// `allowed_rms` of the output (in its own unit) and close to the input; what is still too long is cut into windows
/// spread over the record, moved off where the input rests. Folds: recordings where there are three or more, windows
/// likewise, else blocks, never a record's first.
///
/// recordings  of one sample time and at least one sample each
/// between     counts where the input holds and moves
MachineData machine_data(std::span<const Recording> recordings, double allowed_rms, std::size_t most_samples,
                         InputBetween between = InputBetween::kStraight);

/// Kept samples [begin, end) of one recording.
struct MachineStretch {
  std::size_t recording = 0, begin = 0, end = 0;
};

/// These stretches at the stride and scale of a search, in its folds.
MachineData at_stretches(std::span<const Recording> recordings, const MachineData& searched,
                         std::span<const MachineStretch> stretches);

/// Every recording from its first sample to its last, at the stride and scale of a search: a fit of that search runs on
/// them as it stands, but for its starts. Without folds.
MachineData whole_records(std::span<const Recording> recordings, const MachineData& searched);

/// The same samples as a Recording in the scaled units, for identifiers that read one.
Recording as_recording(const MachineRecord& record, double period_s);

}  // namespace valvetriage
