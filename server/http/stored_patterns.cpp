#include "server/http/stored_patterns.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>

#include "server/http/limits.h"
#include "server/http/stored_recording.h"
#include "server/http/subject.h"
#include "server/report/curves.h"
#include "server/wire/residuals_json.h"

namespace valvetriage::http {

/// Thread-safe; empties itself where it is full, for what is in it can be computed again.
struct ResidualCache {
  static constexpr std::size_t kMost = 1000;  // about 10 MB

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

/// Residuals of one valve's recordings under the simulation its newest analysis compared it with. A recording that
/// cannot be read or simulated is left out.
Result<ValveResiduals> simulated_residuals(Service& service, const SubmissionRow& valve) {
  const auto row = service.store.newest_analysis(valve.id);
  if (!row) return tl::unexpected(row.error());
  if (auto known = service.residuals->find(row->id)) return std::move(*known);
  const auto document = stored_analysis(service, *row);
  if (!document) return tl::unexpected(document.error());
  const auto stored = service.store.recordings_of(valve.id);
  if (!stored) return tl::unexpected(stored.error());
  std::vector<Recording> recordings;
  for (const RecordingRow& each : *stored) {
    auto recording = read_stored_recording(service, each);
    if (recording) recordings.push_back(std::move(*recording));
  }
  const auto reference = reference_to_show(service, document->analysis);
  if (!reference) return tl::unexpected(reference.error());
  const Baseline& baseline = document->analysis.baseline;
  const auto known = report::tests_taken_off(baseline, *reference ? &**reference : nullptr);
  ValveResiduals residuals = report::valve_residuals(std::move(recordings), baseline.model, known);
  service.residuals->keep(row->id, residuals);
  return residuals;
}

/// The newest valves of a conclusion with their residuals.
struct Compared {
  std::vector<const SubmissionRow*> valves;
  std::vector<ValveResiduals> residuals;
  std::size_t simulated = 0;  ///< of those whose analysis kept none
};

/// Residuals of one more valve; none where too many would have to be simulated.
Result<std::optional<ValveResiduals>> next_residuals(Service& service, const SubmissionRow& valve, Compared& found) {
  const auto kept = service.store.newest_residuals(valve.id);
  if (!kept) return tl::unexpected(kept.error());
  if (!kept->empty()) {
    auto residuals = residuals_from_json(*kept);
    if (!residuals) return tl::unexpected(residuals.error());
    return std::move(*residuals);
  }
  if (found.simulated == kMaxSimulatedValves) return std::nullopt;
  ++found.simulated;
  auto residuals = simulated_residuals(service, valve);
  if (!residuals) return tl::unexpected(residuals.error());
  return std::move(*residuals);
}

Result<Compared> compared_valves(Service& service, const LotHistory& history, std::string_view conclusion,
                                 std::size_t most) {
  Compared found;
  for (auto valve = history.valves.rbegin(); valve != history.valves.rend() && found.valves.size() < most; ++valve) {
    if (valve->summary.conclusion != conclusion) continue;
    auto residuals = next_residuals(service, *valve, found);
    if (!residuals) return tl::unexpected(residuals.error());
    if (!*residuals) continue;
    found.valves.push_back(&*valve);
    found.residuals.push_back(std::move(**residuals));
  }
  return found;
}

}  // namespace

std::vector<const SubmissionRow*> StoredPatterns::alone() const {
  std::vector<bool> grouped(compared.size());
  for (const LotPattern& group : groups) {
    for (const std::size_t member : group.members) grouped[member] = true;
  }
  std::vector<const SubmissionRow*> valves;
  for (std::size_t i = 0; i < compared.size(); ++i) {
    if (!grouped[i]) valves.push_back(compared[i]);
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
