#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "core/identify/output_error.h"
#include "core/model/section_cascade.h"

namespace valvetriage {

/// Samples that take part in a sum, ascending, one list per recording.
using RowSets = std::vector<std::vector<std::size_t>>;

/// Free-run least squares over one or more recordings for given poles (variable projection):
///
///   ŷ_r = Σ_i c_i x_i(u_r) + Σ_j l_rj x_j(impulse at the first sample) + offset
///
/// x are the outputs of the cascade of sections and their differences. c (the numerator) is shared, l (the initial
/// state) is each recording's own, the offset own or shared. Given the sections everything is linear; the sections'
/// logarithms are what an iteration moves. Input and output are centred; a recording begins at rest at its first input,
/// and l tells how it did not.
class OutputErrorProblem {
 public:
  /// Errors  no_samples, too_few_samples, constant_input, not_finite, sample_time_differs
  static Result<OutputErrorProblem> create(std::span<const Recording* const> recordings, OffsetSharing sharing);

  /// Errors  too_few_samples where there are fewer than 10 valid samples per parameter
  Result<void> check_samples(const OutputErrorStructure& structure) const;

  /// What a set of sections costs, and its linear parameters.
  struct Solution {
    Eigen::VectorXd shared;              ///< c, then the offset where shared
    std::vector<Eigen::VectorXd> local;  ///< l, then the offset where own
    double squares = 0;                  ///< sum of squared residuals over the rows
    std::size_t count = 0;               ///< rows
    bool full_rank = true;
  };
  /// Sensitivities to the sections' logarithms, projected off everything linear: R^(n×n), and what they have to
  /// explain.
  struct Projected {
    Eigen::MatrixXd jacobian;
    Eigen::VectorXd residual;
  };

  Solution solve(std::span<const Section> sections, const OutputErrorStructure& structure, const RowSets& rows) const;
  Projected project(std::span<const Section> sections, const OutputErrorStructure& structure, const RowSets& rows,
                    const Solution& solution) const;
  /// Initial state (and own offset) of recordings that took no part in solve(), from `rows`; squared error there.
  double solve_local(std::size_t recording, std::span<const Section> sections, const OutputErrorStructure& structure,
                     std::span<const std::size_t> rows, Solution& solution) const;
  /// ŷ − y reference at every sample of one recording.
  Eigen::VectorXd simulate(std::size_t recording, std::span<const Section> sections,
                           const OutputErrorStructure& structure, const Solution& solution) const;
  /// Regressors of the shared parameters and of the sections' logarithms at every valid row, with each recording's own
  /// parameters projected out; rows of all recordings below each other, rows that are not valid are zero.
  Eigen::MatrixXd shared_sensitivities(std::size_t recording, std::span<const Section> sections,
                                       const OutputErrorStructure& structure, const Solution& solution) const;
  /// One Steiglitz-McBride step: A and B of the equation error after both sides pass the sections; the new denominator.
  std::vector<Section> steiglitz_mcbride_step(std::span<const Section> sections, const OutputErrorStructure& structure,
                                              const RowSets& rows) const;

  /// Valid samples, thinned evenly to at most so many in all.
  RowSets rows(std::size_t at_most) const;
  std::size_t recordings() const { return records_.size(); }
  std::size_t samples(std::size_t recording) const { return static_cast<std::size_t>(records_[recording].y.size()); }
  std::size_t longest() const;
  const Eigen::VectorXd& output(std::size_t recording) const { return records_[recording].y; }
  const std::vector<std::size_t>& valid_rows(std::size_t recording) const { return records_[recording].valid; }
  double input_reference() const { return input_reference_; }
  double output_reference() const { return output_reference_; }
  double sample_time_s() const { return sample_time_s_; }
  SectionLimits limits() const { return SectionLimits(longest()); }
  bool shares_offset() const { return sharing_ == OffsetSharing::kShared; }

 private:
  struct Record {
    Eigen::VectorXd u, y;  // centred; y bridged linearly over samples that are not valid
    std::vector<std::size_t> valid;
  };
  /// Columns of a regression; a recording's own come first.
  struct Layout {
    Eigen::Index order;
    Eigen::Index locals;
    Eigen::Index numerators;
    Eigen::Index shared;
  };

  Layout layout_of(std::span<const Section> sections, const OutputErrorStructure& structure) const;

  std::vector<Record> records_;
  OffsetSharing sharing_ = OffsetSharing::kPerRecording;
  double input_reference_ = 0;
  double output_reference_ = 0;
  double sample_time_s_ = 0;
};

}  // namespace valvetriage
