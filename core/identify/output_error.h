#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/model/model.h"
#include "core/model/transfer_function.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// y_t = Σ_{i=0..zeros} b_i u_{t−k−i} − Σ_{j=1..order} a_j y_{t−j}
struct OutputErrorStructure {
  int order = 2;          ///< 1 to kMaxIdentifiedOrder
  int zeros = 1;          ///< 0 to order
  int delay_samples = 1;  ///< k ≥ 0; k = order − zeros is a plant without a delay of its own under a zero-order hold
};

inline constexpr int kMaxIdentifiedOrder = 12;

/// Whether recordings have constant terms of their own (a sensor zeroed anew each time) or one together (one affine
/// model).
enum class OffsetSharing : std::uint8_t { kPerRecording, kShared };

/// How an iteration ended. A value: a fit that did not converge is still the best found.
enum class Termination : std::uint8_t {
  kConverged,       ///< the last step changed the squared error by less than the tolerance
  kNoDescent,       ///< no step of any length lowers the error further: a minimum to rounding
  kIterationLimit,  ///< the budget ran out
  kNotExcited       ///< the data leave some parameters open; the smallest of the equally good solutions
};
std::string to_string(Termination termination);

struct OutputErrorOptions {
  OffsetSharing offsets = OffsetSharing::kPerRecording;
  int max_iterations = 40;  ///< of the final refinement; a search that needs more gains nothing visible
  double tolerance = 1e-7;  ///< relative change of the squared error that counts as none: far below one unit of χ²
  std::size_t max_search_rows = 4000;      ///< rows on which starts are compared; the winner sees all
  std::vector<TransferFunction> starts{};  ///< further starting points: their poles (z domain, same sample time)
};

/// Coefficients with standard errors.
struct CoefficientErrors {
  std::vector<double> a;  ///< as RationalCoefficients::a, 0 for a[0]
  std::vector<double> b;
  double static_gain = 0;
};

/// A free run over recordings, each with the initial state that suits it best.
struct FreeRun {
  double input_offset = 0;             ///< operating point of the input
  std::vector<double> output_offsets;  ///< output at that input at rest, one per recording (all equal where shared)
  double rmse = 0;                     ///< over all valid samples, unit of the output
  double fit_percent = 0;              ///< each recording's mean taken off
  std::vector<std::vector<double>> simulated;  ///< per recording, per grid sample
};

/// A free-run fit.
struct OutputErrorFit {
  OutputErrorStructure structure;
  Termination termination = Termination::kConverged;
  int iterations = 0;
  std::string start;  ///< which identifier the winning start came from
  TransferFunction transfer_function;
  RationalCoefficients coefficients;
  CoefficientErrors std_errors;  ///< from the Jacobian, with the residual's autocorrelation in it
  double static_gain = 0;
  FreeRun run;
};

/// Free run of given dynamics, initial states and offsets (one per recording) by least squares.
///
/// Errors  unstable; improper for more zeros than poles; as fit_output_error
Result<FreeRun> free_run(std::span<const Recording* const> recordings, const RationalCoefficients& dynamics);

/// Refines the free-run simulation: argmin Σ (y − G u − free response − offset)² over poles, zeros, gain, initial
/// states and offsets; bounded Levenberg-Marquardt on the poles with everything linear projected out (Golub and Pereyra
/// 1973), analytic sensitivities. Started from ARX and from Steiglitz-McBride iterations (1965) at several filter
/// bandwidths.
///
/// recordings  one or more that share the dynamics, one sample time; samples that are not valid take no part
/// Range       poles stay inside the unit circle; complex pairs do not ring longer than a third of the longest record;
///             modes slower than half of it cost one unit of χ² per squared e-fold
/// Errors      bad_option, no_samples, too_few_samples (10 per parameter), constant_input, not_finite,
/// sample_time_differs Cost        about 60 free runs with their sensitivities; pure
Result<OutputErrorFit> fit_output_error(std::span<const Recording* const> recordings,
                                        const OutputErrorStructure& structure, const OutputErrorOptions& options);

}  // namespace valvetriage
