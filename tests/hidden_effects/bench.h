#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <string>
#include <vector>

#include "tests/stand/environment.h"
#include "tests/stand/session.h"

namespace valvetriage::hidden_effects {

/// The noise-free twin runs of one valve on one day: the same commands, history and surroundings with other parameters
/// and other faults.
class TwinBench {
 public:
  explicit TwinBench(const stand::SessionOptions& options);
  TwinBench(const stand::SessionOptions& options, const stand::Unit& unit);

  const stand::Unit& unit() const { return unit_; }
  Eigen::Index samples() const { return begin_.back(); }
  std::size_t recordings() const { return commands_.size(); }
  Eigen::Index begin(std::size_t recording) const { return begin_[recording]; }
  Eigen::Index size(std::size_t recording) const { return begin_[recording + 1] - begin_[recording]; }
  double time_s(std::size_t recording, Eigen::Index row) const {
    return commands_[recording].period_s * static_cast<double>(row);
  }
  const std::vector<stand::Command>& commands() const { return commands_; }
  const stand::Environment& environment(std::size_t recording) const { return environments_[recording]; }

  /// All recordings one after the other, value(recording, row) in each row.
  template <class Function>
  Eigen::VectorXd column_of(Function value) const {
    Eigen::VectorXd column(samples());
    for (std::size_t i = 0; i < recordings(); ++i)
      for (Eigen::Index k = 0; k < size(i); ++k) column[begin(i) + k] = value(i, k);
    return column;
  }

  /// The faults that effects make, by recording.
  std::vector<stand::Faults> faults(const std::vector<stand::EffectRequest>& effects) const;
  /// Outputs [psi] of all recordings, one after the other.
  Eigen::VectorXd output(const stand::Unit& unit, const std::vector<stand::Faults>& faults) const;
  /// The same with another past before each recording.
  Eigen::VectorXd output_after(int past) const;

 private:
  stand::SessionOptions options_;
  stand::Unit unit_;
  std::vector<stand::Command> commands_;
  std::vector<stand::Environment> environments_;
  std::vector<Eigen::Index> begin_;
};

/// A past day of the nominal unit: what is made there serves every valve.
TwinBench nominal_bench(const std::vector<std::string>& tests);

}  // namespace valvetriage::hidden_effects
