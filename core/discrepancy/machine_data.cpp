#include "core/discrepancy/machine_data.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/recording/intersample.h"

namespace valvetriage {
namespace {

constexpr std::size_t kLargestStride = 64;
constexpr std::size_t kBlocks = 6;
constexpr std::size_t kWindows = 4;
constexpr std::size_t kMostFolds = 6;
constexpr std::size_t kGroups = 12;           // judged blocks over all folds, for the sign test
constexpr double kInputInterpolation = 0.01;  // of the input's standard deviation

/// Mean and deviation of values far from zero, too: updated about the mean so far (Welford 1962).
struct Moments {
  double mean = 0, squares = 0;
  std::size_t count = 0;
  void add(double x) {
    ++count;
    const double from_before = x - mean;
    mean += from_before / static_cast<double>(count);
    squares += from_before * (x - mean);
  }
  double deviation() const { return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0; }
};

/// The recordings with each input sample replaced by the mean over the interval that follows it.
std::vector<Recording> with_interval_means(std::span<const Recording> recordings) {
  std::vector<Recording> changed(recordings.begin(), recordings.end());
  for (Recording& recording : changed) {
    const IntervalSignal between = input_between_samples(recording);
    for (std::size_t i = 0; i < between.start.size(); ++i) {
      recording.input.values[i] = 0.5 * (between.start[i] + between.end[i]);
    }
  }
  return changed;
}

/// Rms distance of the values from straight lines between every stride-th of them.
double interpolation_rms(std::span<const double> values, std::size_t stride) {
  double squares = 0;
  std::size_t count = 0;
  for (std::size_t left = 0; left + stride < values.size(); left += stride) {
    for (std::size_t i = 1; i < stride; ++i) {
      const double share = static_cast<double>(i) / static_cast<double>(stride);
      const double straight = values[left] + share * (values[left + stride] - values[left]);
      squares += std::pow(values[left + i] - straight, 2);
      ++count;
    }
  }
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : 0;
}

bool may_stride(std::span<const Recording> recordings, std::size_t stride, double allowed_output,
                double allowed_input) {
  return std::all_of(recordings.begin(), recordings.end(), [&](const Recording& r) {
    return interpolation_rms(r.output.values, stride) <= allowed_output &&
           interpolation_rms(r.input.values, stride) <= allowed_input;
  });
}

/// One record out of [begin, end) of a recording.
MachineRecord cut(const Recording& from, std::size_t index, std::size_t begin, std::size_t end,
                  const MachineData& data) {
  MachineRecord record;
  record.recording = index;
  record.start_s = static_cast<double>(begin) * from.sample_period_s;
  record.side = from.side;
  for (Channel& channel : record.side) channel.values.clear();
  for (std::size_t i = begin; i < end; i += data.stride) {
    if (from.is_valid(i)) record.valid.push_back(record.input.size());
    record.input.push_back((from.input.values[i] - data.input_mean) / data.input_scale);
    record.output.push_back((from.output.values[i] - data.output_mean) / data.output_scale);
    for (std::size_t c = 0; c < record.side.size(); ++c) {
      if (i < from.side[c].values.size()) record.side[c].values.push_back(from.side[c].values[i]);
    }
  }
  return record;
}

/// Whether the input rests for a quarter of [begin, end) or more: a machine at rest tells nothing about its laws.
bool rests(const Recording& from, std::size_t begin, std::size_t end, double input_scale) {
  constexpr double kStill = 0.005;  // of the input's deviation: noise of a measured input
  constexpr std::size_t kQuarter = 4;
  std::size_t since = begin, longest = 0;
  for (std::size_t i = begin; i < end; ++i) {
    if (std::abs(from.input.values[i] - from.input.values[since]) > kStill * input_scale) since = i;
    longest = std::max(longest, i - since);
  }
  return longest >= (end - begin) / kQuarter;
}

/// Windows spread evenly from the first sample to the last; one in which the input rests begins later, or else sooner,
/// as far as its neighbours leave room.
void take_windows(const Recording& from, std::size_t index, std::size_t most_samples, MachineData& data) {
  constexpr std::size_t kShifts = 8;  // per window length
  const std::size_t length = most_samples / kWindows * data.stride;
  const auto place = [&](std::size_t w) {
    return (from.samples() - length) * w / (kWindows - 1) / data.stride * data.stride;
  };
  const std::size_t shift = std::max<std::size_t>(length / kShifts / data.stride, 1) * data.stride;
  std::size_t free_from = 0;
  for (std::size_t w = 0; w < kWindows; ++w) {
    const std::size_t planned = std::max(place(w), free_from);
    const std::size_t free_to = w + 1 < kWindows ? place(w + 1) : from.samples();
    const auto idle = [&](std::size_t begin) { return rests(from, begin, begin + length, data.input_scale); };
    std::size_t begin = planned;
    while (idle(begin) && begin + shift + length <= free_to) begin += shift;
    while (idle(begin) && begin >= free_from + shift) begin -= shift;
    if (idle(begin)) begin = planned;
    data.records.push_back(cut(from, index, begin, std::min(begin + length, from.samples()), data));
    free_from = begin + length;
  }
}

void take_records(std::span<const Recording> recordings, std::size_t most_samples, MachineData& data) {
  std::size_t total = 0;
  for (const Recording& recording : recordings) total += recording.samples() / data.stride + 1;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const std::size_t samples = recordings[r].samples();
    // The last, partial stride of each recording does not count.
    if (total - recordings.size() <= most_samples) {
      data.records.push_back(cut(recordings[r], r, 0, samples, data));
    } else if (recordings.size() == 1) {
      data.windows = true;
      take_windows(recordings[r], r, most_samples, data);
    } else {
      // Each recording gives its beginning, as long as its share: its start is then its own.
      data.windows = true;
      const double share = static_cast<double>(most_samples) / static_cast<double>(total);
      const auto kept = static_cast<std::size_t>(static_cast<double>(samples) * std::min(1.0, share));
      data.records.push_back(
          cut(recordings[r], r, 0, std::max<std::size_t>(kept, std::min<std::size_t>(samples, 200)), data));
    }
  }
}

/// The same recordings at other stretches, without folds.
MachineData cut_again(std::span<const Recording> given, const MachineData& searched,
                      std::span<const MachineStretch> stretches) {
  MachineData data = searched;
  const std::vector<Recording> changed = data.interval_means ? with_interval_means(given) : std::vector<Recording>();
  const std::span<const Recording> recordings = data.interval_means ? std::span<const Recording>(changed) : given;
  data.records.clear();
  data.folds.clear();
  for (const MachineStretch& stretch : stretches) {
    const Recording& from = recordings[stretch.recording];
    data.records.push_back(cut(from, stretch.recording, stretch.begin * data.stride,
                               std::min(stretch.end * data.stride, from.samples()), data));
  }
  return data;
}

std::vector<MachineFold::Group> groups_of(std::size_t record, std::span<const std::size_t> rows, std::size_t groups) {
  std::vector<MachineFold::Group> cut;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t begin = rows.size() * g / groups, end = rows.size() * (g + 1) / groups;
    if (begin == end) continue;
    const auto part = rows.subspan(begin, end - begin);
    cut.push_back({record, std::vector<std::size_t>(part.begin(), part.end())});
  }
  return cut;
}

