#pragma once

#include <span>
#include <string>
#include <string_view>

namespace valvetriage {

/// The pieces that C99 files of `export` are written from.

/// A number as a constant of type double: what is whole keeps a point, for 1 / 8 is 0 in C.
std::string c_number(double value);
/// Numbers with commas between them; one 0 where there are none, for C99 has no empty array.
std::string c_numbers(std::span<const double> values);
std::string c_define(std::string_view name, double value);
std::string c_count(std::string_view name, std::size_t value);
std::string c_array(std::string_view name, std::span<const double> values);

/// `{name}` in a text, and what stands there in the file.
struct CMark {
  std::string name;
  std::string text;
};
std::string filled(std::string_view text, std::span<const CMark> marks);
/// The mark of a parameter, in brackets where it is below zero.
CMark parameter_mark(std::string_view name, double value);

/// What one law remembers, how that begins at the first sample, and its statements on `x`.
struct CLaw {
  std::string_view state;
  std::string_view begin;
  std::string_view code;
};

/// Laws one after the other in a function that knows `m`, `x` and `is_first`: members of the state, and statements.
struct CLaws {
  std::string state, code;
  void add(const CLaw& law, std::string_view comment, std::span<const CMark> marks);
};

/// A function that a file has where its code calls it; a list has those that are called before those that call them.
struct CFunction {
  std::string_view name;
  std::string_view text;
};
std::string called_functions(std::span<const CFunction> functions, std::string_view code);

/// The comment that a file begins with, and what it includes.
struct CHead {
  std::string title;
  double sample_period_s;
  std::string input_unit;
  std::string is_step, side, input_noise;  ///< what the arguments mean
  std::string more;                        ///< lines of the comment, each from its `\n *` on
};
std::string c_head(const CHead& head);

/// What every file declares and, compiled with VALVETRIAGE_MAIN, the filter that it is.
extern const std::string_view kCInterface;
extern const std::string_view kCMain;

}  // namespace valvetriage
