#include "server/http/stored_patterns.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>

#include "server/http/limits.h"
#include "server/http/stored_recording.h"
#include "server/http/subject.h"
#include "server/report/curves.h"

namespace valvetriage::http {

/// Thread-safe; empties itself where it is full, for what is in it can be computed again.
struct ResidualCache {
  static constexpr std::size_t kMost = 2000;  // about 10 MB

  std::optional<ValveResiduals> find(const std::string& analysis_id) {
    const std::lock_guard lock(mutex);
    const auto found = by_analysis.find(analysis_id);
    return found == by_analysis.end() ? std::nullopt : std::optional(found->second);
  }
  void keep(const std::string& analysis_id, const ValveResiduals& residuals) {
    const std::lock_guard lock(mutex);
    if (by_analysis.size() >= kMost) by_analysis.clear();
    by_analysis.emplace(analysis_id, residuals);
  }

  std::mutex mutex;
  std::map<std::string, ValveResiduals> by_analysis;
};

std::shared_ptr<ResidualCache> make_residual_cache() {
  return std::make_shared<ResidualCache>();
}

namespace {

constexpr std::size_t kBins = 64;  // a 20 s test at 200 Hz: 60 samples each, a time constant or two

/// Residuals of one valve's recordings under the simulation its newest analysis compared it with. A recording that
/// cannot be read or simulated is left out.
Result<ValveResiduals> residuals_of(Service& service, const SubmissionRow& valve) {
  const auto row = service.store.newest_analysis(valve.id);
  if (!row) return tl::unexpected(row.error());
  if (auto known = service.residuals->find(row->id)) return std::move(*known);
  const auto document = stored_analysis(service, *row);
  if (!document) return tl::unexpected(document.error());
  auto recordings = service.store.recordings_of(valve.id);
  if (!recordings) return tl::unexpected(recordings.error());
  std::stable_sort(recordings->begin(), recordings->end(),
                   [](const RecordingRow& a, const RecordingRow& b) { return a.name < b.name; });
  ValveResiduals residuals;
  for (const RecordingRow& stored : *recordings) {
    const auto recording = read_stored_recording(service, stored);
    if (!recording) continue;
    const auto simulated = report::free_run(document->analysis.baseline.model, *recording);
    if (!simulated) continue;
    const double duration_s = static_cast<double>(recording->samples()) * recording->sample_period_s;
    std::string key = fmt::format("{}, {:.1f} s", to_string(recording->test), duration_s);
    const auto count = std::count_if(residuals.begin(), residuals.end(),
                                     [&](const auto& entry) { return entry.first.starts_with(key); });
    if (count > 0) key += fmt::format(", {}", count + 1);
    residuals.emplace(std::move(key), binned_residual(*recording, *simulated, kBins));
  }
  service.residuals->keep(row->id, residuals);
  return residuals;
}

/// The newest valves of a conclusion with their residuals.
struct Compared {
  std::vector<const SubmissionRow*> valves;
  std::vector<ValveResiduals> residuals;
};

Result<Compared> compared_valves(Service& service, const LotHistory& history, std::string_view conclusion,
                                 std::size_t most) {
  Compared found;
  for (auto valve = history.valves.rbegin(); valve != history.valves.rend() && found.valves.size() < most; ++valve) {
    if (valve->summary.conclusion != conclusion) continue;
    auto residuals = residuals_of(service, *valve);
    if (!residuals) return tl::unexpected(residuals.error());
    found.valves.push_back(&*valve);
    found.residuals.push_back(std::move(*residuals));
  }
  return found;
}

}  // namespace

std::vector<const SubmissionRow*> StoredPatterns::alone() const {
  std::vector<const SubmissionRow*> valves;
  for (std::size_t i = 0; i < compared.size(); ++i) {
    const bool grouped = std::any_of(groups.begin(), groups.end(), [&](const LotPattern& group) {
      return std::find(group.members.begin(), group.members.end(), i) != group.members.end();
    });
    if (!grouped) valves.push_back(compared[i]);
  }
  return valves;
}

Result<StoredPatterns> stored_patterns(Service& service, const LotHistory& history) {
  StoredPatterns patterns;
  patterns.unexplained = static_cast<std::size_t>(
      std::count_if(history.valves.begin(), history.valves.end(),
                    [](const SubmissionRow& valve) { return valve.summary.conclusion == "unexplained"; }));
  auto unexplained = compared_valves(service, history, "unexplained", kMaxPatternValves);
  if (!unexplained) return tl::unexpected(unexplained.error());
  patterns.compared = std::move(unexplained->valves);
  if (patterns.compared.size() < 2) return patterns;
  const auto good = compared_valves(service, history, "none", kPatternGoodValves);
  if (!good) return tl::unexpected(good.error());
  patterns.good_valves = good->valves.size();
  patterns.groups = lot_patterns(unexplained->residuals, good->residuals);
  return patterns;
}

}  // namespace valvetriage::http
