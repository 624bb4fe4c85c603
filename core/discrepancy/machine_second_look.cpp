#include "core/discrepancy/machine_second_look.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

constexpr double kMissed = 2;         // times the mean square of what is searched
constexpr double kAboveFloors = 1.5;  // of what is left beside it, in the rms

using Squares = std::vector<std::vector<double>>;

/// Squares of what a fit leaves, per recording and kept sample; none where a sample is not valid.
Squares squares_left(const MachineData& whole, const MachineFit& fit) {
  Squares squares;
  for (std::size_t r = 0; r < whole.records.size(); ++r) {
    const auto run = run_record(whole, r, fit);
    squares.emplace_back(run.size());
    for (const std::size_t t : whole.records[r].valid) {
      const double left = whole.records[r].output[t] - run[t];
      squares.back()[t] = std::isfinite(left) ? left * left : 0;
    }
  }
  return squares;
}

std::vector<MachineStretch> stretches_of(const MachineData& searched) {
  std::vector<MachineStretch> stretches;
  for (const MachineRecord& record : searched.records) {
    const auto begin = static_cast<std::size_t>(std::lround(record.start_s / searched.period_s));
    stretches.push_back({record.recording, begin, begin + record.input.size()});
  }
  return stretches;
}

double sum_over(std::span<const double> squares, std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < std::min(end, squares.size()); ++i) sum += squares[i];
  return sum;
}

/// Whether so much more is left where the search did not look that something happens there.
bool is_missed(const Squares& squares, std::span<const MachineStretch> searched, double noise_rms) {
  double everywhere = 0, samples = 0, seen = 0, seen_samples = 0;
  for (const auto& recording : squares) {
    everywhere += sum_over(recording, 0, recording.size());
    samples += static_cast<double>(recording.size());
  }
  for (const MachineStretch& stretch : searched) {
    seen += sum_over(squares[stretch.recording], stretch.begin, stretch.end);
    seen_samples += static_cast<double>(stretch.end - stretch.begin);
  }
  if (!(samples > seen_samples)) return false;
  const double beside = (everywhere - seen) / (samples - seen_samples);
  return beside > std::pow(kAboveFloors * noise_rms, 2) && beside > kMissed * seen / seen_samples;
}

/// Adds the stretch of so many samples of a recording that has the largest squares beside those taken so far; false
/// where there is no room for one.
bool take_worst(const Squares& squares, std::size_t recording, std::size_t length, std::vector<MachineStretch>& taken) {
  const std::span<const double> of = squares[recording];
  std::vector<bool> is_taken(of.size());
  for (const MachineStretch& stretch : taken) {
    for (std::size_t i = stretch.begin; i < std::min(stretch.end, of.size()); ++i) is_taken[i] = true;
  }
  double sum = 0, most = -1;
  std::size_t free_since = 0, worst = 0;
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (is_taken[i]) {
      free_since = i + 1;
      sum = 0;
      continue;
    }
    sum += of[i];
    if (i + 1 < free_since + length) continue;
    const std::size_t begin = i + 1 - length;
    if (sum > most) {
      most = sum;
      worst = begin;
    }
    sum -= of[begin];
  }
  if (most < 0) return false;
  taken.push_back({recording, worst, worst + length});
  return true;
}

}  // namespace

std::optional<MachineData> second_look(std::span<const Recording> recordings, const MachineData& first,
                                       const MachineData& whole, const MachineFit& linear, double noise_rms) {
  const Squares squares = squares_left(whole, linear);
  const std::vector<MachineStretch> searched = stretches_of(first);
  if (!is_missed(squares, searched, noise_rms)) return std::nullopt;
  const bool several = recordings.size() > 1;
  std::vector<MachineStretch> stretches;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    // Of several windows every other one stays; of the only one of a recording its first half.
    std::vector<MachineStretch> taken;
    std::size_t windows = 0, length = 0;
    for (const MachineStretch& stretch : searched) {
      if (stretch.recording != r) continue;
      length = (stretch.end - stretch.begin) / (several ? 2 : 1);
      if (windows % 2 == 0) taken.push_back({r, stretch.begin, stretch.begin + length});
      ++windows;
    }
    const std::size_t wanted = several ? 2 : windows;
    while (taken.size() < wanted && take_worst(squares, r, length, taken)) {
    }
    std::sort(taken.begin(), taken.end(), [](const auto& a, const auto& b) { return a.begin < b.begin; });
    stretches.insert(stretches.end(), taken.begin(), taken.end());
  }
  return at_stretches(recordings, first, stretches);
}

}  // namespace valvetriage
