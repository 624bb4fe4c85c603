#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/residual/findings.h"

namespace valvetriage {

/// What a simulation gets wrong, why, and what knowing it gains: schemas/analysis.schema.json, field for field. Figures
/// that do not exist are NaN and become null.

/// Where a finding stands that speaks of how the recordings were made or read, not of the valve: see recording_slip.h.
inline constexpr std::string_view kStaticMap = "static map";
/// Where a finding speaks of what the fit of a valve took up, and not of what it left.
inline constexpr std::string_view kOwnParameters = "the valve's own parameters";
/// Where a finding is all that is left beside good valves, and no cause stands for it: see unnamed_direction.h.
inline constexpr std::string_view kUnnamedChange = "what no cause stands for";

/// Standard errors to either side of a 95 % interval.
inline constexpr double kTwoSided95 = 1.96;

enum class Conclusion { kNone, kNamed, kAmbiguous, kUnexplained };

struct ParameterEstimate {
  double value = 0;
  std::string text;      ///< instead of a value: the channel of `side_input`
  double std_error = 0;  ///< of fit and law: half the interval over kTwoSided95, before that ends where the law does
  std::array<double, 2> ci95{};
  std::string unit;
  double population_mean = 0;
  double population_sd = 0;
};

/// A cause that is in the extended model.
struct NamedCause {
  std::string cause, family, origin;
  double probability = 0, family_probability = 0;
  std::vector<std::string> alternatives;
  std::vector<std::pair<std::string, ParameterEstimate>> parameters;
  double severity_in_population_sd = 0;
  std::map<std::string, double> error_eq20_caused;  ///< level → psi/s
  double rmse_before = 0, rmse_after = 0, p_value = 1;
  std::vector<std::string> evidence;
};

enum class CandidateStatus { kTested, kNotExcited, kNotIdentifiable };

/// One explanation that was considered: a cause, a pair "friction+leakage", "none" or "unknown".
struct Candidate {
  std::string cause;
  double probability = 0;
  double rmse_heldout = std::numeric_limits<double>::quiet_NaN();  ///< NaN where it was not measured
  CandidateStatus status = CandidateStatus::kTested;
  std::string reason;
  std::map<std::string, double> upper_limit95;  ///< parameter → largest value that the data do not exclude
};

/// Gain on another kind of test than the one fitted.
struct Transfer {
  std::string from, to;
  double rmse_baseline = 0, rmse_extended = 0;
};

struct DiscrepancyGain {
  std::string heldout;  ///< what was held out: "each recording in turn", "blocks of 5 s"
  double rmse_baseline = 0, rmse_extended = 0, rmse_black_box = 0, noise_floor = 0;
  double reduction = 0;
  std::array<double, 2> reduction_ci95{};
  std::vector<Transfer> transfer;
};

struct NextTest {
  std::string test, why;
  std::vector<std::string> separates;
  double expected_probability = 0;
  std::string input_csv;
};

struct Discrepancy {
  Conclusion conclusion = Conclusion::kNone;
  std::vector<Finding> findings;
  std::vector<NamedCause> causes;
  std::vector<Candidate> candidates;
  DiscrepancyGain gain;
  std::optional<NextTest> next_test;

  /// The finding that speaks of the recordings rather than of the valve; null where there is none.
  const Finding* slip() const { return first_of(kStaticMap); }
  /// The one that speaks of the valve's own parameters, which no good valve has; null where there is none.
  const Finding* taken_up() const { return first_of(kOwnParameters); }
  /// The one that describes all that is left and has no name; null where there is none.
  const Finding* unnamed_change() const { return first_of(kUnnamedChange); }

 private:
  const Finding* first_of(std::string_view where) const {
    const auto found =
        std::find_if(findings.begin(), findings.end(), [&](const Finding& finding) { return finding.where == where; });
    return found == findings.end() ? nullptr : &*found;
  }
};

}  // namespace valvetriage
