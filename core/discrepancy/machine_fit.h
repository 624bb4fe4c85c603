#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/discrepancy/machine_data.h"
#include "core/model/machine.h"

namespace valvetriage {

/// Where in a machine a free number stands.
enum class MachineField : std::uint8_t { kParameter, kSectionE, kSectionF, kNumerator, kFeedback };

struct FreeParameter {
  std::size_t block = 0;
  MachineField field = MachineField::kParameter;
  std::size_t index = 0;
  bool logarithmic = false;
  double lower = -1e9, upper = 1e9;  ///< in the value itself
  double unit = 1;  ///< what is much of it, where it is not logarithmic; of numbers without a time, near 1
};

/// Parameter `index` of a block's law, free between its bounds.
inline FreeParameter law_parameter(std::size_t block, std::size_t index, double lower, double upper,
                                   bool logarithmic = false) {
  return {block, MachineField::kParameter, index, logarithmic, lower, upper};
}
/// One that is not near 1 where it is much.
inline FreeParameter law_parameter_in(double unit, std::size_t block, std::size_t index, double lower, double upper) {
  return {block, MachineField::kParameter, index, false, lower, upper, unit};
}

/// A machine with what may move in it, and where it stands in a search.
struct MachineFit {
  Machine machine;
  std::vector<FreeParameter> free;
  std::vector<std::vector<double>> starts;  ///< per record, start_size(machine) each
  double squares = 0;                       ///< squared residuals over the fitted rows, scaled units
  std::size_t rows = 0;
  bool failed = false;  ///< its run left the range of numbers

  double rms() const;
  std::size_t freedoms() const { return free.size(); }
};

/// Samples that may still be simulated: a budget counts work, not seconds.
struct MachineBudget {
  double block_samples = 0;
  bool spent() const { return block_samples <= 0; }
};

using MachineRows = std::vector<std::vector<std::size_t>>;

/// Every section and coefficient of a linear (or feedback) block as free parameters.
std::vector<FreeParameter> free_dynamics(const MachineBlock& block, std::size_t index);

double value_of(const Machine& machine, const FreeParameter& parameter);
void set_value(Machine& machine, const FreeParameter& parameter, double value);

/// Bounded Levenberg-Marquardt on free parameters and every record's start, free-run error over the rows.
///
/// Jacobian by differences from the block that moves onwards; coefficients of a linear block by its basis signals.
/// Sections stay stable and within SectionLimits; modes slower than half the longest record cost one unit of χ² per
/// squared e-fold. A step that does not lower the error is not taken, so the result is never worse than the start.
void refine_machine(const MachineData& data, const MachineRows& rows, int iterations, MachineFit& fit,
                    MachineBudget& budget);

/// Squared error of the fit as it stands.
void evaluate_machine(const MachineData& data, const MachineRows& rows, MachineFit& fit, MachineBudget& budget);

/// Starts of the given records alone, on their rows; everything shared stays.
void refine_starts(const MachineData& data, const MachineRows& rows, int iterations, MachineFit& fit,
                   MachineBudget& budget);

/// The same as far as the records show it: what passes a section slower than half the longest record answers slow
/// changes that the records do not hold, and its weight is not known from them, whatever it is. Between the rates of a
/// section of a slow and a fast pole, its difference stands still instead, at f / e of what enters.
/// Returned as the factor of each weight.
std::vector<double> seen_at_rest(const MachineData& data, const std::vector<Section>& sections, std::size_t weights);
double gain_seen(const MachineData& data, const std::vector<Section>& sections, const std::vector<double>& weights);

/// Covariance of the free parameters at the fit, scaled by the residual's autocorrelation up to a tenth of the record;
/// of a logarithmic one, that of its value.
Eigen::MatrixXd parameter_covariance(const MachineData& data, const MachineRows& rows, const MachineFit& fit);

/// What a run of a record sees beside its input.
inline MachineSurroundings around(const MachineRecord& record) {
  return {.start_s = record.start_s, .side = record.side};
}

/// Measured less simulated at the rows, record by record.
std::vector<double> residuals_at(const MachineData& data, const MachineRows& rows, const MachineFit& fit);

/// Free run of one record.
std::vector<double> run_record(const MachineData& data, std::size_t record, const MachineFit& fit);

}  // namespace valvetriage
