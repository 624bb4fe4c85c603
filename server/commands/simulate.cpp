#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/prepare.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/commands/recording_options.h"

namespace valvetriage {
namespace {

struct SimulateArguments {
  std::string model;
  std::string input;
  std::string output;
  std::size_t initial_samples = 0;
  bool finite_horizon = false;
  RecordingOptions recording;
};

/// A value between the grid's samples, straight between its neighbours.
double at_stamp(const std::vector<double>& values, double start_s, double period_s, double time_s) {
  const double at = std::clamp((time_s - start_s) / period_s, 0.0, static_cast<double>(values.size() - 1));
  const auto left = std::min(static_cast<std::size_t>(at), values.size() - 1);
  const auto right = std::min(left + 1, values.size() - 1);
  return values[left] + (at - static_cast<double>(left)) * (values[right] - values[left]);
}

Result<void> check_units(const Model& model, const Recording& recording) {
  const bool fits = model.input_unit.empty() || model.input_unit == recording.input.unit;
  if (fits) return {};
  return fail("units", fmt::format("the model's input is in {}, that of the file ({}) carries no current unit",
                                   model.input_unit, recording.input.name));
}

/// How many of the file's output units one unit of the model's output is.
double output_scale(const Model& model, const RawRecording& raw) {
  return model.output_unit == raw.output.unit ? 1 / raw.output.file_unit_scale : 1;
}

std::string rows_of(const RawRecording& raw, const Recording& recording, const std::vector<double>& simulated,
                    double scale) {
  const bool measured = !raw.output.values.empty();
  fmt::memory_buffer text;
  const auto out = fmt::appender(text);
  fmt::format_to(out, "time_s,input,output_simulated{}\n", measured ? ",output_measured" : "");
  for (std::size_t i = 0; i < raw.input.values.size(); ++i) {
    const double time_s = recording.time_s[i];
    const double y = at_stamp(simulated, recording.start_s, recording.sample_period_s, time_s);
    fmt::format_to(out, "{:.15g},{:.15g},{:.12g}", time_s, raw.input.values[i] / raw.input.file_unit_scale, y * scale);
    if (measured) fmt::format_to(out, ",{:.15g}", raw.output.values[i] / raw.output.file_unit_scale);
    fmt::format_to(out, "\n");
  }
  return fmt::to_string(text);
}

Result<std::string> simulate_file(const SimulateArguments& arguments) {
  auto model = open_model(arguments.model);
  if (!model) return tl::unexpected(model.error());
  auto options = read_options(arguments.recording);
  if (!options) return tl::unexpected(options.error());
  options->mapping.output_optional = true;
  auto raw = read_raw_recording_file(arguments.input, *options);
  if (!raw) return tl::unexpected(raw.error());
  auto recording = prepare_recording(*raw, options->mapping);
  if (!recording) return tl::unexpected(recording.error());
  if (auto checked = check_units(*model, *recording); !checked) return tl::unexpected(checked.error());
  if (arguments.initial_samples > 0 && raw->output.values.empty()) {
    return fail("no_output", "--initial-samples needs measured outputs, and the file has none");
  }
  InitialState initial;
  if (arguments.initial_samples > 0) {
    initial = {.kind = InitialState::Kind::kMeasured, .samples = arguments.initial_samples};
  }
  const Horizon horizon = arguments.finite_horizon ? Horizon::kFinite : Horizon::kUnbounded;
  const auto simulated = simulate_extended(*model, *recording, initial, horizon);
  if (!simulated) return tl::unexpected(simulated.error());
  return rows_of(*raw, *recording, *simulated, output_scale(*model, *raw));
}

ExitStatus run(const SimulateArguments& arguments) {
  const auto rows = simulate_file(arguments);
  if (!rows) return ended_by(rows.error());
  const auto written = write_output(arguments.output, *rows);
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_simulate_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("simulate", "Run a model on the input of a recording: what should have come out");
  auto arguments = std::make_shared<SimulateArguments>();
  verb->add_option("--model", arguments->model,
                   "Model: extended_model or baseline.model of an analysis, or an identify result")
      ->required();
  verb->add_option("--input", arguments->input, "Recording with the input; its output, where it has one, is put beside")
      ->required();
  verb->add_option("--initial-samples", arguments->initial_samples,
                   "Measured samples that set the initial state; 0: steady state at the first input")
      ->capture_default_str();
  verb->add_option("-o,--output", arguments->output, "CSV to write; standard output when not said");
  verb->add_flag("--finite-horizon", arguments->finite_horizon, "Run an unstable model on this record alone");
  add_column_options(*verb, arguments->recording);
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
