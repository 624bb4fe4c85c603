#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/machine_search.h"
#include "core/model/model.h"

namespace valvetriage {

/// Parameters of one cause of a fitted machine, in the recordings' units and the contract's names.
std::vector<std::pair<std::string, ParameterEstimate>> cause_parameters(const std::string& cause,
                                                                        const MachineData& data, const MachineFit& fit,
                                                                        const Eigen::MatrixXd& covariance,
                                                                        const std::string& input_unit,
                                                                        const std::string& output_unit);

/// Sizes of a single cause that the data exclude, with 95 % one-sided, by the fit of its law: the contract's parameters
/// that say how much of it there is. Empty where that fit has ended farther from the data than the linear machine, and
/// for a cause that has no size.
std::map<std::string, double> excluded_sizes(const MachineScore& score, const MachineScore& linear,
                                             const MachineData& data, const std::string& input_unit,
                                             const std::string& output_unit);

/// Whether the interval of each cause's own size leaves out that it has none: a width of 0, a ratio of 1, no curvature.
/// True for causes whose parameters tell no size.
bool have_certain_sizes(const std::vector<std::string>& causes, const MachineData& data, const MachineFit& fit);

/// False for a law that stands in the chain but does nothing: width, curvature or amplitude next to zero, a level that
/// is never reached.
bool has_effect(const MachineScore& score, const MachineData& data, const MachineGround& ground);

/// The fitted chain between the recordings' own units.
Machine in_own_units(const MachineData& data, const MachineFit& fit);

/// What the linear machine's residual depends on, strongest first.
std::vector<Finding> residual_findings(const MachineData& data, const MachineScore& linear);

/// An input that would tell the alternatives apart, its points joined by straight lines. The chance that it does is
/// left to whoever can simulate the alternatives.
struct MachineTest {
  NextTest told;
  std::vector<double> time_s, input;  ///< unit of the recordings
};
MachineTest next_machine_test(std::span<const Recording> recordings, const MachineGround& ground,
                              const std::vector<std::string>& separates);

}  // namespace valvetriage
