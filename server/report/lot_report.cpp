#include "server/report/lot_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/classify/q_values.h"
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

/// Below 0.001 more digits mean nothing.
std::string q_text(double q) {
  return q < 0.001 ? "q < 0.001" : fmt::format("q {:.2g}", q);
}

/// What is said of a valve in one cell: a cause is named plainly only where it is settled.
std::string what_is_wrong(const LotReportValve& valve) {
  std::string said;
  for (const LotReportName& name : valve.names) {
    said += fmt::format("{}{}, {} ({})", said.empty() ? "" : "; ", spoken(name.cause), percent(name.probability),
                        q_text(name.q_value));
  }
  if (!said.empty()) return said;
  if (valve.conclusion == "unexplained" || valve.conclusion == "none") return valve.conclusion;
  if (valve.conclusion != "ambiguous") return "–";
  if (valve.likely.empty()) return "not settled";
  return fmt::format("not settled: {}, {}", spoken(valve.likely), percent(valve.likely_probability));
}

std::string few(double expected) {
  return expected < 0.1 ? "fewer than 0.1" : fmt::format("{:.2g}", expected);
}

/// Settled causes, most frequent first, a valve with each of its own; what is not settled or not explained stands
/// apart, for it is no cause.
std::string causes_part(const LotReport& report) {
  std::map<std::string, int> settled, apart;
  std::vector<double> probabilities;
  double largest_q = 0;
  for (const LotReportValve& valve : report.valves) {
    for (const LotReportName& name : valve.names) {
      ++settled[spoken(name.cause)];
      probabilities.push_back(name.probability);
      largest_q = std::max(largest_q, name.q_value);
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
  if (!probabilities.empty()) {
    body += fmt::format(
        "<p class=\"small\">Names: {}. Expected to be false, by the probabilities given: {} ({} for all of them "
        "together). The q-value beside a name is the share of false ones expected among the names at least as sure as "
        "it.</p>\n",
        probabilities.size(), few(expected_false(probabilities)), q_text(largest_q));
  }
  return body;
}

std::string errors_part(const LotReport& report) {
  std::string body;
  for (const LotReportLevel& level : report.levels) {
    body += drawn(
        individuals_plot(fmt::format("Error (Eq 20) at {:.1f} A [psi/s]", level.level_a), level.points, level.limits));
  }
  return body.empty() ? "<p>No valve of this lot was tested at a known level.</p>\n" : body;
}

/// Serials that a pattern names, and patterns that are drawn: the page lists them all.
constexpr std::size_t kNamedSerials = 100;
constexpr std::size_t kShownGroups = 20;

/// What all valves of the lot share, with every figure that was compared.
std::string shifts_part(const LotShifts& shifts) {
  std::string body;
  for (const std::string& sentence : shift_sentences(shifts)) {
    body += "<p class=\"said\">" + escaped(sentence) + "</p>\n";
  }
  body += "<p>" + escaped(shift_scope(shifts)) + "</p>\n";
  if (shifts.figures.empty()) return body;
  Table table({{"Figure"}, {"Good valves", true}, {"Lot", true}, {"Shift", true}, {"95 %", true}, {"p, paid", true}});
  for (const FigureShift& found : shifts.figures) {
    const std::string& unit = found.figure.unit;
    const auto [low, high] = found.difference_ci95();
    table.add_row({escaped(figure_words(found.figure)), escaped(quantity(found.good_mean(), unit)),
                   escaped(quantity(found.lot_mean(), unit)), escaped(quantity(found.difference(), unit)),
                   escaped(quantity(low, unit) + " to " + quantity(high, unit)),
                   fmt::format("{:.2g}", found.p_adjusted)});
  }
  return body + table.markup();
}

std::string joined(const std::vector<std::string>& serials) {
  std::string list;
  const std::size_t shown = std::min(serials.size(), kNamedSerials);
  for (std::size_t i = 0; i < shown; ++i) list += (list.empty() ? "" : ", ") + escaped(serials[i]);
  if (shown < serials.size()) list += fmt::format(" and {} more", serials.size() - shown);
  return list;
}

/// Unexplained valves that leave the same residual, and those that are like no other.
std::string patterns_part(const PatternsShown& patterns) {
  if (patterns.unexplained == 0) return "<p>No valve of this lot is unexplained.</p>\n";
  const std::string of = patterns.compared < patterns.unexplained ? fmt::format("{} of ", patterns.compared) : "";
  std::string body = fmt::format("<p>The residuals over time of {}{} that no cause explains were compared.{}</p>\n", of,
                                 counted(patterns.unexplained, "valve"),
                                 patterns.groups.empty() ? " No two of them leave the same." : "");
  const std::size_t shown = std::min(patterns.groups.size(), kShownGroups);
  for (std::size_t i = 0; i < shown; ++i) {
    const PatternShown& group = patterns.groups[i];
    const std::string title = fmt::format("Pattern {}: {}", i + 1, counted(group.members.size(), "valve"));
    body += fmt::format("<h3>{}</h3>\n<p>{}</p>\n", title, joined(group.members)) +
            drawn(time_plot(title + ", mean residual over time", group.panels));
  }
  if (shown < patterns.groups.size()) {
    body += fmt::format("<p>And {}.</p>\n", counted(patterns.groups.size() - shown, "smaller pattern"));
  }
  if (patterns.alone.empty()) return body;
  return body + fmt::format("<p>{}{}.</p>\n",
                            patterns.groups.empty() ? "They are: " : "Like no other: ", joined(patterns.alone));
}

/// A stamp in RFC 3339 to the minute, with a space where a narrow column may break it: "2026-08-03 09:12".
std::string to_the_minute(std::string stamp) {
  if (const auto at = stamp.find('T'); at != std::string::npos) stamp[at] = ' ';
  return stamp.substr(0, 16);
}

std::string valves_part(const LotReport& report) {
  std::vector<Table::Column> columns{{"Serial"}, {"Received (UTC)"}, {"Verdict"}, {"What is wrong"}};
  for (const LotReportLevel& level : report.levels) columns.push_back({fmt::format("{:.1f} A", level.level_a), true});
  columns.push_back({"Result (sha256)"});
  Table table(std::move(columns));
  for (const LotReportValve& valve : report.valves) {
    std::vector<std::string> cells{escaped(valve.serial.empty() ? "without serial" : valve.serial),
                                   escaped(to_the_minute(valve.received_at)),
                                   escaped(valve.verdict.empty() ? "–" : valve.verdict), escaped(what_is_wrong(valve))};
    for (const LotReportLevel& level : report.levels) {
      const auto error = valve.error_eq20.find(level.level_a);
      cells.push_back(error == valve.error_eq20.end() ? "–" : figure(error->second));
    }
    cells.push_back("<code>" + escaped(valve.result_sha256.substr(0, 16)) + "</code>");
    table.add_row(cells);
  }
  return table.markup() +
         "<p class=\"small\">The error (Eq 20) in psi/s by current level; of each hash the first 16 digits.</p>\n";
}

/// Of a larger lot the hashes stand in each valve's own report: here they would be a book.
constexpr std::size_t kListedValves = 200;

std::string inputs_part(const LotReport& report) {
  if (report.valves.size() > kListedValves) {
    return "<p>The hash of each input file stands in the report of its valve.</p>\n";
  }
  Table table({{"Serial"}, {"Name"}, {"sha256"}});
  for (const LotReportValve& valve : report.valves) {
    for (const auto& [name, sha256] : valve.inputs) {
      table.add_row({escaped(valve.serial.empty() ? "without serial" : valve.serial), escaped(name),
                     "<code>" + escaped(sha256) + "</code>"});
    }
  }
  return table.markup() +
         "<p class=\"small\">The same files, engine version and settings give the same result hashes.</p>\n";
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
  return html_page(title, fmt::format("<h1>{}</h1>\n<p>{} with a result, received {} to {}</p>\n", escaped(title),
                                      counted(report.valves.size(), "valve"), escaped(report.first_received_at),
                                      escaped(report.last_received_at)) +
                              section("Verdicts", verdicts_part(report)) + section("Causes", causes_part(report)) +
                              section("Error over time", errors_part(report)) +
                              section("Sizes of the causes", sizes_markup(report.sizes)) +
                              section("Patterns that no cause explains", patterns_part(report.patterns)) +
                              section("What all valves share", shifts_part(report.shifts)) +
                              section("Valves", valves_part(report)) + section("How it was made", making_part(report)) +
                              section("Input files", inputs_part(report)));
}

}  // namespace valvetriage::report
