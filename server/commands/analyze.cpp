#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "server/commands/analysis_arguments.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/commands/progress_line.h"
#include "server/commands/recording_options.h"
#include "server/jobs/analyze_session.h"
#include "server/report/sentence.h"
#include "server/wire/discrepancy_json.h"

namespace valvetriage {
namespace {

struct AnalyzeArguments {
  std::vector<std::string> files;
  AnalysisArguments compared;
  bool json = false;
  RecordingOptions recording;
};

std::string or_dash(const std::optional<double>& value, int decimals) {
  return value ? fmt::format("{:.{}f}", *value, decimals) : "-";
}

std::string verdict_line(const ClassificationResult& classification) {
  const std::string why = classification.explanation.empty() ? "" : fmt::format(": {}", classification.explanation);
  if (classification.verdict) return fmt::format("{} ({}){}", *classification.verdict, classification.action, why);
  return fmt::format("no verdict ({}){}", classification.action, why);
}

void append_levels(const Analysis& analysis, const std::string& unit, std::string& page) {
  if (analysis.simulation.by_level.empty()) return;
  const std::string rate = unit.empty() ? "" : unit + "/s";
  page += fmt::format("\n{:<9} {:<13} {:<22} {:<8} {:<13} {}\n", "level A", "Eq 20 " + rate, "settling error " + unit,
                      "rise s", "bandwidth Hz", "verdict");
  for (const LevelFigures& level : analysis.simulation.by_level) {
    const auto& judged = analysis.classification.per_level;
    const auto verdict = std::find_if(judged.begin(), judged.end(), [&](const LevelVerdict& candidate) {
      return candidate.level == level_name(level.level_a);
    });
    page += fmt::format("{:<9.3f} {:<13} {:<22} {:<8} {:<13} {}\n", level.level_a, or_dash(level.error_eq20, 3),
                        or_dash(level.settling_error, 3), or_dash(level.rise_time_s, 4), or_dash(level.bandwidth_hz, 4),
                        verdict == judged.end() ? "" : verdict->verdict);
  }
}

/// Of an output that does not change there is no fit: fit_figures gives −1e6 for minus infinity.
std::string fit_text(double fit_percent) {
  return fit_percent <= -1e6 ? "no fit: the output does not change" : fmt::format("fit {:.2f} %", fit_percent);
}

void append_recordings(const Analysis& analysis, std::string& page) {
  std::vector<std::size_t> by_name(analysis.recordings.size());
  for (std::size_t i = 0; i < by_name.size(); ++i) by_name[i] = i;
  std::sort(by_name.begin(), by_name.end(),
            [&](std::size_t a, std::size_t b) { return analysis.recordings[a].name < analysis.recordings[b].name; });
  page += "\n";
  for (const std::size_t i : by_name) {
    const RecordingSummary& recording = analysis.recordings[i];
    const RecordingFigures& figures = analysis.simulation.per_recording[i];
    page += fmt::format("{}: {}, {} samples at {:.6g} Hz, rmse {:.4g}, {}\n", recording.name, to_string(recording.test),
                        recording.samples, recording.sample_rate_hz, figures.rmse, fit_text(figures.fit_percent));
    for (const QualityItem& item : recording.quality) {
      page += fmt::format("  {} ({}): {}\n", item.code, item.count, item.detail);
    }
  }
}

/// The interval and not the standard error: it is the interval that also holds how far the law itself can be trusted.
std::string estimate_text(const ParameterEstimate& estimate) {
  std::string text = fmt::format("{:.4g}", estimate.value);
  if (!estimate.unit.empty()) text += " " + estimate.unit;
  const auto [low, high] = estimate.ci95;
  if (std::isfinite(low) && std::isfinite(high)) text += fmt::format(" (95 %: {:.4g} to {:.4g})", low, high);
  return text;
}

/// What the simulation gets wrong: the conclusion in a sentence, each cause with its rivals and parameters, the
/// held-out gain, whose fault it is and what to test next.
void append_discrepancy(const Analysis& analysis, const std::string& unit, std::string& page) {
  const Discrepancy& discrepancy = *analysis.discrepancy;
  page += fmt::format("Discrepancy {}\n", to_string(discrepancy.conclusion));
  const report::Summary summary = report::summarise(analysis);
  page += fmt::format("  {}\n", summary.discrepancy);
  for (const NamedCause& cause : discrepancy.causes) {
    page += fmt::format("  {} (probability {:.2f})", cause.cause, cause.probability);
    for (const std::string& rival : cause.alternatives) page += fmt::format(", or {}", rival);
    page += "\n";
    for (const auto& [name, estimate] : cause.parameters) {
      const std::string words = report::value_words(name, estimate, analysis.recordings);
      page += fmt::format("    {} {}\n", name, words.empty() ? estimate_text(estimate) : words);
    }
  }
  if (!discrepancy.causes.empty()) {
    page += fmt::format("  held out ({}): rmse {:.4g} {} becomes {:.4g} {}\n", discrepancy.gain.heldout,
                        discrepancy.gain.rmse_baseline, unit, discrepancy.gain.rmse_extended, unit);
  }
  for (const std::string& sentence : {summary.fault, summary.next_test}) {
    if (!sentence.empty()) page += fmt::format("  {}\n", sentence);
  }
  if (discrepancy.next_test && !discrepancy.next_test->input_csv.empty()) {
    page += "  Its current is in discrepancy.next_test.input_csv of --json.\n";
  }
}

/// A line per sweep: its transfer function and figures, or why there are none.
void append_responses(const Analysis& analysis, std::string& page) {
  if (analysis.frequency_response.empty()) return;
  page += "\n";
  for (const FrequencyResult& result : analysis.frequency_response) {
    const std::string& name = analysis.recordings[result.recordings.front()].name;
    const std::string more =
        result.recordings.size() > 1 ? fmt::format(" and {} repeats", result.recordings.size() - 1) : "";
    page += fmt::format("Response of {}{}: ", name, more);
    if (!result.refused.empty()) {
      page += result.refused + "\n";
      continue;
    }
    page += fmt::format("{} frequencies from {:.3g} to {:.3g} Hz", result.response.points.size(),
                        result.response.points.front().frequency_hz, result.response.points.back().frequency_hz);
    if (result.model) page += fmt::format(", order {}", result.model->transfer_function.poles.size());
    if (result.fit_percent) page += fmt::format(", fit {:.2f} %", *result.fit_percent);
    page += "\n ";
    for (const ResponseFeature& feature : result.features) {
      page += fmt::format(" {} {:.4g}", feature.name, feature.value);
    }
    page += "\n";
    if (result.amplitude_dependence) {
      page += fmt::format("  gain changes by {:.1f} % rms against an amplitude of {:.3g} (p {:.2g})\n",
                          100 * result.amplitude_dependence->change_rms, result.amplitude_dependence->amplitude_low,
                          result.amplitude_dependence->p_value);
    }
  }
  if (analysis.simulation.cross_domain_rmse) {
    page += fmt::format("Steps through the sweep's transfer function: rmse {:.4g} {}\n",
                        *analysis.simulation.cross_domain_rmse, analysis.baseline.model.output_unit);
  }
}

/// One page for a person: the verdict and why, the figures, what is odd about the recordings.
std::string page_of(const Analysis& analysis) {
  const std::string& unit = analysis.baseline.model.output_unit;
  std::string page = fmt::format("Verdict     {}\n", verdict_line(analysis.classification));
  page += fmt::format("Baseline    {}: {}\n", to_string(analysis.baseline.kind), analysis.baseline.reason);
  page += fmt::format("Simulation  rmse {:.4g} {}, noise floor {:.4g} {}, {}\n", analysis.simulation.rmse, unit,
                      analysis.simulation.noise_floor, unit, fit_text(analysis.simulation.fit_percent));
  if (analysis.discrepancy) {
    append_discrepancy(analysis, unit, page);
  } else {
    page += "Discrepancy not looked for\n";
  }
  append_levels(analysis, unit, page);
  append_responses(analysis, page);
  append_recordings(analysis, page);
  return page;
}

ExitStatus run(const AnalyzeArguments& arguments) {
  auto options = analysis_options(arguments.compared);
  if (!options) return ended_by(options.error());
  const auto reading = read_options(arguments.recording);
  if (!reading) return ended_by(reading.error());
  auto recordings = read_recordings(arguments.files, *reading);
  if (!recordings) return ended_by(recordings.error());
  const auto session = [&] {
    const ProgressLine progress;
    options->report = progress.stages();
    return analyze_session(std::move(*recordings), *options, reading->mapping);
  }();
  if (!session) return ended_by(session.error());
  const auto written =
      write_output("", arguments.json ? dump_json(session->document, true) + "\n" : page_of(session->analysis));
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_analyze_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand(
      "analyze", "Good, Malfunctioned or Severe: one valve's recordings together, compared with good valves");
  auto arguments = std::make_shared<AnalyzeArguments>();
  verb->add_option("FILE", arguments->files, "Recordings of one valve: CSV, JSON or MAT, also .gz and .zst")
      ->required();
  add_analysis_options(*verb, arguments->compared);
  verb->add_flag("--json", arguments->json, "Print the whole result as JSON (schemas/analysis.schema.json)");
  add_column_options(*verb, arguments->recording);
  add_metadata_options(*verb, arguments->recording);
  verb->callback([arguments, &exit_status] {
    keep_freed_memory();
    exit_status = run(*arguments);
  });
}

}  // namespace valvetriage
