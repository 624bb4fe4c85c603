#include <benchmark/benchmark.h>

#include <chrono>
#include <random>

#include "core/classify/learn.h"
#include "core/classify/paper_table.h"
#include "core/classify/rivals/possibilistic_c_means.h"

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

/// Residual directions of a lot's unexplained valves, eight tests of 64 runs: a tenth of them in five groups, the
/// others smooth curves of their own. The floor: the distances of every row to one place, once per start.
void group_unexplained_valves(benchmark::State& state) {
  const Eigen::Index n = state.range(0), p = 512;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd groups = Eigen::MatrixXd::NullaryExpr(5, p, [&] { return normal(random); });
  Eigen::MatrixXd x(n, p);
  for (Eigen::Index i = 0; i < n; ++i) {
    double slow = 0;
    for (Eigen::Index j = 0; j < p; ++j) x(i, j) = slow = 0.9 * slow + normal(random);
    if (i % 10 == 0) x.row(i) = groups.row(i / 10 % 5) + 0.15 * x.row(i);
    x.row(i).normalize();
  }
  std::size_t found = 0;
  for (auto _ : state) {
    found = possibilistic_groups(x, 0.5, {.fuzzifier = 1.5}).size();
    benchmark::DoNotOptimize(found);
  }
  const auto begin = std::chrono::steady_clock::now();
  for (int start = 0; start < PossibilisticOptions{}.most_starts; ++start) {
    benchmark::DoNotOptimize((x * x.row(start).transpose()).eval());
  }
  const std::chrono::duration<double, std::milli> floor = std::chrono::steady_clock::now() - begin;
  state.counters["groups"] = static_cast<double>(found);
  state.counters["floor_ms"] = floor.count();
}
BENCHMARK(group_unexplained_valves)->Arg(300)->Arg(3000)->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
