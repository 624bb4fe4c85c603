#pragma once

#include <string>

#include <CLI/CLI.hpp>

#include "core/analysis/analyze.h"
#include "core/result.h"

namespace valvetriage {

/// What a verb that analyses in process is told to compare with.
struct AnalysisArguments {
  std::string reference, baseline, rule_base;
};

/// Adds --reference, --baseline and --rule-base. `arguments` must live as long as the verb.
void add_analysis_options(CLI::App& verb, AnalysisArguments& arguments);

/// Errors  those of the documents that are opened
Result<AnalysisOptions> analysis_options(const AnalysisArguments& arguments);

}  // namespace valvetriage
