#pragma once

#include <array>
#include <optional>

#include "core/recording/recording.h"

namespace valvetriage {

/// A valve that sticks inside a regulated loop, as the loop's recording shows it. Forces in the input's own unit.
struct StickingLoop {
  double breakaway = 0, kinetic = 0;
  std::array<double, 2> breakaway_ci95{}, kinetic_ci95{};  ///< by the likelihood's ratio
  double log_gain = 0;  ///< log likelihood of the output given what the valve passes on, above that given the input
  double log_gain_play = 0;  ///< the same of the best law that does not jump
  double rest_share = 0;     ///< of the samples at which the valve stands
  int blocks = 0, won = 0;   ///< stretches of the recording, and those in which the valve foretells better
  double p_value = 1;        ///< over the stretches
};

/// Tells a sticking valve in a loop, where no free run can: a linear machine foretells the output through the
/// controller's answer. One step ahead the loop does no harm as long as the noise may have any colour (Ljung 1999,
/// section 13.4; for stiction Karra & Karim 2009): with na past outputs and nb = 10 past values of w,
///
///   y_t = c + Σ a_k y_{t−k} + Σ b_k w_{t−k} + e_t,   k ≥ 1,
///
/// is fitted with w the recorded input and with w what a valve of breakaway f_s and kinetic force f_d passes on of it
/// (Chen, Tan & Huang 2008; He et al. 2007), (f_s, f_d) by search. Disturbances that are not Gaussian (load steps,
/// pulses, periodic waves of any shape, a rounded reading) let a memory foretell better than any linear sum, too. What
/// tells a valve from them, all of it asked for:
///   - the gain in log likelihood is beyond what the search finds in linear loops, in most stretches of the recording;
///   - it is the recorded input that drives the memory: the same law on the input behind a lag, on the controller's
///     integral alone, on the input with its proportional part reversed and on the output gains clearly less;
///   - the input adds nothing to what the valve passes on (Davidson & MacKinnon 1981);
///   - nor does a periodic wave with seven harmonics at the loop's strongest line;
///   - the process answers the valve in the sense in which the controller acts;
///   - the valve rests, and moves in both senses.
/// Empty where one of them fails, or where there are fewer than 250 samples. Of long recordings the first 5000 count.
///
/// recording  of a loop, one sample time
/// Cost       O(n), about 10000 small regressions, six times that where the gain is there; deterministic
std::optional<StickingLoop> sticking_loop(const Recording& recording);

}  // namespace valvetriage
