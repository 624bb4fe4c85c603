#include <memory>

#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/wire/model_c.h"
#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

struct ExportArguments {
  std::string model;
  std::string format = "json";
  std::string output;
  double sample_rate_hz = 0;
};

constexpr double kStandRate_hz = 200;

/// The rate that was asked for, else that of the model itself, else the stand's.
double sample_period_s(const ExportArguments& arguments, const Model& model) {
  if (arguments.sample_rate_hz > 0) return 1 / arguments.sample_rate_hz;
  if (model.machine) return model.machine->sample_period_s;
  return model.dynamics.domain == Domain::kZ ? model.dynamics.sample_time_s : 1 / kStandRate_hz;
}

Result<std::string> text_of(const ExportArguments& arguments) {
  const auto model = open_model(arguments.model);
  if (!model) return tl::unexpected(model.error());
  if (arguments.format == "c") return to_c(*model, sample_period_s(arguments, *model));
  return dump_json(to_json(*model), true) + "\n";
}

ExitStatus run(const ExportArguments& arguments) {
  const auto text = text_of(arguments);
  if (!text) return ended_by(text.error());
  const auto written = write_output(arguments.output, *text);
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_export_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("export", "A model in a form for other tools");
  auto arguments = std::make_shared<ExportArguments>();
  verb->add_option("--model", arguments->model, "Model of an analysis, or an identify result")->required();
  verb->add_option(
          "--format", arguments->format,
          "json: the model document, complete and by itself; c: one C99 file that simulates it, one call per sample")
      ->check(CLI::IsMember({"c", "json"}))
      ->capture_default_str();
  verb->add_option(
          "--sample-rate-hz", arguments->sample_rate_hz,
          "Rate of the C file's samples; that of a discrete model or a machine, else 200, when not said. A machine "
          "has no other")
      ->check(CLI::PositiveNumber);
  verb->add_option("-o,--output", arguments->output, "File to write; standard output when not said");
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
