#pragma once

#include <string>
#include <vector>

#include "core/analysis/analysis.h"

namespace valvetriage::report {

/// An analysis in sentences that a person can act on; the page, the report and the route `summary` show the same ones.
/// Texts of a user (names of channels) stand in them as they are: who shows them escapes them.
struct Summary {
  std::string verdict;              ///< verdict or why there is none, and what to do with the valve
  std::string discrepancy;          ///< what the simulation gets wrong, or that it is not known
  std::vector<std::string> causes;  ///< one sentence for each cause in the extended model
  std::string fault;  ///< whose fault it is, or would be, and why a verdict Good stands beside it; may be empty
  std::string gain;   ///< what the causes gain on data they were not fitted to; empty without causes
  std::vector<std::string> upper_limits;  ///< what the recordings exclude
  std::string next_test;  ///< what would settle what is open, or that no test would; empty where nothing is open
};

Summary summarise(const Analysis& analysis);

/// "Periodic disturbance" of `periodic_disturbance`, "Friction + leakage" of `friction+leakage`.
std::string spoken(const std::string& cause);

/// Three significant digits with the unit: "18.3 mA", "0.402 psi", "12 %". Amperes below 0.1 are shown in mA, seconds
/// below 0.1 in ms. "unknown" where the value is not finite.
std::string quantity(double value, const std::string& unit);

/// An estimate as far as two digits of its standard error tell, all in the unit that `quantity` has for the value:
/// "1.63471 A", "0.00053 A", "1.63366 to 1.63576 A". Three significant digits where it has no error.
struct EstimateWords {
  std::string value, error;
  std::string interval;  ///< empty where it has no ends
};
EstimateWords estimate_words(const ParameterEstimate& estimate);

/// A mean with its standard deviation, as far as two digits of this tell: "0.00 ± 0.24 mA".
std::string with_deviation(double mean, double sd, const std::string& unit);

/// The value of a cause's parameter where it is no number to a person: a recording by its name, a place by its words.
/// Empty where the value is a number.
std::string value_words(const std::string& parameter, const ParameterEstimate& estimate,
                        const std::vector<RecordingSummary>& recordings);

/// A number of a table, as the page writes it: three significant digits with their zeros, so that a column lines up,
/// and no power of ten between 0.0001 and a million. "–" where it is not finite.
std::string figure(double value);

/// A probability as a person says it: "98 %", "over 99 %", "under 1 %".
std::string percent(double probability);

/// "1 valve", "2 valves".
std::string counted(std::size_t count, const char* singular);

}  // namespace valvetriage::report
