#pragma once

#include <string>
#include <vector>

#include "tests/hidden_effects/alarms.h"

namespace valvetriage::hidden_effects {

/// The oracle: an observer who knows the noise, the population of good valves and the law of every cause, and pays for
/// the search. It holds the whitened data r (distances.h) against every signature of a cause's law,
///
///   z = max over the law's numbers of u · r,   u the whitened signature at unit length
///
/// and calls the cause seen where z is above the threshold that good valves exceed at the rate of the false alarms over
/// the number of causes (Bonferroni 1936). A cause whose own signature lies in the search is seen with probability
/// Φ(d − threshold) or more, so that nine in ten are seen from threshold + 1.28 on. Signatures are those of the nominal
/// unit, over the stand's range of sizes and five values of a second number; where a cause may have either sign, of
/// both. Tones have a free phase in each recording, one amplitude, and as many frequencies as the longest recording
/// tells apart between 0.5 and 45 Hz; hunting as many between 2 and 20 Hz at each of four levels.
///
/// Thresholds are quantiles of a million drawn good valves (of 2e5 for the instants of an intermittent contact, whose
/// tail is continued as that of independent signatures), those of tones by importance sampling. rectified_sensor is
/// left out: it hides in another machine.
std::vector<SearchOf> oracle(const std::vector<std::string>& tests);

}  // namespace valvetriage::hidden_effects
