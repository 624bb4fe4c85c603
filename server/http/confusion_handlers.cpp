#include <algorithm>
#include <map>
#include <set>

#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/stored_history.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

/// What the newest result of a serial says: its causes, or its conclusion where none is settled.
struct Named {
  std::vector<std::string> causes;  ///< strongest first
  std::string otherwise;            ///< none, ambiguous, unexplained, not_analysed
};

Result<Named> named_by_newest_result(Service& service, const std::string& serial) {
  const auto submissions = all_submissions(service.store, {.serial = serial}, kMaxPageLimit);
  if (!submissions) return tl::unexpected(submissions.error());
  for (const SubmissionRow& row : *submissions) {
    if (row.state != JobState::kDone) continue;
    const auto causes = named_causes(service.store, row);
    if (!causes) return tl::unexpected(causes.error());
    Named named{.causes = {}, .otherwise = row.summary.conclusion.value_or("not_analysed")};
    for (const Json& cause : *causes) named.causes.push_back(cause.value("cause", ""));
    return named;
  }
  return Named{.causes = {}, .otherwise = "not_analysed"};
}

/// The name that stands beside what was found: the same one where it is among the causes.
std::string name_beside(const Named& named, const std::string& found) {
  if (named.causes.empty()) return named.otherwise;
  const bool same = std::find(named.causes.begin(), named.causes.end(), found) != named.causes.end();
  return same ? found : named.causes.front();
}

}  // namespace

Result<Response> get_confusion(Service& service, Request&) {
  const auto findings = service.store.newest_findings(static_cast<int>(kMaxConfusionFindings));
  if (!findings) return tl::unexpected(findings.error());
  std::map<std::string, std::set<std::string>> found_by_serial;  // what was found twice in a valve counts once
  for (const FindingRow& finding : *findings) found_by_serial[finding.serial].insert(finding.cause);
  std::map<std::pair<std::string, std::string>, std::vector<std::string>> cells;
  std::int64_t named_right = 0, named_all = 0;
  for (const auto& [serial, causes] : found_by_serial) {
    const auto named = named_by_newest_result(service, serial);
    if (!named) return tl::unexpected(named.error());
    bool right = false;
    for (const std::string& found : causes) {
      const std::string name = name_beside(*named, found);
      cells[{name, found}].push_back(serial);
      right |= !named->causes.empty() && name == found;
    }
    named_all += !named->causes.empty();
    named_right += right;
  }
  Json items = Json::array();
  for (const auto& [pair, serials] : cells) {
    const auto shown = serials.begin() + static_cast<std::ptrdiff_t>(std::min(serials.size(), kMaxCellSerials));
    items.push_back(Json{{"named", pair.first},
                         {"found", pair.second},
                         {"valves", serials.size()},
                         {"serials", std::vector<std::string>(serials.begin(), shown)}});
  }
  return json_response(Json{{"findings", findings->size()},
                            {"valves", found_by_serial.size()},
                            {"named", named_all},
                            {"named_right", named_right},
                            {"items", std::move(items)}});
}

}  // namespace valvetriage::http