/// Recordings are held out where there are three or more of them, with all of their windows; else each record.
void fold_by_record(MachineData& data, std::size_t recordings) {
  const bool by_recording = recordings >= 3;
  const std::size_t folds = std::min(kMostFolds, by_recording ? recordings : data.records.size());
  const std::size_t groups = std::max<std::size_t>(1, kGroups / data.records.size());
  data.folds.assign(folds, {});
  for (std::size_t f = 0; f < folds; ++f) {
    MachineFold& fold = data.folds[f];
    fold.whole_records = true;
    fold.fit = data.all_rows();
    for (std::size_t r = 0; r < data.records.size(); ++r) {
      if ((by_recording ? data.records[r].recording : r) % folds != f) continue;
      const auto judged = groups_of(r, data.records[r].valid, groups);
      fold.judged.insert(fold.judged.end(), judged.begin(), judged.end());
      fold.fit[r].clear();
    }
  }
}

void fold_by_block(MachineData& data) {
  const std::size_t blocks = data.records.size() == 1 ? kBlocks : kBlocks / 2;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const auto& rows = data.records[r].valid;
    for (std::size_t b = 1; b < blocks; ++b) {
      const auto begin = static_cast<std::ptrdiff_t>(rows.size() * b / blocks);
      const auto end = static_cast<std::ptrdiff_t>(rows.size() * (b + 1) / blocks);
      MachineFold fold;
      fold.fit = data.all_rows();
      fold.fit[r].erase(fold.fit[r].begin() + begin, fold.fit[r].begin() + end);
      fold.judged = groups_of(
          r, std::span(rows).subspan(static_cast<std::size_t>(begin), static_cast<std::size_t>(end - begin)), 2);
      data.folds.push_back(std::move(fold));
    }
  }
}

