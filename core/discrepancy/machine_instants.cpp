#include <algorithm>
#include <cmath>

#include "core/discrepancy/gain_split.h"
#include "core/discrepancy/machine_search.h"

namespace valvetriage {
namespace {

constexpr std::size_t kMostInstants = 3;
constexpr double kApart = 0.03;  // of the record: nearer instants end at the same
constexpr int kMostRepeats = 4;
enum Parameter { kGainChange, kInstant, kZero };

/// An instant of a recording, with what a change of gain there takes.
struct Instant {
  GainStep step;
  double taken = 0;
};

void add_instants(const MachineData& data, const MachineRecord& record, std::vector<double> run, double zero,
                  std::vector<Instant>& instants) {
  std::vector<double> measured = record.output;
  for (double& value : run) value -= zero;
  for (double& value : measured) value -= zero;
  std::vector<bool> takes_part(run.size());
  for (const std::size_t t : record.valid) takes_part[t] = true;
  for (const GainSplit& split : split_gains(run, measured, [&](std::size_t t) { return takes_part[t]; })) {
    // Half a sample early: the sample itself is behind it.
    const double time_s = record.start_s + (static_cast<double>(split.sample) - 0.5) * data.period_s;
    instants.push_back({{time_s, split.change}, split.taken});
  }
}

}  // namespace

std::vector<GainStep> gain_steps(const MachineData& data, const MachineFit& fit, double zero) {
  std::vector<Instant> instants;
  double longest_s = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    add_instants(data, record, run_record(data, r, fit), zero, instants);
    longest_s = std::max(longest_s, static_cast<double>(record.output.size()) * data.period_s);
  }
  std::stable_sort(instants.begin(), instants.end(), [](const auto& a, const auto& b) { return a.taken > b.taken; });
  std::vector<GainStep> steps;
  for (const Instant& instant : instants) {
    if (steps.size() == kMostInstants) break;
    const bool is_known = std::any_of(steps.begin(), steps.end(), [&](const GainStep& step) {
      return std::abs(step.time_s - instant.step.time_s) < kApart * longest_s;
    });
    if (!is_known) steps.push_back(instant.step);
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
