#include "server/report/valve_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/classify/rule_base.h"
#include "server/report/markup.h"
#include "server/report/sentence.h"

namespace valvetriage::report {
namespace {

std::string figure_of(const std::optional<double>& value) {
  return value ? figure(*value) : "–";
}

std::string paragraph(const std::string& text, const char* kind = "") {
  return text.empty() ? std::string() : fmt::format("<p{}>{}</p>\n", kind, escaped(text));
}

std::string section(const char* title, const std::string& body) {
  return body.empty() ? std::string() : fmt::format("<section>\n<h2>{}</h2>\n{}</section>\n", title, body);
}

std::string figure_of(const std::string& svg, const std::string& caption) {
  return fmt::format("<figure>\n{}<figcaption>{}</figcaption>\n</figure>\n", svg, escaped(caption));
}

std::string subject_table(const ReportSubject& subject) {
  std::string rows;
  for (const auto& [name, value] :
       {std::pair("Serial", &subject.serial), std::pair("Lot", &subject.lot),
        std::pair("Valve type", &subject.valve_type), std::pair("Stand", &subject.stand),
        std::pair("Condition", &subject.condition), std::pair("Received", &subject.received_at)}) {
    if (!value->empty()) rows += fmt::format("<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n", name, escaped(*value));
  }
  return rows.empty() ? rows : "<table>\n" + rows + "</table>\n";
}

std::string level_table(const Simulation& simulation, const std::string& unit) {
  if (simulation.by_level.empty()) return {};
  const bool has_bandwidth = std::any_of(simulation.by_level.begin(), simulation.by_level.end(),
                                         [](const LevelFigures& level) { return level.bandwidth_hz.has_value(); });
  std::vector<Table::Column> columns{{"Level [A]", true},
                                     {escaped(unit.empty() ? "Error (Eq 20)" : "Error (Eq 20) [" + unit + "/s]"), true},
                                     {escaped("Settling error [" + unit + "]"), true},
                                     {"Rise time [s]", true}};
  if (has_bandwidth) columns.push_back({"Bandwidth [Hz]", true});
  Table table(std::move(columns));
  for (const LevelFigures& level : simulation.by_level) {
    std::vector<std::string> row{fmt::format("{:.2f}", level.level_a), figure_of(level.error_eq20),
                                 figure_of(level.settling_error), figure_of(level.rise_time_s)};
    if (has_bandwidth) row.push_back(figure_of(level.bandwidth_hz));
    table.add_row(row);
  }
  return table.markup();
}

/// "1.8 A", and of the paper's levels "1.4 A (low)".
std::string level_words(const std::string& name) {
  const auto level_a = level_from_name(name);
  if (!level_a) return name;
  const bool is_number = !name.empty() && (std::isdigit(static_cast<unsigned char>(name[0])) != 0);
  return fmt::format("{:.1f} A{}", *level_a, is_number ? "" : " (" + name + ")");
}

std::string rule_list(const ClassificationResult& result) {
  std::string list;
  for (const LevelVerdict& level : result.per_level) {
    for (const auto& [rule, strength] : level.rules) {
      if (!(strength > 0)) continue;
      list += fmt::format("<li>{}: {} (strength {})</li>\n", escaped(level_words(level.level)), escaped(rule),
                          figure(strength));
    }
  }
  return list.empty() ? list : "<h3>Rules that fired</h3>\n<ul>\n" + list + "</ul>\n";
}

std::string verdict_part(const Analysis& analysis, const Summary& summary) {
  const ClassificationResult& result = analysis.classification;
  std::vector<Bar> bars;
  double sum = 0;
  for (const auto& [name, value] : result.memberships) {
    bars.push_back({.name = name, .value = value, .text = figure(value)});
    sum += value;
  }
  std::string body =
      paragraph(result.verdict.value_or("No verdict"), " class=\"verdict\"") + paragraph(summary.verdict);
  if (sum > 0) body += figure_of(bar_plot("Membership of each verdict", bars), "Membership, worst level");
  return body + level_table(analysis.simulation, analysis.baseline.model.output_unit) + rule_list(result);
}

std::string parameter_table(const NamedCause& cause, const std::vector<RecordingSummary>& recordings) {
  if (cause.parameters.empty()) return {};
  Table table(
      {{"Parameter"}, {"Value", true}, {"Standard error", true}, {"95 % interval", true}, {"Good valves", true}});
  for (const auto& [name, p] : cause.parameters) {
    const std::string words = value_words(name, p, recordings);
    const EstimateWords told = estimate_words(p);
    const bool known = std::isfinite(p.population_mean);
    table.add_row({"<code>" + escaped(name) + "</code>", escaped(words.empty() ? told.value : words),
                   escaped(told.error), told.interval.empty() ? "–" : escaped(told.interval),
                   known ? escaped(with_deviation(p.population_mean, p.population_sd, p.unit)) : "–"});
  }
  return table.markup();
}

std::string cause_part(const NamedCause& cause, const std::string& sentence,
                       const std::vector<RecordingSummary>& recordings) {
  std::string body = fmt::format("<h3>{}</h3>\n", escaped(spoken(cause.cause))) + paragraph(sentence) +
                     parameter_table(cause, recordings);
  if (cause.evidence.empty()) return body;
  body += "<ul>\n";
  for (const std::string& line : cause.evidence) body += fmt::format("<li>{}</li>\n", escaped(line));
  return body + "</ul>\n";
}

std::string gain_figure(const Discrepancy& discrepancy, const std::string& unit) {
  const DiscrepancyGain& gain = discrepancy.gain;
  std::vector<Bar> bars;
  for (const auto& [name, value, ink] : {std::tuple("simulation", gain.rmse_baseline, Ink::kSimulated),
                                         std::tuple("with the causes", gain.rmse_extended, Ink::kExtended),
                                         std::tuple("best black box", gain.rmse_black_box, Ink::kInput),
                                         std::tuple("noise alone", gain.noise_floor, Ink::kInput)}) {
    if (std::isfinite(value)) bars.push_back({.name = name, .value = value, .text = quantity(value, unit), .ink = ink});
  }
  if (discrepancy.causes.empty() || bars.empty()) return {};
  return figure_of(bar_plot("Error of the simulation before and after", bars),
                   "Error on data that was not fitted: " + gain.heldout);
}

std::string discrepancy_part(const Analysis& analysis, const Summary& summary) {
  std::string body =
      paragraph(summary.discrepancy + (summary.fault.empty() ? "" : " " + summary.fault), " class=\"said\"");
  if (!analysis.discrepancy) return body;
  const Discrepancy& found = *analysis.discrepancy;
  for (std::size_t i = 0; i < found.causes.size(); ++i) {
    body += cause_part(found.causes[i], summary.causes[i], analysis.recordings);
  }
  body +=
      gain_figure(found, analysis.baseline.model.output_unit) + paragraph(summary.gain) + paragraph(summary.next_test);
  if (summary.upper_limits.empty()) return body;
  body += "<h3>What these recordings exclude</h3>\n<ul>\n";
  for (const std::string& limit : summary.upper_limits) body += fmt::format("<li>{}</li>\n", escaped(limit));
  return body + "</ul>\n";
}

std::string quality_list(const Analysis& analysis, const std::string& name) {
  std::string list;
  for (const RecordingSummary& recording : analysis.recordings) {
    if (recording.name != name) continue;
    for (const QualityItem& item : recording.quality) {
      list += fmt::format("<li>{} ({}): {}</li>\n", escaped(spoken(item.code)), item.count, escaped(item.detail));
    }
  }
  return list.empty() ? list : "<ul>\n" + list + "</ul>\n";
}

std::string recordings_part(const ValveReport& report) {
  std::string body;
  for (const RecordingPlot& plot : report.plots) {
    body += fmt::format("<h3>{}</h3>\n", escaped(plot.name));
    body +=
        plot.panels.empty()
            ? paragraph(plot.reason)
            : figure_of(time_plot(plot.name + ": output, residual and input over time", plot.panels, plot.stretches),
                        plot.name);
    body += quality_list(report.analysis.analysis, plot.name);
  }
  return body;
}

std::string making_part(const AnalysisDocument& document) {
  const Baseline& baseline = document.analysis.baseline;
  const ClassificationResult& result = document.analysis.classification;
  std::string table = "<table>\n";
  const auto row = [&](const char* name, const std::string& value) {
    if (!value.empty())
      table += fmt::format("<tr><th scope=\"row\">{}</th><td><code>{}</code></td></tr>\n", name, escaped(value));
  };
  row("Engine", "valvetriage " + document.making.engine_version);
  row("Settings (sha256)", document.making.settings_sha256);
  row("Result (sha256)", document.result_sha256);
  row("Baseline", baseline.reason);
  if (baseline.reference) row("Reference (sha256)", baseline.reference->sha256);
  if (!result.rule_base_name.empty()) {
    row("Rule base", fmt::format("{}, version {}, sha256 {}", result.rule_base_name, result.rule_base_version,
                                 result.rule_base_sha256));
  }
  table += "</table>\n<h3>Input files</h3>\n";
  Table files({{"Name"}, {"Samples", true}, {"Rate [Hz]", true}, {"Test"}, {"sha256"}});
  for (const RecordingSummary& recording : document.analysis.recordings) {
    files.add_row({escaped(recording.name), std::to_string(recording.samples), figure(recording.sample_rate_hz),
                   to_string(recording.test), "<code>" + escaped(recording.sha256) + "</code>"});
  }
  return table + files.markup() +
         paragraph("The same files, engine version and settings give the same result hash.", " class=\"small\"");
}

}  // namespace

std::string valve_report_html(const ValveReport& report) {
  const Analysis& analysis = report.analysis.analysis;
  const Summary summary = summarise(analysis);
  const std::string title = report.subject.serial.empty() ? "Valve" : "Valve " + report.subject.serial;
  return html_page(title, fmt::format("<h1>{}</h1>\n", escaped(title)) + subject_table(report.subject) +
                              section("Verdict", verdict_part(analysis, summary)) +
                              section("What the simulation gets wrong", discrepancy_part(analysis, summary)) +
                              section("Recordings", recordings_part(report)) +
                              section("How it was made", making_part(report.analysis)));
}

}  // namespace valvetriage::report
