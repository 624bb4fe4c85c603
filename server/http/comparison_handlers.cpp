#include <boost/math/statistics/univariate_statistics.hpp>
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

/// Valves by what they are counted under, which may be several causes of one valve.
std::map<std::string, std::int64_t> count_outcomes(const Side& side) {
  std::map<std::string, std::int64_t> counts;
  for (const SubmissionRow& valve : side.history.valves) {
    for (const std::string& name : outcomes(valve)) ++counts[name];
  }
  return counts;
}

std::map<std::string, std::int64_t> count_verdicts(const Side& side) {
  std::map<std::string, std::int64_t> counts;
  for (const SubmissionRow& valve : side.history.valves) ++counts[valve.summary.verdict.value_or("null")];
  return counts;
}

Json view(const Side& side) {
  return Json{{"lot", or_null(side.filter.lot)},
              {"stand", or_null(side.filter.stand)},
              {"valves", side.history.valves.size()},
              {"verdicts", count_verdicts(side)}};
}

std::int64_t at(const std::map<std::string, std::int64_t>& counts, const std::string& name) {
  const auto found = counts.find(name);
  return found == counts.end() ? 0 : found->second;
}

/// How many of both sides are counted under a name, and the chance of so unequal shares.
Json share(const std::string& name, std::int64_t a, std::int64_t of_a, std::int64_t b, std::int64_t of_b) {
  return Json{{"name", name}, {"a", a},       {"of_a", of_a},
              {"b", b},       {"of_b", of_b}, {"p_value", fisher_exact_p_value(a, of_a - a, b, of_b - b)}};
}

/// left_out  the name of the valves that take no part
Json shares(const Side& a, const Side& b, std::map<std::string, std::int64_t> (*counted)(const Side&),
            const char* left_out) {
  const auto in_a = counted(a), in_b = counted(b);
  const auto of = [&](const Side& side, const auto& counts) {
    return static_cast<std::int64_t>(side.history.valves.size()) - at(counts, left_out);
  };
  std::set<std::string> names;
  for (const auto* counts : {&in_a, &in_b}) {
    for (const auto& [name, count] : *counts) names.insert(name);
  }
  names.erase(left_out);
  Json items = Json::array();
  for (const std::string& name : names) {
    items.push_back(share(name, at(in_a, name), of(a, in_a), at(in_b, name), of(b, in_b)));
  }
  return items;
}

double median_of(std::vector<double> values) {
  return boost::math::statistics::median(values);
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
                         {"a", Json{{"valves", level.values.size()}, {"median", median_of(level.values)}}},
                         {"b", Json{{"valves", other->values.size()}, {"median", median_of(other->values)}}},
                         {"p_value", finite_or_null(p)}});
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
                            {"verdicts", shares(*a, *b, count_verdicts, "null")},
                            {"causes", shares(*a, *b, count_outcomes, "")},
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
      for (const CauseSummary& cause : settled_causes(*valve)) ++causes[cause.cause];
    }
    Json of_stand = Json::array();
    for (const StandAlarm& alarm : alarms) {
      if (alarm.stand == stand) of_stand.push_back(http::view(alarm, history.valves));
    }
    items.push_back(Json{{"stand", stand},
                         {"valves", valves.size()},
                         {"last_received_at", format_rfc3339(valves.back()->received_at)},
                         {"verdicts", verdict_counts},
                         {"causes", causes},
                         {"alarms", std::move(of_stand)}});
  }
  return whole_list_response(request, std::move(items));
}

}  // namespace valvetriage::http
