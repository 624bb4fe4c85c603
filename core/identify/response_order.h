#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/identify/asymptotic_bode.h"
#include "core/identify/rational_fit.h"

namespace valvetriage {

enum class ResponseModelKind : std::uint8_t { kAsymptotic, kRational };

/// A transfer function of a frequency response, by either method.
struct ResponseModel {
  ResponseModelKind kind = ResponseModelKind::kRational;
  TransferFunction transfer_function;
  std::vector<double> pole_std_errors, zero_std_errors;  ///< rad/s
  double static_gain = 0, static_gain_std_error = 0;
  double delay_std_error_s = 0;
  double misfit_per_freedom = 0;  ///< rational: χ² per freedom; asymptotic: rms of ln|Y| − ln|G| [neper]
  Termination termination = Termination::kConverged;
  std::optional<AsymptoticFit> steps;  ///< of the asymptotic method
};

/// One order's line of the table.
///
/// rmse_heldout  rms of |H − G| (asymptotic: of |H| − |G|) at frequencies that took no part in the fit [unit of gain]
/// criterion     Schwarz's, BIC = n ln(misfit / n) + p ln n with n the real values fitted, so that the size of the
///               standard errors does not matter; only differences mean anything
/// order, zeros, delay_s  of the model fitted to all points
struct TriedResponseOrder {
  int order = 0;
  int zeros = 0;
  double delay_s = 0;
  double rmse_heldout = 0;
  double criterion = 0;
};

struct ResponseOrderOptions {
  ResponseModelKind kind = ResponseModelKind::kRational;
  std::optional<int> order{};  ///< as asked for; the table goes up to it
  std::optional<int> zeros{};
  int largest_order = 9;  ///< the paper estimates five to nine
};

struct ResponseOrderChoice {
  ResponseModel model;
  std::vector<TriedResponseOrder> tried;
  std::string reason;
  std::vector<std::string> notes;  ///< where the data do not support the order asked for
};

/// Order, number of zeros and the model of a frequency response.
///
/// Held out in turn: every fifth group of points (of one window), refitted from the whole fit. Taken is the smallest
/// order whose held-out error (mean over folds of ln Σ |H − G|² / σ²) is within a standard error or half a percent of
/// the best (Breiman and others 1984), or that of lowest BIC if smaller, for poles may sit on left-out points' noise;
/// then the fewest zeros by BIC. An order asked for is taken, and the note says when a smaller one does as well.
///
/// Errors  as fit_rational and fit_asymptotic
/// Cost    rational, nine orders at 75 frequencies: some 0.2 s; pure
Result<ResponseOrderChoice> choose_response_order(const FrequencyResponse& response,
                                                  const ResponseOrderOptions& options);

}  // namespace valvetriage
