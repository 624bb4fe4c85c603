#include "tests/contract/bad_inputs.h"

#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

namespace valvetriage {
namespace {

std::optional<std::size_t> number_or_nothing(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional<std::size_t>(std::stoul(text));
}

std::string text_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read " + file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

std::vector<BadInput> bad_inputs() {
  const std::string folder = VALVETRIAGE_BAD_INPUTS;
  std::istringstream table(text_of(folder + "/expected.csv"));
  std::string line;
  std::getline(table, line);
  std::vector<BadInput> inputs;
  while (std::getline(table, line)) {
    std::istringstream cells(line);
    BadInput input;
    std::string at_line, at_column;
    std::getline(cells, input.name, ',');
    std::getline(cells, input.code, ',');
    std::getline(cells, at_line, ',');
    std::getline(cells, at_column, ',');
    input.file = folder + "/" + input.name + ".csv";
    input.text = text_of(input.file);
    input.line = number_or_nothing(at_line);
    input.column = number_or_nothing(at_column);
    inputs.push_back(std::move(input));
  }
  return inputs;
}

}  // namespace valvetriage
