#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/identify/valve_fit.h"

namespace valvetriage {

/// The weighted least-squares problem behind fit_valve, linearised by tangents (internal to identify).
///
/// Vector: [parameters | knot outputs | four start values per recording: two spool states, pressure gap, loop memory].
class ValveFitProblem {
 public:
  static constexpr Eigen::Index kParameters = static_cast<Eigen::Index>(kValveParameters.size());
  static constexpr Eigen::Index kStarts = 4;

  ValveFitProblem(std::span<const Recording> recordings, const ValveFitOptions& options);

  Eigen::Index size() const { return shared() + kStarts * static_cast<Eigen::Index>(prepared_.size()); }
  Eigen::Index shared() const { return kParameters + knots_; }
  Eigen::Index knots() const { return knots_; }

  /// The vector inside its bounds.
  Eigen::VectorXd clamped(Eigen::VectorXd v) const;
  /// Parameters as given, knots by averaging the outputs seen at each input, starts at rest.
  Eigen::VectorXd start_vector(const ValveParameters& parameters) const;

  /// Σ e² / σ² + penalties.
  double cost(const Eigen::VectorXd& v) const;
  std::vector<double> simulate(const Eigen::VectorXd& v, std::size_t recording) const;

  /// Normal equations of one linearisation, lower and upper half filled.
  struct Normal {
    Eigen::MatrixXd a;
    Eigen::VectorXd b;
  };
  Normal linearise(const Eigen::VectorXd& v) const;

 private:
  struct Prepared {
    const Recording* recording = nullptr;
    IntervalSignal input;
    std::vector<double> driver;
    double inverse_variance = 1;
  };
  struct Run {
    std::vector<double> position;  ///< the map's input x at each sample [A]
    std::vector<double> steady;    ///< map(x)
    std::vector<double> pressure;
    VolumeTangent tangent;
  };

  Eigen::Index start_at(std::size_t recording) const {
    return shared() + kStarts * static_cast<Eigen::Index>(recording);
  }
  StaticMap map_of(const Eigen::VectorXd& v) const;
  void run_spool(const Eigen::VectorXd& v, std::size_t recording, std::vector<double>& position) const;
  Run run(const Eigen::VectorXd& v, std::size_t recording, bool tangents) const;
  void accumulate(const Eigen::VectorXd& v, std::size_t recording, Normal& normal) const;
  Eigen::MatrixXd nonlinear_columns(const Eigen::VectorXd& v, std::size_t recording, const Run& base) const;
  double penalty(const Eigen::VectorXd& v) const;
  void add_penalty(const Eigen::VectorXd& v, Normal& normal) const;
  void set_bounds();
  void set_preferences();

  const ValveFitOptions& options_;
  std::vector<Prepared> prepared_;
  Eigen::Index knots_;
  Eigen::VectorXd lower_, upper_, step_;
  Eigen::MatrixXd precision_;  ///< of the prior, shared × shared
  Eigen::VectorXd mean_;
};

}  // namespace valvetriage
