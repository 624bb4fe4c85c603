#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <string>
#include <vector>

#include "tests/hidden_effects/bench.h"

namespace valvetriage::hidden_effects {

/// What a cause adds to the output of the nominal unit [psi], one column for each choice of the numbers of its law: the
/// stand's range of sizes, five values of a second number, every 0.1 s for the instant of a contact.
struct Signatures {
  std::string cause;
  std::vector<Eigen::VectorXd> columns;
  bool either_sign;  ///< it may also take away
};
std::vector<Signatures> signatures(const TwinBench& bench);

/// A cause that adds a tone, with a phase of its own in each recording and one amplitude.
struct Tones {
  std::string cause;
  double low_hz, high_hz;
  double places;  ///< frequencies that the longest recording tells apart, at each level where it may begin
};
std::vector<Tones> searched_tones(const TwinBench& bench);

/// Of all that is searched: rectified_sensor hides in another machine.
std::size_t searched_causes();

}  // namespace valvetriage::hidden_effects
