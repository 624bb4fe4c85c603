#include "server/report/valve_residuals.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/report/curves.h"

namespace valvetriage::report {

ValveResiduals valve_residuals(std::vector<Recording> recordings, const Model& model,
                               std::span<const KnownTest> known) {
  std::stable_sort(recordings.begin(), recordings.end(),
                   [](const Recording& a, const Recording& b) { return a.name < b.name; });
  ValveResiduals residuals;
  for (const Recording& recording : recordings) {
    const auto simulated = free_run(model, recording, known);
    if (!simulated) continue;
    const double duration_s = static_cast<double>(recording.samples()) * recording.sample_period_s;
    std::string key = fmt::format("{}, {:.1f} s", to_string(recording.test), duration_s);
    const auto count = std::count_if(residuals.begin(), residuals.end(),
                                     [&](const auto& entry) { return entry.first.starts_with(key); });
    if (count > 0) key += fmt::format(", {}", count + 1);
    residuals.emplace(std::move(key), binned_residual(recording, *simulated, kResidualBins));
  }
  return residuals;
}

}  // namespace valvetriage::report
