#include <memory>

#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

struct ExportArguments {
  std::string model;
  std::string format = "json";
  std::string output;
};

ExitStatus run(const ExportArguments& arguments) {
  const auto model = open_model(arguments.model);
  if (!model) return ended_by(model.error());
  const auto written = write_output(arguments.output, dump_json(to_json(*model), true) + "\n");
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_export_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("export", "A model in a form for other tools");
  auto arguments = std::make_shared<ExportArguments>();
  verb->add_option("--model", arguments->model, "Model of an analysis, or an identify result")->required();
  verb->add_option("--format", arguments->format, "json: the model document, complete and by itself")
      ->check(CLI::IsMember({"json"}))
      ->capture_default_str();
  verb->add_option("-o,--output", arguments->output, "File to write; standard output when not said");
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
