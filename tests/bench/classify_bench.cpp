#include <benchmark/benchmark.h>

#include "core/classify/learn.h"
#include "core/classify/paper_table.h"

namespace {

using namespace valvetriage;

std::vector<LabelledValve> table_one() {
  std::vector<LabelledValve> valves;
  for (const PaperTableRow& row : kPaperTable) {
    valves.push_back({row.verdict(),
                      {{.level_a = 1.4, .error_eq20 = row.error_low}, {.level_a = 1.6, .error_eq20 = row.error_high}}});
  }
  return valves;
}

/// The floor: the memberships alone, without rules, names or a centroid.
void memberships_only(benchmark::State& state) {
  const auto valves = table_one();
  const RuleBase base = learn_rule_base(valves, {})->base;
  for (auto _ : state) {
    for (const LabelledValve& valve : valves) {
      for (std::size_t l = 0; l < base.levels.size(); ++l) {
        for (const InputSet& set : base.levels[l].inputs[0].sets) {
          benchmark::DoNotOptimize(membership(set.shape, valve.levels[l].error_eq20));
        }
      }
    }
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(valves.size()));
}
BENCHMARK(memberships_only);

void classify_valves(benchmark::State& state) {
  const auto valves = table_one();
  const RuleBase base = learn_rule_base(valves, {})->base;
  for (auto _ : state) {
    for (const LabelledValve& valve : valves) benchmark::DoNotOptimize(classify(base, valve.levels));
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(valves.size()));
}
BENCHMARK(classify_valves);

void learn_from_forty_valves(benchmark::State& state) {
  const auto valves = table_one();
  for (auto _ : state) benchmark::DoNotOptimize(learn_rule_base(valves, {}));
}
BENCHMARK(learn_from_forty_valves);

}  // namespace

BENCHMARK_MAIN();
