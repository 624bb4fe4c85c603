#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>

namespace valvetriage::report {

/// One valve's size of a cause; an interval that is not finite is not drawn.
struct SizedMark {
  double value = 0, low = 0, high = 0;
};

/// Sizes over one axis, the smallest at the bottom, each with its interval; `band` shows where good valves are.
std::string sizes_plot(const std::string& title, std::span<const SizedMark> marks,
                       const std::optional<std::array<double, 2>>& band);

}  // namespace valvetriage::report
