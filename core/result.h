#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <tl/expected.hpp>

namespace valvetriage {

/// What the caller or the world got wrong: enough to fix it without reading the source.
///
/// code      stable, snake_case, the `code` of the problem document (`not_a_number`, `missing_column`)
/// message   one sentence: "line 214, column 2 (current_A): 'n/a' is not a number"
/// file      name of the input the error is in, empty where there is none
/// line      1-based line in the expanded text
/// column    1-based column (field) of that line
/// field     name of the column, option or JSON pointer
/// found     what stood there
/// expected  what would have been right
struct Error {
  std::string code{};
  std::string message{};
  std::string file{};
  std::optional<std::size_t> line{};
  std::optional<std::size_t> column{};
  std::string field{};
  std::string found{};
  std::string expected{};
};

/// A value, or an Error. Numerics that did not converge are values with a termination, not Errors.
template <typename T>
using Result = tl::expected<T, Error>;

/// Shorthand for an Error without a position.
inline tl::unexpected<Error> fail(std::string code, std::string message) {
  return tl::unexpected<Error>(Error{.code = std::move(code), .message = std::move(message)});
}

}  // namespace valvetriage
