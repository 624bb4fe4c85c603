#include "server/commands/analysis_arguments.h"

#include "server/commands/documents.h"
#include "server/commands/rule_base.h"
#include "server/wire/analysis_json.h"

namespace valvetriage {

void add_analysis_options(CLI::App& verb, AnalysisArguments& arguments) {
  verb.add_option("--reference", arguments.reference, "Good valves of this type, from `reference learn`");
  verb.add_option("--baseline", arguments.baseline,
                  "Compare with the valve's own fit (self) or the paper's linear model (paper) instead")
      ->check(CLI::IsMember({"self", "paper"}));
  verb.add_option("--rule-base", arguments.rule_base,
                  "What turns errors into a verdict: a file from `rule-base learn`, or paper, or calibrated");
}

Result<AnalysisOptions> analysis_options(const AnalysisArguments& arguments) {
  AnalysisOptions options;
  options.baseline = baseline_kind_from(arguments.baseline);
  if (!arguments.reference.empty()) {
    auto reference = open_reference(arguments.reference);
    if (!reference) return tl::unexpected(reference.error());
    options.reference = std::move(*reference);
  }
  if (!arguments.rule_base.empty()) {
    auto rule_base = open_rule_base(arguments.rule_base);
    if (!rule_base) return tl::unexpected(rule_base.error());
    options.rule_base = std::move(*rule_base);
  }
  return options;
}

}  // namespace valvetriage
