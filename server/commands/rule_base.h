#pragma once

#include <string>

#include "core/classify/rule_base.h"
#include "server/wire/feature_table.h"

namespace valvetriage {

/// The rule base of an option `--rule-base R`: a file, or `paper`, or `calibrated`.
///
/// Errors  those of rule_base_from_json; `cannot_read`
Result<RuleBase> open_rule_base(const std::string& name_or_file);

/// The feature table of a file, or of standard input where the name is `-`.
///
/// Errors  those of parse_feature_table, with the file's name; `cannot_read`
Result<FeatureTable> open_feature_table(const std::string& file);

}  // namespace valvetriage
