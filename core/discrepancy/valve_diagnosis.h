#pragma once

#include <span>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/identify/valve_fit.h"
#include "core/model/reference.h"
#include "core/stage.h"

namespace valvetriage {

/// What a diagnosis compares with.
struct ValveDiagnosisOptions {
  ValveFitOptions fit;  ///< with the population as prior
  int good_valves = 0;
  std::span<const CauseOnGoodValves> causes;
  std::span<const LeftoverOnGoodValves> leftovers;
  StageReport report{};  ///< told each stage as it begins; nobody where empty
};

/// A free run per recording.
using FreeRunsOf = std::vector<std::vector<double>>;

struct ValveDiagnosis {
  Discrepancy discrepancy;
  Model baseline_model;                   ///< of the fit without causes: the given one, or a better one that was met
  FreeRunsOf baseline;                    ///< its free runs
  Model extended_model;                   ///< the baseline's where nothing was added
  FreeRunsOf extended;                    ///< its free runs
  std::vector<FreeRunsOf> without_cause;  ///< by cause: the same without it, nothing else moved
};

/// Show, name, extend, measure for one valve against the population of good ones.
///
/// Every law of core/mechanisms is fitted to what the baseline leaves and cannot absorb (search_law); what stands out
/// from what good valves seem to have is fitted together with the valve; the fits are compared as likelihoods, tempered
/// by the colour of what the best of them leaves; a second cause is looked for beside the first; held-out recordings
/// measure the gain; a leftover unlike any good valve's is `unexplained`.
///
/// baseline  fit of the same recordings with the same options
/// Cost      one linearisation and a few hundred simulations to survey, a handful of joint fits; deterministic
ValveDiagnosis diagnose_valve(std::span<const Recording> recordings, const ValveFit& baseline,
                              const ValveDiagnosisOptions& options);

/// What a diagnosis sees of each cause in a good valve, for learning a population: evidence and size by cause, and the
/// leftover by groups of samples.
struct GoodValveSurvey {
  struct Seen {
    std::string cause;
    double evidence = 0, size = 0;
  };
  std::vector<Seen> causes;
  std::vector<std::pair<std::string, double>> leftovers;
};
GoodValveSurvey survey_good_valve(std::span<const Recording> recordings, const ValveFit& fit,
                                  const ValveFitOptions& options);

}  // namespace valvetriage
