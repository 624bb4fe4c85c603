#include "server/report/lot_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "server/report/markup.h"
#include "server/report/sentence.h"

namespace valvetriage::report {
namespace {

std::string section(const char* title, const std::string& body) {
  return fmt::format("<section>\n<h2>{}</h2>\n{}</section>\n", title, body);
}

std::string drawn(const std::string& svg) {
  return "<figure>\n" + svg + "</figure>\n";
}

std::string verdicts_part(const LotReport& report) {
  std::vector<Bar> bars;
  for (const char* verdict : {"Good", "Malfunctioned", "Severe", ""}) {
    const auto valves = std::count_if(report.valves.begin(), report.valves.end(),
                                      [&](const LotReportValve& valve) { return valve.verdict == verdict; });
    if (*verdict == '\0' && valves == 0) continue;
    bars.push_back({.name = *verdict == '\0' ? "No verdict" : verdict,
                    .value = static_cast<double>(valves),
                    .text = std::to_string(valves)});
  }
  return drawn(bar_plot("Valves by verdict", bars));
}

/// What is said of a valve in one cell: a cause is named plainly only where it is settled.
std::string what_is_wrong(const LotReportValve& valve) {
  if (valve.conclusion == "unexplained") return "unexplained";
  if (valve.conclusion == "none") return "none";
  if (valve.cause.empty()) return valve.conclusion == "ambiguous" ? "not settled" : "–";
  const std::string cause = fmt::format("{}, {}", spoken(valve.cause), percent(valve.probability));
  return valve.conclusion == "ambiguous" ? "not settled: " + cause : cause;
}

/// Settled causes, most frequent first; what is not settled or not explained stands apart, for it is no cause.
std::string causes_part(const LotReport& report) {
  std::map<std::string, int> settled, apart;
  int named = 0;
  double expected_false = 0;  // what is missing to certainty, summed
  for (const LotReportValve& valve : report.valves) {
    if (valve.conclusion == "named") {
      ++settled[spoken(valve.cause)];
      ++named;
      expected_false += std::isfinite(valve.probability) ? 1 - valve.probability : 1;
    }
    if (valve.conclusion == "ambiguous") ++apart["Not settled"];
    if (valve.conclusion == "unexplained") ++apart["Unexplained"];
  }
  std::vector<Bar> bars;
  for (const auto& [cause, valves] : settled) {
    bars.push_back({.name = cause, .value = static_cast<double>(valves), .text = std::to_string(valves)});
  }
  std::stable_sort(bars.begin(), bars.end(), [](const Bar& a, const Bar& b) { return a.value > b.value; });
  for (const auto& [name, valves] : apart) {
    bars.push_back(
        {.name = name, .value = static_cast<double>(valves), .text = std::to_string(valves), .ink = Ink::kInput});
  }
  if (bars.empty()) return "<p>No valve of this lot has a cause.</p>\n";
  std::string body = drawn(bar_plot("Valves by settled cause", bars));
  if (named > 0) {
    body += fmt::format("<p class=\"small\">Names: {}. Expected to be false, by the probabilities given: {}.</p>\n",
                        named, expected_false < 0.1 ? "fewer than 0.1" : fmt::format("{:.2g}", expected_false));
  }
  return body;
}

std::string errors_part(const LotReport& report) {
  std::string body;
  for (const LotReportLevel& level : report.levels) {
    body +=
        drawn(individuals_plot(fmt::format("Error (Eq 20) at {:.1f} A", level.level_a), level.points, level.limits));
  }
  return body.empty() ? "<p>No valve of this lot was tested at a known level.</p>\n" : body;
}

std::string valves_part(const LotReport& report) {
  std::vector<Table::Column> columns{{"Serial"}, {"Received"}, {"Verdict"}, {"What is wrong"}};
  for (const LotReportLevel& level : report.levels) columns.push_back({fmt::format("{:.1f} A", level.level_a), true});
  columns.push_back({"Result (sha256)"});
  Table table(std::move(columns));
  for (const LotReportValve& valve : report.valves) {
    std::vector<std::string> cells{escaped(valve.serial.empty() ? "without serial" : valve.serial),
                                   escaped(valve.received_at), escaped(valve.verdict.empty() ? "–" : valve.verdict),
                                   escaped(what_is_wrong(valve))};
    for (const LotReportLevel& level : report.levels) {
      const auto error = valve.error_eq20.find(level.level_a);
      cells.push_back(error == valve.error_eq20.end() ? "–" : fmt::format("{:.3g}", error->second));
    }
    cells.push_back("<code>" + escaped(valve.result_sha256.substr(0, 16)) + "</code>");
    table.add_row(cells);
  }
  return table.markup() +
         "<p class=\"small\">The error (Eq 20) by current level; of each hash the first 16 digits.</p>\n";
}

std::string making_part(const LotReport& report) {
  std::set<std::string> makings;
  for (const LotReportValve& valve : report.valves) {
    if (valve.engine_version.empty()) continue;
    makings.insert(fmt::format("<li>valvetriage {}, settings (sha256) <code>{}</code></li>\n",
                               escaped(valve.engine_version), escaped(valve.settings_sha256)));
  }
  std::string body = "<ul>\n";
  for (const std::string& making : makings) body += making;
  return body + "</ul>\n";
}

}  // namespace

std::string lot_report_html(const LotReport& report) {
  const std::string title = "Lot " + report.lot;
  return html_page(
      title, fmt::format("<h1>{}</h1>\n<p>{} valves with a result, received {} to {}</p>\n", escaped(title),
                         report.valves.size(), escaped(report.first_received_at), escaped(report.last_received_at)) +
                 section("Verdicts", verdicts_part(report)) + section("Causes", causes_part(report)) +
                 section("Error over time", errors_part(report)) + section("Valves", valves_part(report)) +
                 section("How it was made", making_part(report)));
}

}  // namespace valvetriage::report
