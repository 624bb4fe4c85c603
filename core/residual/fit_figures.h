#pragma once

#include <cstdint>
#include <span>

namespace valvetriage {

/// How well a free run follows a measurement. Samples with valid[i] == 0 take no part; an empty `valid` means all do.
///
///   rmse          √(Σ e² / n),  e = measured − simulated          unit of the output
///   fit_percent   100 (1 − ‖e‖ / ‖y − mean y‖)                    %; −∞ is clamped to −1e6 for a constant output
struct FitFigures {
  double rmse = 0;
  double fit_percent = 0;
  std::size_t samples = 0;
};

/// measured, simulated  n values each, unit of the output
FitFigures fit_figures(std::span<const double> measured, std::span<const double> simulated,
                       std::span<const std::uint8_t> valid);

}  // namespace valvetriage
