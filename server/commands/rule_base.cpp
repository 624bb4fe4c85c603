#include "server/commands/rule_base.h"

#include <fmt/format.h>

#include <memory>
#include <optional>
#include <utility>

#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

struct RuleBaseArguments {
  std::string table;
  std::string output;
  std::string name = "learned";
  double rate_hz = 0;
  double duration_s = 0;
  std::string unit = "psi";
  std::string reference;
};

/// The window that the errors of a table stand for; none where nobody says.
Result<std::optional<FeatureWindow>> window_of(const RuleBaseArguments& arguments) {
  if (arguments.rate_hz > 0) return FeatureWindow{arguments.rate_hz, arguments.duration_s, arguments.unit};
  if (arguments.reference.empty()) return std::nullopt;
  return open_reference(arguments.reference).map([&](const Reference& reference) -> std::optional<FeatureWindow> {
    return FeatureWindow{reference.window.rate_hz, reference.window.duration_s, "psi"};
  });
}

Result<LearnedRuleBase> learn(const RuleBaseArguments& arguments) {
  LearnOptions options{.name = arguments.name};
  auto window = window_of(arguments);
  if (!window) return tl::unexpected(window.error());
  options.window = std::move(*window);
  return open_feature_table(arguments.table).and_then([&](const FeatureTable& table) {
    return labelled_valves(table)
        .and_then([&](const std::vector<LabelledValve>& valves) { return learn_rule_base(valves, options); })
        .map_error(in_file(arguments.table));
  });
}

ExitStatus run_learn_rule_base(const RuleBaseArguments& arguments) {
  const auto learned = learn(arguments);
  if (!learned) {
    print_error(learned.error());
    return kBadInput;
  }
  if (auto written = write_output(arguments.output, dump_json(to_json(learned->base), true) + "\n"); !written) {
    print_error(written.error());
    return kFailure;
  }
  for (const std::string& note : learned->notes) fmt::print(stderr, "{}\n", note);
  fmt::print(stderr, "{}: {} levels; {} of the labelled valves wrong on the data it was set on\n", arguments.output,
             learned->base.levels.size(), learned->wrong);
  return kDone;
}

}  // namespace

Result<RuleBase> open_rule_base(const std::string& name_or_file) {
  if (auto embedded = embedded_rule_base(name_or_file)) return embedded;
  return read_text_file(name_or_file, kMaxRuleBaseBytes).and_then(rule_base_from_json).map_error(in_file(name_or_file));
}

Result<FeatureTable> open_feature_table(const std::string& file) {
  return read_text_file(file, kMaxTableBytes).and_then(parse_feature_table).map_error(in_file(file));
}

void add_rule_base_command(CLI::App& app, int& exit_status) {
  CLI::App* group = app.add_subcommand("rule-base", "Rule bases: learn one from labelled valves");
  group->require_subcommand(1);
  CLI::App* verb = group->add_subcommand("learn", "A rule base from a table of valves with a verdict column");
  auto arguments = std::make_shared<RuleBaseArguments>();
  verb->add_option("TABLE.csv", arguments->table,
                   "A line per valve: error_low,error_high (or error_<level in A>; also settling_error_, rise_time_, "
                   "bandwidth_<level>),verdict; - is standard input")
      ->required();
  verb->add_option("-o,--output", arguments->output, "Where the rule base goes")->required();
  verb->add_option("--name", arguments->name, "Name of the rule base")->capture_default_str();
  CLI::Option* rate = verb->add_option("--rate-hz", arguments->rate_hz, "Sample rate the errors were computed at")
                          ->check(CLI::PositiveNumber);
  CLI::Option* duration = verb->add_option("--duration-s", arguments->duration_s,
                                           "Seconds from each step on that the errors were computed on")
                              ->check(CLI::PositiveNumber);
  CLI::Option* unit = verb->add_option("--unit", arguments->unit, "Unit of the output")->capture_default_str();
  verb->add_option("--reference", arguments->reference,
                   "Reference whose rate and duration the errors were computed at: what analyze takes with it")
      ->excludes(rate)
      ->excludes(duration);
  rate->needs(duration);
  duration->needs(rate);
  unit->needs(rate);
  verb->callback([arguments, &exit_status] { exit_status = run_learn_rule_base(*arguments); });
}

}  // namespace valvetriage
