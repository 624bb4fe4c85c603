#include <algorithm>
#include <cmath>

#include "core/discrepancy/machine_search.h"

namespace valvetriage {
namespace {

constexpr std::size_t kMostInstants = 3;
constexpr double kApart = 0.03;  // of the longest record: nearer instants end at the same
constexpr int kMostRepeats = 4;
enum Parameter { kGainChange, kInstant, kZero };

/// Sums of a run's products with itself and with what was measured.
struct Products {
  double power = 0, shared = 0;

  void add(double simulated, double measured) {
    power += simulated * simulated;
    shared += simulated * measured;
  }
  /// How much of the measured squares the best gain takes.
  double taken() const { return power > 0 ? shared * shared / power : 0; }
};

struct Split {
  GainStep step;
  double taken = 0;
};

/// Every instant of a record with the best gains on either side of it.
void split_everywhere(const MachineData& data, const MachineRecord& record, const std::vector<double>& run, double zero,
                      std::vector<Split>& splits) {
  Products all, before;
  for (const std::size_t t : record.valid) all.add(run[t] - zero, record.output[t] - zero);
  for (const std::size_t t : record.valid) {
    const Products behind{all.power - before.power, all.shared - before.shared};
    if (before.shared > 0 && behind.shared > 0) {
      const double change = (behind.shared / behind.power) / (before.shared / before.power) - 1;
      // Half a sample early: the sample itself is behind it.
      const double time_s = record.start_s + (static_cast<double>(t) - 0.5) * data.period_s;
      splits.push_back({{time_s, change}, before.taken() + behind.taken() - all.taken()});
    }
    before.add(run[t] - zero, record.output[t] - zero);
  }
}

}  // namespace

std::vector<GainStep> gain_steps(const MachineData& data, const MachineFit& fit, double zero) {
  std::vector<Split> splits;
  double longest_s = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    split_everywhere(data, record, run_record(data, r, fit), zero, splits);
    longest_s = std::max(longest_s, static_cast<double>(record.output.size()) * data.period_s);
  }
  std::stable_sort(splits.begin(), splits.end(), [](const Split& a, const Split& b) { return a.taken > b.taken; });
  std::vector<GainStep> steps;
  for (const Split& split : splits) {
    if (steps.size() == kMostInstants) break;
    const bool is_known = std::any_of(steps.begin(), steps.end(), [&](const GainStep& step) {
      return std::abs(step.time_s - split.step.time_s) < kApart * longest_s;
    });
    if (!is_known) steps.push_back(split.step);
  }
  return steps;
}

void move_instant(const MachineData& data, int iterations, MachineFit& fit, MachineBudget& budget) {
  if (fit.machine.blocks.empty() || fit.machine.blocks.back().law != MachineLaw::kGainStep) return;
  const std::size_t last = fit.machine.blocks.size() - 1;
  for (int repeat = 0; repeat < kMostRepeats; ++repeat) {
    const std::vector<double>& at = fit.machine.blocks[last].parameters;
    MachineFit without = fit;
    without.machine.blocks.pop_back();
    std::erase_if(without.free, [&](const FreeParameter& p) { return p.block == last; });
    const std::vector<GainStep> steps = gain_steps(data, without, at[kZero]);
    if (steps.empty() || std::abs(steps.front().time_s - at[kInstant]) < data.period_s) return;
    MachineFit moved = fit;
    moved.machine.blocks[last].parameters[kInstant] = steps.front().time_s;
    moved.machine.blocks[last].parameters[kGainChange] = steps.front().change;
    refine_machine(data, data.all_rows(), iterations, moved, budget);
    if (moved.failed || moved.squares >= fit.squares) return;
    fit = std::move(moved);
  }
}

}  // namespace valvetriage
