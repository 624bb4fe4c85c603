#pragma once

#include <cmath>

#include "core/recording/recording.h"

namespace valvetriage {

/// Of a jittering clock a few thousand stamps tell the period to a ten-thousandth. What is identified in samples is off
/// by no more than the periods are.
inline constexpr double kSameRate = 1e-3;

/// Whether what is fitted in samples may be fitted to both recordings together.
inline bool have_same_rate(const Recording& a, const Recording& b) {
  return std::abs(a.sample_period_s - b.sample_period_s) <= kSameRate * b.sample_period_s;
}

}  // namespace valvetriage
