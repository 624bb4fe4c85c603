#pragma once

#include <cmath>

namespace valvetriage::stand {

/// LuGre friction: bristles that bend while stuck and slip along the Stribeck curve.
///
///   df/dt = σ0 (v − |v| f / g(v))      g(v) = F_c + (F_s − F_c) exp(−(v / v_s)²)      F = f + σ1/σ0 df/dt
///
/// f is the bristle force σ0 z. Source: Canudas de Wit, Olsson, Åström, Lischinsky, IEEE Trans. Automatic Control
/// 40(3), 1995.
struct Bristles {
  double breakaway = 0, kinetic = 0;  ///< F_s, F_c, unit of force
  double stribeck_speed = 1;          ///< v_s
  double stiffness = 0, damping = 0;  ///< σ0, σ1

  double rate(double force, double speed) const {
    if (breakaway <= 0) return 0;
    const double z = speed / stribeck_speed;
    const double sliding = kinetic + (breakaway - kinetic) * std::exp(-z * z);
    // The bristles settle within 0.2 ms at most speeds; faster is invisible at 200 Hz and needlessly stiff.
    constexpr double kFastestPerS = 5000;
    const double fastest = kFastestPerS * sliding / stiffness;
    const double bounded = speed / std::sqrt(1 + speed * speed / (fastest * fastest));
    return stiffness * (bounded - std::abs(bounded) * force / sliding);
  }
  double friction(double force, double bristle_rate) const {
    return breakaway <= 0 ? 0 : force + damping / stiffness * bristle_rate;
  }
};

}  // namespace valvetriage::stand
