#pragma once

#include <string>
#include <vector>

#include "tests/hidden_effects/alarms.h"

namespace valvetriage::hidden_effects {

/// An oracle that has to learn the population (oracle.h has the one that is told it): it knows noise, history, the law
/// of every cause and in which quantities θ of a unit good valves differ, but where their middle is and how far they
/// differ only from the θ of `good_valves` of them. With mean m, standard deviation s and n of these a new valve's is
/// Student's,
///
///   (θ − m) / (s √(1 + 1/n)) ~ t of n − 1 degrees of freedom,
///
/// so that an error twice as large costs it an ever smaller share more where it may be the valve's own. The search is
/// the same, by the likelihood ratio in place of the correlation,
///
///   z² = max over signatures u and a ≥ 0 of 2 ln [max over θ p(y − a u | θ) p(θ) / max over θ p(y | θ) p(θ)],
///
/// with the threshold that drawn good valves exceed, each beside a drawn reference (its tail continued as alarms.h has
/// it). d is that of distances.h: what is as far off in units of noise and population together; of faults d off those
/// are drawn that are about as far off by their own size. It is a bound of a kind: it knows the quantities of its good
/// valves without error, and one reference of eight may tell it more or less than the mean of all that are drawn.
/// Contacts and tones, of which the population makes little, are those of an observer who knows nothing of θ at all,
/// and sees them no better.
std::vector<SearchOf> learning_oracle(const std::vector<std::string>& tests, int good_valves);

}  // namespace valvetriage::hidden_effects
