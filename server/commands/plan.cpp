#include <map>
#include <memory>

#include "core/identify/knot_curve.h"
#include "core/model/test_plan.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"

namespace valvetriage {
namespace {

const std::map<std::string, PlannedTest> kTests{{"step", PlannedTest::kStep},
                                                {"staircase", PlannedTest::kStaircase},
                                                {"triangle", PlannedTest::kTriangle},
                                                {"sweep", PlannedTest::kSweep},
                                                {"multisine", PlannedTest::kMultisine}};

struct PlanArguments {
  TestPlan plan;
  std::string test = "step";
  std::string reference;
  std::string output;
};

/// For steps and a staircase the levels of a map that has few, of another one eleven from end to end; for everything
/// that runs between levels its two ends.
std::vector<double> default_levels(PlannedTest test, const StaticMap& map) {
  constexpr std::size_t kFew = 12, kSpread = 11;
  const double low = map.output.front(), high = map.output.back();
  const bool holds = test == PlannedTest::kStep || test == PlannedTest::kStaircase;
  if (!holds) return {low, high};
  if (map.output.size() <= kFew) return map.output;
  std::vector<double> levels(kSpread, high);
  for (std::size_t i = 0; i + 1 < kSpread; ++i) {
    levels[i] = low + static_cast<double>(i) * (high - low) / static_cast<double>(kSpread - 1);
  }
  return levels;
}

Result<StaticMap> steady_map(const std::string& reference_file) {
  if (reference_file.empty()) return paper_steady_map();
  auto reference = open_reference(reference_file);
  if (!reference) return tl::unexpected(reference.error());
  if (!reference->model.map) return fail("not_a_reference", "the reference's model has no steady map");
  return KnotCurve(reference->model.map->input).rising_through(reference->model.map->output);
}

ExitStatus run(const PlanArguments& arguments) {
  const auto map = steady_map(arguments.reference);
  if (!map) return ended_by(map.error());
  TestPlan plan = arguments.plan;
  plan.test = kTests.at(arguments.test);
  if (plan.levels_psi.empty()) plan.levels_psi = default_levels(plan.test, *map);
  const auto current = plan_current(plan, *map);
  if (!current) return ended_by(current.error());
  const auto written = write_output(arguments.output, plan_csv(*current, plan.sample_rate_hz));
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_plan_command(CLI::App& app, int& exit_status) {
  CLI::App* verb =
      app.add_subcommand("plan", "The current to play on the stand, from pressures through the steady map");
  auto arguments = std::make_shared<PlanArguments>();
  TestPlan& plan = arguments->plan;
  verb->add_option("--levels-psi", plan.levels_psi,
                   "Steady pressures, comma separated; over all of the map when not said")
      ->delimiter(',');
  verb->add_option("--test", arguments->test, "step, staircase, triangle, sweep or multisine")
      ->check(CLI::IsMember(kTests))
      ->capture_default_str();
  verb->add_option("--reference", arguments->reference,
                   "Reference whose steady map is used; the paper's when not said");
  verb->add_option("--rate-hz", plan.sample_rate_hz, "Sampling rate of the current")->capture_default_str();
  verb->add_option("--hold-s", plan.hold_s, "Time at each level of steps and a staircase")->capture_default_str();
  verb->add_option("--duration-s", plan.duration_s, "Duration of a triangle, sweep or multisine")
      ->capture_default_str();
  verb->add_option("--from-hz", plan.from_hz, "Lowest frequency of a sweep or multisine")->capture_default_str();
  verb->add_option("--to-hz", plan.to_hz, "Highest frequency of a sweep or multisine")->capture_default_str();
  verb->add_option("--seed", plan.seed, "Phases of a multisine")->capture_default_str();
  verb->add_option("-o,--output", arguments->output, "CSV to write; standard output when not said");
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
