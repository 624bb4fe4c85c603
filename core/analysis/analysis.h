#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/analysis/frequency_analysis.h"
#include "core/discrepancy/discrepancy.h"
#include "core/model/model.h"
#include "core/model/reference.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// The result of analysing one valve's recordings together: schemas/analysis.schema.json, field for field.
/// Names, hashes and times are set by the caller that knows them (`server/wire`); the core fills the rest.

struct RecordingSummary {
  std::string name;
  std::string sha256;
  std::size_t samples = 0;
  double sample_rate_hz = 0;
  TestKind test = TestKind::kOther;
  std::vector<QualityItem> quality;
};

enum class BaselineKind { kReference, kSelf, kPaper };

struct Baseline {
  BaselineKind kind = BaselineKind::kSelf;
  std::string reason;  ///< one sentence: why this baseline
  std::optional<Reference> reference;
  bool on_known_tests = false;  ///< of the reference, what it holds of valves that were put through the same tests
  Model model;  ///< what `simulation` is the free run of, beside what good valves leave where `on_known_tests`
};

/// Figures of the step response at one current level.
struct LevelFigures {
  double level_a = 0;
  std::optional<double> error_eq20;      ///< against the population mean (else the baseline); empty: window not covered
  std::optional<double> error_eq20_own;  ///< the other reading of Eq 20: against the valve's own fit
  std::optional<double> settling_error;  ///< |measured − simulated| at the end of the window [psi]
  std::optional<double> rise_time_s;     ///< 10 to 90 % of the measured rise
  std::optional<double> bandwidth_hz;    ///< of the smallest sweep whose input covers the level; empty without one
};

struct RecordingFigures {
  std::string name;
  double rmse = 0;         ///< free run, unit of the output
  double fit_percent = 0;  ///< 100 (1 − ‖y − y_sim‖ / ‖y − mean y‖)
  double noise_floor = 0;
};

struct Simulation {
  double rmse = 0;  ///< NaN where the baseline cannot be simulated (`reason` of the verdict: unstable)
  double fit_percent = 0;
  double noise_floor = 0;
  Eq20Window window;  ///< on which the figures by level were taken
  std::vector<LevelFigures> by_level;
  std::vector<RecordingFigures> per_recording;
  std::optional<double> cross_domain_rmse;  ///< of a sweep's transfer function on the steps; empty without both
};

/// Why there is no verdict. Names as in the contract.
enum class NoVerdict { kNoRuleBase, kUnits, kLevelMissing, kSelfBaseline, kUnstable, kFeedback };

/// Memberships and verdict of one current level, with the firing strength of every rule.
struct LevelVerdict {
  std::string level;    ///< the rule base's name of it, "low", "high" or "1.8"
  std::string verdict;  ///< Good, Malfunctioned, Severe
  std::map<std::string, double> memberships;
  std::vector<std::pair<std::string, double>> rules;  ///< rule in words, firing strength
};

struct ClassificationResult {
  std::optional<std::string> verdict;  ///< empty: `reason` says why
  std::optional<NoVerdict> reason;
  std::string explanation;  ///< a sentence for a person, with the level or unit that is meant
  std::string action;       ///< accept, reject, retest, engineer
  std::map<std::string, double> memberships;
  std::vector<LevelVerdict> per_level;
  std::string rule_base_name, rule_base_version, rule_base_sha256;  ///< empty where there is none
  std::optional<std::string> without_stand_causes;
};

struct Analysis {
  std::vector<RecordingSummary> recordings;
  Baseline baseline;
  Simulation simulation;
  std::optional<Discrepancy> discrepancy;           ///< empty: not looked for
  Model extended_model;                             ///< the baseline's model where nothing was added
  std::vector<FrequencyResult> frequency_response;  ///< by rising amplitude
  ClassificationResult classification;
  /// What `series` shows: free runs on each recording's grid, not part of the JSON document.
  std::vector<std::vector<double>> simulated;
  std::vector<std::vector<double>> extended;  ///< of `extended_model`; empty where nothing was added
};

}  // namespace valvetriage
