#pragma once

#include <rapidcheck.h>

#include <complex>
#include <random>
#include <vector>

#include "core/model/transfer_function.h"

namespace valvetriage {

/// A stable strictly proper continuous system of order 1 to 9, corners 1 to 60 rad/s, some of them pairs.
inline TransferFunction random_continuous(unsigned seed, int order) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> corner(1, 60), damping(0.2, 1.0);
  TransferFunction g{.domain = Domain::kS};
  while (static_cast<int>(g.poles.size()) < order) {
    const double w = corner(random);
    if (order - static_cast<int>(g.poles.size()) >= 2 && random() % 2 == 0) {
      const double zeta = damping(random);
      g.poles.emplace_back(-zeta * w, w * std::sqrt(1 - zeta * zeta));
      g.poles.push_back(std::conj(g.poles.back()));
    } else {
      g.poles.emplace_back(-w, 0);
    }
  }
  for (int zeros = order / 3; zeros > 0; --zeros) g.zeros.emplace_back(-corner(random), 0);
  g.gain = 1;
  g.gain = 94 / static_gain(g);
  return g;
}

}  // namespace valvetriage
