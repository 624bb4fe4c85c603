#include "server/wire/c_source.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace valvetriage {

std::string c_number(double value) {
  if (std::isinf(value)) return value > 0 ? "HUGE_VAL" : "-HUGE_VAL";
  const std::string text = fmt::format("{}", value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string c_numbers(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + c_number(value);
  return text.empty() ? "0" : text;
}

std::string c_define(std::string_view name, double value) {
  return fmt::format("#define {} ({})\n", name, c_number(value));
}

std::string c_count(std::string_view name, std::size_t value) {
  return fmt::format("#define {} {}\n", name, value);
}

std::string c_array(std::string_view name, std::span<const double> values) {
  return fmt::format("static const double {}[] = {{{}}};\n", name, c_numbers(values));
}

std::string filled(std::string_view text, std::span<const CMark> marks) {
  std::string result(text);
  for (const CMark& mark : marks) {
    const std::string place = "{" + mark.name + "}";
    for (auto at = result.find(place); at != std::string::npos; at = result.find(place, at + mark.text.size())) {
      result.replace(at, place.size(), mark.text);
    }
  }
  return result;
}

CMark parameter_mark(std::string_view name, double value) {
  const std::string text = c_number(value);
  return {std::string(name), value < 0 ? "(" + text + ")" : text};
}

void CLaws::add(const CLaw& law, std::string_view comment, std::span<const CMark> marks) {
  if (!law.state.empty()) state += fmt::format("  {}\n", filled(law.state, marks));
  code += fmt::format("  /* {} */\n", comment);
  // What a law begins with is the signal as the laws before it leave it.
  const bool has_lines = law.begin.find('\n') != std::string_view::npos;
  if (!law.begin.empty())
    code += fmt::format("  if (is_first) {{{}{}{}}}\n", has_lines ? "\n    " : " ", filled(law.begin, marks),
                        has_lines ? "\n  " : " ");
  code += fmt::format("  {}\n", filled(law.code, marks));
}

std::string called_functions(std::span<const CFunction> functions, std::string_view code) {
  std::string text;
  for (auto function = functions.rbegin(); function != functions.rend(); ++function) {
    const std::string call = std::string(function->name) + "(";
    const bool is_called = code.find(call) != std::string_view::npos || text.find(call) != std::string::npos;
    if (is_called) text.insert(0, function->text);
  }
  return text;
}

std::string c_head(const CHead& head) {
  constexpr std::string_view kText = R"c(/* {title}
 *
 * Written by valvetriage; self-contained C99, nothing allocated. One call of valvetriage_step per sample of {period} s:
 *   input    the {input} at this sample
 *   is_step  {is_step}
 *   side     {side}
 * valvetriage_start puts the model to rest at the first input; input_noise {input_noise}.
 * The first step is the first sample.{more}
 */
#include <math.h>
#include <stddef.h>

)c";
  return filled(kText, std::array{CMark{"title", head.title}, CMark{"period", fmt::format("{}", head.sample_period_s)},
                                  CMark{"input", head.input_unit == "A" ? "current in A" : "input"},
                                  CMark{"is_step", head.is_step}, CMark{"side", head.side},
                                  CMark{"input_noise", head.input_noise}, CMark{"more", head.more}});
}

const std::string_view kCInterface = R"c(
void valvetriage_start(valvetriage_model *m, double input, double input_noise);
double valvetriage_step(valvetriage_model *m, double input, int is_step, double side);
)c";

const std::string_view kCMain = R"c(
#ifdef VALVETRIAGE_MAIN
#include <stdio.h>
int main(void) {
  static valvetriage_model model;
  double input, side;
  int is_step, is_first = 1;
  while (scanf("%lf %d %lf", &input, &is_step, &side) == 3) {
    if (is_first) valvetriage_start(&model, input, 0);
    is_first = 0;
    printf("%.17g\n", valvetriage_step(&model, input, is_step, side));
  }
  return 0;
}
#endif
)c";

}  // namespace valvetriage
