#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "core/classify/rule_base.h"
#include "core/classify/two_groups.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/stored_history.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

/// One side of a comparison: the valves of a lot, of a stand, or of a lot on a stand.
struct Side {
  Filter filter;
  LotHistory history;
};

Json text_or_null(const std::optional<std::string>& text) {
  return text ? Json(*text) : Json(nullptr);
}

Result<Side> side_of(Service& service, const Request& request, const std::string& lot, const std::string& stand) {
  Side side;
  if (const std::string name = request.parameter(lot); !name.empty()) side.filter.lot = name;
  if (const std::string name = request.parameter(stand); !name.empty()) side.filter.stand = name;
  if (!side.filter.lot && !side.filter.stand) {
    Error error{.code = "bad_parameter", .message = lot + " or " + stand + " says what to compare"};
    error.field = lot;
    return tl::unexpected(error);
  }
  auto history = stored_history(service.store, side.filter);
  if (!history) return tl::unexpected(history.error());
  side.history = std::move(*history);
  return side;
}

/// What a valve is counted under beside its verdict: its settled cause, or that there is none.
std::string outcome(const SubmissionRow& valve) {
  const std::string conclusion = valve.summary.conclusion.value_or("");
  return conclusion == "named" ? valve.summary.top_cause.value_or("") : conclusion;
}

std::map<std::string, std::int64_t> outcomes(const Side& side) {
  std::map<std::string, std::int64_t> counts;
  for (const SubmissionRow& valve : side.history.valves) ++counts[outcome(valve)];
  return counts;
}

std::map<std::string, std::int64_t> verdicts(const Side& side) {
  std::map<std::string, std::int64_t> counts;
  for (const SubmissionRow& valve : side.history.valves) ++counts[valve.summary.verdict.value_or("null")];
  return counts;
}

Json view(const Side& side) {
  return Json{{"lot", text_or_null(side.filter.lot)},
              {"stand", text_or_null(side.filter.stand)},
              {"valves", side.history.valves.size()},
              {"verdicts", verdicts(side)}};
}

std::int64_t at(const std::map<std::string, std::int64_t>& counts, const std::string& name) {
  const auto found = counts.find(name);
  return found == counts.end() ? 0 : found->second;
}

/// How many of both sides are counted under a name, and the chance of so unequal shares.
Json share(const std::string& name, std::int64_t a, std::int64_t of_a, std::int64_t b, std::int64_t of_b) {
  return Json{{"name", name}, {"a", a}, {"b", b}, {"p_value", fisher_exact_p_value(a, of_a - a, b, of_b - b)}};
}

Json shares(const std::map<std::string, std::int64_t>& a, const std::map<std::string, std::int64_t>& b,
            const char* left_out) {
  std::set<std::string> names;
  std::int64_t of_a = 0, of_b = 0;
  for (const auto& [name, count] : a) (name == left_out ? 0 : (names.insert(name), of_a += count));
  for (const auto& [name, count] : b) (name == left_out ? 0 : (names.insert(name), of_b += count));
  Json items = Json::array();
  for (const std::string& name : names) items.push_back(share(name, at(a, name), of_a, at(b, name), of_b));
  return items;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

const FigureHistory* level_at(const Side& side, double level_a) {
  for (const auto& [other_a, level] : side.history.levels) {
    if (std::abs(other_a - level_a) < kLevelTolerance) return &level;
  }
  return nullptr;
}

Json levels(const Side& a, const Side& b) {
  Json items = Json::array();
  for (const auto& [level_a, level] : a.history.levels) {
    const FigureHistory* other = level_at(b, level_a);
    if (other == nullptr) continue;
    const double p = rank_sum_p_value(level.values, other->values);
    items.push_back(Json{{"level_A", level_a},
                         {"a", Json{{"valves", level.values.size()}, {"median", median(level.values)}}},
                         {"b", Json{{"valves", other->values.size()}, {"median", median(other->values)}}},
                         {"p_value", std::isfinite(p) ? Json(p) : Json(nullptr)}});
  }
  return items;
}

}  // namespace

Result<Response> get_comparison(Service& service, Request& request) {
  const auto a = side_of(service, request, "lot", "stand");
  if (!a) return tl::unexpected(a.error());
  const auto b = side_of(service, request, "with_lot", "with_stand");
  if (!b) return tl::unexpected(b.error());
  return json_response(Json{{"a", view(*a)},
                            {"b", view(*b)},
                            {"verdicts", shares(verdicts(*a), verdicts(*b), "null")},
                            {"causes", shares(outcomes(*a), outcomes(*b), "")},
                            {"levels", levels(*a, *b)}});
}

Result<Response> list_stands(Service& service, Request& request) {
  const auto submissions = all_submissions(service.store, {}, kStandSessions);
  if (!submissions) return tl::unexpected(submissions.error());
  const LotHistory history = lot_history(*submissions);
  const std::vector<StandAlarm> alarms = stand_alarms(history.valves);
  std::map<std::string, std::vector<const SubmissionRow*>> stands;
  for (const SubmissionRow& valve : history.valves) {
    if (valve.labels.stand) stands[*valve.labels.stand].push_back(&valve);
  }
  std::vector<Json> items;
  for (const auto& [stand, valves] : stands) {
    std::map<std::string, std::int64_t> verdict_counts, causes;
    for (const SubmissionRow* valve : valves) {
      ++verdict_counts[valve->summary.verdict.value_or("null")];
      if (valve->summary.conclusion == "named") ++causes[outcome(*valve)];
    }
    const auto alarm =
        std::find_if(alarms.begin(), alarms.end(), [&, &name = stand](const auto& a) { return a.stand == name; });
    items.push_back(Json{{"stand", stand},
                         {"valves", valves.size()},
                         {"last_received_at", format_rfc3339(valves.back()->received_at)},
                         {"verdicts", verdict_counts},
                         {"causes", causes},
                         {"alarm", alarm == alarms.end() ? Json(nullptr) : http::view(*alarm, history.valves)}});
  }
  return list_response(request, std::move(items), std::nullopt);
}

}  // namespace valvetriage::http
