#pragma once

namespace valvetriage {

/// The probability at which the contract calls a cause settled, where no rival stands beside it.
inline constexpr double kSettledProbability = 0.95;

}  // namespace valvetriage
