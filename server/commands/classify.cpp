#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <string_view>

#include "core/classify/check.h"
#include "core/classify/compare.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/commands/rule_base.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

struct ClassifyArguments {
  std::string table;
  std::string rule_base = "calibrated";
  bool compare = false;
  bool json = false;
};

Result<std::vector<Classification>> classify_rows(const RuleBase& base, const FeatureTable& table) {
  std::vector<Classification> rows;
  rows.reserve(table.rows.size());
  for (const FeatureRow& row : table.rows) {
    auto classified = classify(base, row.levels);
    if (!classified) return tl::unexpected(classified.error());
    rows.push_back(std::move(*classified));
  }
  return rows;
}

Json comparison_json(const Comparison& comparison) {
  Json classifiers = Json::array();
  for (const ClassifierScore& score : comparison.scores) {
    classifiers.push_back({{"name", score.name},
                           {"predictions", score.predictions},
                           {"accuracy", score.accuracy()},
                           {"soft_errors", score.soft},
                           {"hard_errors", score.hard}});
  }
  return {{"features", comparison.features}, {"classifiers", classifiers}, {"notes", comparison.notes}};
}

void print_json(const RuleBase& base, const FeatureTable& table, const std::vector<Classification>& rows,
                const std::optional<Comparison>& comparison) {
  Json document{{"rule_base", rule_base_identity(base)}, {"rows", list_to_json(rows, to_json)}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!table.rows[i].serial.empty()) document["rows"][i]["serial"] = table.rows[i].serial;
  }
  if (comparison) document["comparison"] = comparison_json(*comparison);
  fmt::print("{}\n", dump_json(document, true));
}

void print_comparison(const Comparison& comparison) {
  fmt::print("\nheld-out valves of repeated stratified cross-validation, {} features\n", comparison.features);
  fmt::print("{:<24} {:>11} {:>9} {:>11} {:>11}\n", "classifier", "predictions", "accuracy", "soft errors",
             "hard errors");
  for (const ClassifierScore& score : comparison.scores) {
    fmt::print("{:<24} {:>11} {:>8.2f}% {:>11} {:>11}\n", score.name, score.predictions, 100 * score.accuracy(),
               score.soft, score.hard);
  }
  for (const std::string& note : comparison.notes) fmt::print("note: {}\n", note);
}

std::string memberships_text(const Memberships& memberships) {
  return fmt::format("{:6.3f} {:6.3f} {:6.3f}", memberships[0], memberships[1], memberships[2]);
}

/// As wide as the longest serial of the table, 0 where it names none.
std::size_t width_of_serials(const FeatureTable& table) {
  std::size_t width = 0;
  for (const FeatureRow& row : table.rows) width = std::max(width, row.serial.size());
  return width == 0 ? 0 : std::max(width, std::string_view("serial").size()) + 2;
}

void print_rows(const FeatureTable& table, const std::vector<Classification>& rows) {
  const std::size_t width = width_of_serials(table);
  fmt::print("{:>6}  {:<{}}{:<14} {:>6} {:>6} {:>6}  levels\n", "line", width > 0 ? "serial" : "", width, "verdict",
             "good", "malf", "severe");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Classification& row = rows[i];
    std::string levels;
    for (const auto& level : row.per_level) {
      levels += fmt::format("{}{} {}", levels.empty() ? "" : ", ", level.level, to_string(level.verdict));
      for (const Quantity missing : level.inputs_missing) levels += fmt::format(" (without {})", to_string(missing));
    }
    for (const auto& missing : row.missing_levels)
      levels += fmt::format("{}{} missing", levels.empty() ? "" : ", ", missing);
    fmt::print("{:>6}  {:<{}}{:<14} {}  {}\n", table.rows[i].line, table.rows[i].serial, width,
               row.verdict ? to_string(*row.verdict) : "none", memberships_text(row.memberships), levels);
  }
}

/// Against the labels of the table: right per valve and per level, and soft errors per level.
void print_agreement(const FeatureTable& table, const std::vector<Classification>& rows) {
  std::size_t right = 0, sets = 0, sets_right = 0, soft = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Verdict truth = *table.rows[i].verdict;
    right += rows[i].verdict == truth;
    for (const auto& level : rows[i].per_level) {
      ++sets;
      sets_right += level.verdict == truth;
      soft += is_soft_error(truth, level.verdict, level.memberships);
    }
  }
  fmt::print("\n{} of {} valves as labelled; {} of {} levels, {} soft errors among them\n", right, rows.size(),
             sets_right, sets, soft);
}

void print_report(const RuleBase& base, const FeatureTable& table, const std::vector<Classification>& rows) {
  print_rows(table, rows);
  if (table.has_verdicts) print_agreement(table, rows);
  fmt::print("\nrule base {} version {} ({})\n", base.name, base.version, base.sha256.substr(0, 12));
  for (const RuleBaseFinding& finding : check_rule_base(base)) fmt::print("note: {}\n", finding.text);
}

Result<void> classify_table(const ClassifyArguments& arguments) {
  const auto base = open_rule_base(arguments.rule_base);
  if (!base) return tl::unexpected(base.error());
  const auto table = open_feature_table(arguments.table);
  if (!table) return tl::unexpected(table.error());
  const auto rows = classify_rows(*base, *table);
  if (!rows) return tl::unexpected(rows.error());
  std::optional<Comparison> comparison;
  if (arguments.compare) {
    const auto compare = [](const std::vector<LabelledValve>& valves) { return compare_classifiers(valves); };
    auto compared = labelled_valves(*table).and_then(compare).map_error(in_file(arguments.table));
    if (!compared) return tl::unexpected(compared.error());
    comparison = std::move(*compared);
  }
  if (arguments.json) {
    print_json(*base, *table, *rows, comparison);
    return {};
  }
  print_report(*base, *table, *rows);
  if (comparison) print_comparison(*comparison);
  return {};
}

ExitStatus run(const ClassifyArguments& arguments) {
  const auto done = classify_table(arguments);
  if (done) return kDone;
  print_error(done.error());
  return kBadInput;
}

}  // namespace

void add_classify_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("classify", "Memberships and verdict of a table of valves");
  auto arguments = std::make_shared<ClassifyArguments>();
  verb->add_option("TABLE.csv", arguments->table,
                   "Rows with error_low,error_high or error_<level in A>; - is standard input")
      ->required();
  verb->add_option("--rule-base", arguments->rule_base, "A file, or paper, or calibrated")->capture_default_str();
  verb->add_flag("--compare", arguments->compare,
                 "Cross-validate against the classifiers the paper cites; needs a verdict column");
  verb->add_flag("--json", arguments->json, "Print JSON");
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
