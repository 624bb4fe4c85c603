#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "tests/second_stand/random.h"

namespace valvetriage::second_stand {

/// Noise of a channel: a broad part (white, or coloured by one pole), a 1/f part (five Ornstein-Uhlenbeck processes an
/// octave and a half apart in time: Van der Ziel 1950) and, now and then, a sample of another size.
class ChannelNoise {
 public:
  struct Kind {
    double broad = 0, flicker = 0;         ///< rms
    double colour_s = 0;                   ///< of the broad part
    double tail_share = 0, tail_size = 1;  ///< samples whose broad part is so many times as large
  };

  ChannelNoise(Random random, const Kind& kind, double period_s)
      : random_(random), kind_(kind), broad_(random_.normal()) {
    broad_kept_ = kind.colour_s > 0 ? std::exp(-period_s / kind.colour_s) : 0;
    double memory_s = 0.04;
    for (std::size_t i = 0; i < flicker_.size(); ++i, memory_s *= 4) {
      kept_[i] = std::exp(-period_s / memory_s);
      flicker_[i] = random_.normal();
    }
  }

  double next() {
    broad_ = broad_kept_ * broad_ + std::sqrt(1 - broad_kept_ * broad_kept_) * random_.normal();
    double slow = 0;
    for (std::size_t i = 0; i < flicker_.size(); ++i) {
      flicker_[i] = kept_[i] * flicker_[i] + std::sqrt(1 - kept_[i] * kept_[i]) * random_.normal();
      slow += flicker_[i];
    }
    const double size = random_.chance(kind_.tail_share) ? kind_.tail_size : 1;
    return kind_.broad * size * broad_ + kind_.flicker * slow / std::sqrt(static_cast<double>(flicker_.size()));
  }

 private:
  Random random_;
  Kind kind_;
  double broad_, broad_kept_ = 0;
  std::array<double, 5> flicker_{}, kept_{};
};

/// What the cables pick up from the mains: 50 Hz and a little of its third harmonic, of an amplitude that hangs on the
/// day. At 200 Hz the third folds back onto 50 Hz.
class MainsPickUp {
 public:
  MainsPickUp(Random random, double usual_psi)
      : amplitude_psi_(usual_psi * std::exp(0.5 * random.inspected())),
        phase_(random.between(0, 2 * std::numbers::pi)) {}
  double at(double t_s) const {
    const double turn = 2 * std::numbers::pi * 50 * t_s + phase_;
    return amplitude_psi_ * (std::sin(turn) + 0.3 * std::sin(3 * turn));
  }

 private:
  double amplitude_psi_, phase_;
};

}  // namespace valvetriage::second_stand
