#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>

#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/lot_patterns.h"
#include "server/http/stored_history.h"
#include "server/http/stored_recording.h"
#include "server/http/subject.h"
#include "server/http/views.h"
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

Result<Compared> compared(Service& service, const LotHistory& history, std::string_view conclusion, std::size_t most) {
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

Json numbers(const std::vector<double>& values) {
  Json array = Json::array();
  for (const double value : values) array.push_back(std::isfinite(value) ? Json(value) : Json(nullptr));
  return array;
}

Json valve_entry(const SubmissionRow& valve) {
  return Json{{"submission_id", valve.id},
              {"serial", valve.labels.serial ? Json(*valve.labels.serial) : Json(nullptr)},
              {"stand", valve.labels.stand ? Json(*valve.labels.stand) : Json(nullptr)}};
}

Json view(const LotPattern& pattern, const Compared& unexplained) {
  Json members = Json::array(), residuals = Json::array();
  for (std::size_t i = 0; i < pattern.members.size(); ++i) {
    Json member = valve_entry(*unexplained.valves[pattern.members[i]]);
    member["typicality"] = pattern.typicality[i];
    members.push_back(std::move(member));
  }
  for (const GroupResidual& residual : pattern.residuals) {
    residuals.push_back(Json{{"test", residual.test},
                             {"time_s", numbers(residual.time_s)},
                             {"mean", numbers(residual.mean)},
                             {"sd", numbers(residual.sd)},
                             {"good", numbers(residual.good)}});
  }
  return Json{{"members", std::move(members)}, {"residuals", std::move(residuals)}};
}

Json alone(const std::vector<LotPattern>& patterns, const Compared& unexplained) {
  Json valves = Json::array();
  for (std::size_t i = 0; i < unexplained.valves.size(); ++i) {
    const bool grouped = std::any_of(patterns.begin(), patterns.end(), [&](const LotPattern& pattern) {
      return std::find(pattern.members.begin(), pattern.members.end(), i) != pattern.members.end();
    });
    if (!grouped) valves.push_back(valve_entry(*unexplained.valves[i]));
  }
  return valves;
}

}  // namespace

Result<Response> get_lot_patterns(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  const auto all = std::count_if(history->valves.begin(), history->valves.end(),
                                 [](const SubmissionRow& valve) { return valve.summary.conclusion == "unexplained"; });
  const auto place = ComputationPlace::take(service);
  if (!place) return tl::unexpected(place.error());
  const auto unexplained = compared(service, *history, "unexplained", kMaxPatternValves);
  if (!unexplained) return tl::unexpected(unexplained.error());
  Compared good;
  if (unexplained->valves.size() > 1) {
    auto found = compared(service, *history, "none", kPatternGoodValves);
    if (!found) return tl::unexpected(found.error());
    good = std::move(*found);
  }
  const std::vector<LotPattern> patterns = lot_patterns(unexplained->residuals, good.residuals);
  Json groups = Json::array();
  for (const LotPattern& pattern : patterns) groups.push_back(view(pattern, *unexplained));
  return json_response(Json{{"lot", lot->lot},
                            {"unexplained", all},
                            {"compared", unexplained->valves.size()},
                            {"good_valves", good.valves.size()},
                            {"groups", std::move(groups)},
                            {"alone", alone(patterns, *unexplained)}});
}

}  // namespace valvetriage::http
