#pragma once

#include <optional>
#include <span>

#include "core/analysis/analysis.h"
#include "core/classify/rule_base.h"
#include "core/stage.h"

namespace valvetriage {

/// What an analysis is made with, besides the recordings.
struct AnalysisOptions {
  std::optional<Reference> reference;    ///< the population of good valves of this type
  std::optional<RuleBase> rule_base;     ///< what turns figures into a verdict
  std::optional<BaselineKind> baseline;  ///< empty: the reference where there is one and the units fit, else `self`
  StageReport report{};                  ///< told each stage as it begins; nobody where empty
};

/// Analyses one valve's recordings together: baseline, free-run simulation, residual figures by level, what the
/// simulation gets wrong with its causes and the model they extend, verdict.
///
/// Reference baseline: the valve's own parameters are re-estimated with the population as prior and give `simulation`;
/// Eq 20 and through it the verdict use the population mean. Every reason for a null verdict is in `classification`.
///
/// recordings  of one valve, prepared; their order does not matter to the result but is kept in it
/// Errors      no recordings; a baseline that these recordings cannot have (`reference` without one, or without units);
///             numerics that give no model at all, with the identifier's reason
/// Cost        O(n) per free run, of which a search for causes takes hundreds to thousands; a pure function,
/// thread-safe
Result<Analysis> analyze(std::span<const Recording> recordings, const AnalysisOptions& options);

}  // namespace valvetriage
