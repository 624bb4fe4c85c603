#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/analysis/paper_check.h"
#include "core/model/paper_models.h"
#include "server/commands/commands.h"
#include "server/report/bode_text.h"
#include "server/wire/paper_json.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

using Cells = std::array<std::string_view, 4>;

// Characters; together with three gaps of two, 120 columns.
constexpr std::array<std::size_t, 4> kWidths{11, 27, 42, 34};

// Characters of UTF-8: bytes that do not continue one.
std::size_t width_of(std::string_view text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::vector<std::string> wrapped(std::string_view text, std::size_t width) {
  std::vector<std::string> lines(1);
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (!lines.back().empty() && width_of(lines.back()) + 1 + width_of(word) > width) lines.emplace_back();
    if (!lines.back().empty()) lines.back() += ' ';
    lines.back() += word;
  }
  return lines;
}

void print_row(const Cells& cells) {
  std::array<std::vector<std::string>, 4> columns;
  std::size_t height = 0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    columns[c] = wrapped(cells[c], kWidths[c]);
    height = std::max(height, columns[c].size());
  }
  for (std::size_t row = 0; row < height; ++row) {
    std::string line;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const std::string cell = row < columns[c].size() ? columns[c][row] : "";
      line += cell + std::string(kWidths[c] + 2 - std::min(kWidths[c], width_of(cell)), ' ');
    }
    line.erase(line.find_last_not_of(' ') + 1);
    fmt::print("{}\n", line);
  }
}

void print_table(const std::vector<PaperLine>& lines) {
  print_row({"where", "as printed", "recomputed", "what does not hold"});
  for (const PaperLine& line : lines) {
    fmt::print("\n");
    print_row({line.where, line.as_printed, line.recomputed, line.does_not_hold});
  }
}

/// Eqs 16 and 17 with the quadratics cancelled: their damping ratios are not printed, so nothing is drawn that needs
/// them.
void print_bode_figure() {
  fmt::print("\nEqs 16 and 17 as a Bode figure: gain over angular frequency, both in the paper's own unit\n\n{}",
             report::bode_text({{"good valve (Eq 16)", 'g', cancelled(kPaperEquation16)},
                                {"returned valve (Eq 17): decays first", 'r', cancelled(kPaperEquation17)}},
                               0.1, 100, -60));
}

ExitStatus run(bool json) {
  const auto paper = embedded_rule_base("paper"), calibrated = embedded_rule_base("calibrated");
  if (!paper || !calibrated) {
    print_error(paper ? calibrated.error() : paper.error());
    return kFailure;
  }
  const std::vector<PaperLine> lines = check_paper(*paper, *calibrated);
  if (json) {
    fmt::print("{}\n", dump_json(to_json(lines), true));
  } else {
    print_table(lines);
    print_bode_figure();
  }
  return kDone;
}

}  // namespace

void add_paper_command(CLI::App& app, int& exit_status) {
  CLI::App* verb =
      app.add_subcommand("paper", "The published equations and tables, recomputed, with what does not hold");
  const auto json = std::make_shared<bool>(false);
  verb->add_flag("--json", *json, "The same as JSON, with the figures behind each line");
  verb->callback([&exit_status, json] { exit_status = run(*json); });
}

}  // namespace valvetriage
