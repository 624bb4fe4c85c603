#include "server/http/stored_history.h"

#include <iterator>
#include <set>

namespace valvetriage::http {
namespace {

constexpr std::size_t kMaxHistorySubmissions = 20'000;  // twice the largest lot the plant ships

}  // namespace

Result<std::vector<SubmissionRow>> all_submissions(Store& store, const Filter& filter, std::size_t most) {
  std::vector<SubmissionRow> rows;
  PageRequest page{.limit = kMaxPageLimit, .cursor = std::nullopt};
  do {
    auto next = store.list_submissions(filter, page);
    if (!next) return tl::unexpected(next.error());
    std::move(next->items.begin(), next->items.end(), std::back_inserter(rows));
    page.cursor = next->next;
  } while (page.cursor && rows.size() < most);
  return rows;
}

Result<LotHistory> stored_history(Store& store, const Filter& filter) {
  const auto submissions = all_submissions(store, filter, kMaxHistorySubmissions);
  if (!submissions) return tl::unexpected(submissions.error());
  return lot_history(*submissions);
}

Result<Json> newest_document(Store& store, const SubmissionRow& valve) {
  const auto row = store.newest_analysis(valve.id);
  if (!row) return tl::unexpected(row.error());
  const auto body = store.analysis_body(row->id);
  if (!body) return tl::unexpected(body.error());
  return parse_json(*body);
}

Result<Json> named_causes(Store& store, const SubmissionRow& valve) {
  std::set<std::string> settled;
  for (const CauseSummary& cause : settled_causes(valve)) settled.insert(cause.cause);
  if (settled.empty()) return Json::array();
  const auto document = newest_document(store, valve);
  if (!document) return tl::unexpected(document.error());
  const auto found = document->find("discrepancy");
  if (found == document->end() || !found->is_object()) return Json::array();
  Json causes = found->value("causes", Json::array());
  std::erase_if(causes.get_ref<Json::array_t&>(),
                [&](const Json& cause) { return !settled.contains(cause.value("cause", "")); });
  return causes;
}

}  // namespace valvetriage::http