void fold(MachineData& data, std::size_t recordings) {
  if (data.records.size() >= 3) {
    fold_by_record(data, recordings);
    data.heldout = recordings >= 3   ? "one of the recordings at a time"
                   : recordings == 2 ? "one window of the recordings at a time"
                                     : "one window of the recording at a time";
    return;
  }
  fold_by_block(data);
  const auto n = static_cast<double>(data.records.front().input.size());
  const double blocks = data.records.size() == 1 ? kBlocks : kBlocks / 2;
  data.heldout = fmt::format("blocks of {:.3g} s in turn, never the first", n * data.period_s / blocks);
}

}  // namespace

std::size_t MachineData::samples() const {
  std::size_t sum = 0;
  for (const MachineRecord& record : records) sum += record.input.size();
  return sum;
}

std::vector<std::vector<std::size_t>> MachineData::all_rows() const {
  std::vector<std::vector<std::size_t>> rows;
  for (const MachineRecord& record : records) rows.push_back(record.valid);
  return rows;
}

MachineData machine_data(std::span<const Recording> given, double allowed_rms, std::size_t most_samples,
                         InputBetween between) {
  MachineData data;
  data.interval_means = between == InputBetween::kStraight && holds_and_moves(given);
  const std::vector<Recording> changed = data.interval_means ? with_interval_means(given) : std::vector<Recording>();
  const std::span<const Recording> recordings = data.interval_means ? std::span<const Recording>(changed) : given;
  Moments input, output;
  std::size_t total = 0;
  for (const Recording& recording : recordings) {
    total += recording.samples();
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (!recording.is_valid(i)) continue;
      input.add(recording.input.values[i]);
      output.add(recording.output.values[i]);
    }
  }
  data.input_mean = input.mean;
  data.output_mean = output.mean;
  data.input_scale = input.deviation() > 0 ? input.deviation() : 1;
  data.output_scale = output.deviation() > 0 ? output.deviation() : 1;
  while (total / data.stride > most_samples && data.stride < kLargestStride &&
         may_stride(recordings, data.stride + 1, allowed_rms, kInputInterpolation * data.input_scale)) {
    ++data.stride;
  }
  data.period_s = recordings.front().sample_period_s * static_cast<double>(data.stride);
  take_records(recordings, most_samples, data);
  fold(data, recordings.size());
  return data;
}

MachineData at_stretches(std::span<const Recording> recordings, const MachineData& searched,
                         std::span<const MachineStretch> stretches) {
  MachineData data = cut_again(recordings, searched, stretches);
  fold(data, recordings.size());
  return data;
}

MachineData whole_records(std::span<const Recording> recordings, const MachineData& searched) {
  std::vector<MachineStretch> whole;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    whole.push_back({r, 0, (recordings[r].samples() + searched.stride - 1) / searched.stride});
  }
  MachineData data = cut_again(recordings, searched, whole);
  data.windows = false;
  return data;
}

Recording as_recording(const MachineRecord& record, double period_s) {
  Recording recording;
  recording.sample_period_s = period_s;
  recording.input.values = record.input;
  recording.output.values = record.output;
  if (record.valid.size() < record.input.size()) {
    recording.valid.assign(record.input.size(), 0);
    for (const std::size_t row : record.valid) recording.valid[row] = 1;
  }
  recording.time_s.resize(record.input.size());
  for (std::size_t i = 0; i < recording.time_s.size(); ++i) recording.time_s[i] = static_cast<double>(i) * period_s;
  return recording;
}

}  // namespace valvetriage
