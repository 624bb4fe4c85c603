#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/model/reference.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// A rising step of the input and the hold behind it, in one recording.
struct StepWindow {
  std::size_t recording = 0;  ///< index in the analysed set
  std::size_t begin = 0;      ///< sample at which the command first has its new value
  std::size_t end = 0;        ///< one past the last sample of the hold
  double level = 0;           ///< unit of the input
};

/// Whether the levels of two steps are one: less than 20 mA apart on valves that are played over 1 A or more, times the
/// scale of smaller ones' currents.
bool is_same_level(double a, double b, double current_scale);

/// A level as it is called: to 10 mA, on valves of a third of an ampere or less to a tenth of that, and so on.
double rounded_level(double level, double current_scale);

/// Rising steps of one recording, in time order.
std::vector<StepWindow> rising_steps(const Recording& recording, std::size_t recording_index);

/// The published error (paper Eq 20) on the step-aligned window:
///
///   error = √( Σ_{i=1}^{N} (X_R,i − X_S,i)² ) / t,    N = rate · duration samples from the step on, t = duration
///
/// It depends on rate and duration and cannot be converted afterwards, so both are fixed by `window` and measured and
/// simulated output are read at that rate (linear between samples).
///
/// returns  unit of the output per second; empty where the hold does not cover the duration, a sample in it is not
///          valid, or the recording is slower than the window's rate
std::optional<double> error_eq20(const Recording& recording, std::span<const double> simulated, const StepWindow& step,
                                 const Eq20Window& window);

/// |measured − simulated| on average over the last tenth of the window: how far off it settles [unit of the output].
std::optional<double> settling_error(const Recording& recording, std::span<const double> simulated,
                                     const StepWindow& step, const Eq20Window& window);

/// 10 to 90 % rise time of the measured response within the window [s]. Levels before and after are means (last ten
/// samples before the step, last tenth of the window); a crossing counts when a median of five has passed it. Empty
/// where the rise is not at least ten times `noise_rms`.
std::optional<double> measured_rise_time_s(const Recording& recording, const StepWindow& step, const Eq20Window& window,
                                           double noise_rms);

}  // namespace valvetriage
