#include "core/residual/fit_figures.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace valvetriage {

FitFigures fit_figures(std::span<const double> measured, std::span<const double> simulated,
                       std::span<const std::uint8_t> valid) {
  assert(measured.size() == simulated.size());
  const auto counts = [&](std::size_t i) { return valid.empty() || valid[i] != 0; };
  FitFigures figures;
  double sum = 0;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (!counts(i)) continue;
    sum += measured[i];
    ++figures.samples;
  }
  if (figures.samples == 0) return figures;
  const double n = static_cast<double>(figures.samples);
  const double mean = sum / n;
  double squared_error = 0;
  double squared_signal = 0;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    if (!counts(i)) continue;
    const double e = measured[i] - simulated[i];
    const double y = measured[i] - mean;
    squared_error += e * e;
    squared_signal += y * y;
  }
  constexpr double kWorstPercent = -1e6;
  figures.rmse = std::sqrt(squared_error / n);
  figures.fit_percent = squared_signal > 0
                            ? std::max(kWorstPercent, 100.0 * (1.0 - std::sqrt(squared_error / squared_signal)))
                            : kWorstPercent;
  return figures;
}

}  // namespace valvetriage
