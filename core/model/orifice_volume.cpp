#include "core/model/orifice_volume.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace valvetriage {
namespace {

constexpr double kLaminar_psi = 1.0;
// The supply stays this far above the volume: a steady pressure at the supply has no drop to flow over.
constexpr double kLeastDrop_psi = 1.0;

/// φ and φ' at a pressure, ((P_s − p))^n and its derivative.
struct Flow {
  double drain = 0, drain_slope = 0;
  double drop = 0, drop_slope = 0;
};

class Law {
 public:
  explicit Law(const OrificeVolume& volume)
      : n_(volume.exponent), supply_(volume.supply_psi), zero_(std::pow(kLaminar_psi, volume.exponent)) {
    const Flow at = flow(volume.reference_psi);
    scale_ = 1.0 / (volume.time_constant_s * (at.drain_slope - at.drain * at.drop_slope / at.drop));
  }

  Flow flow(double p) const {
    Flow flow;
    if (p >= 0) {
      const double power = std::pow(p + kLaminar_psi, n_);
      flow.drain = power - zero_;
      flow.drain_slope = n_ * power / (p + kLaminar_psi);
    } else {
      flow.drain_slope = n_ * zero_ / kLaminar_psi;
      flow.drain = flow.drain_slope * p;
    }
    const double drop = std::max(supply_ - p, kLeastDrop_psi);
    flow.drop = std::pow(drop, n_);
    flow.drop_slope = -n_ * flow.drop / drop;
    return flow;
  }

  /// dp/dt and its derivatives by p and m.
  struct Rate {
    double value = 0, by_p = 0, by_m = 0;
  };
  Rate rate(const Flow& p, const Flow& m) const {
    const double ratio = p.drop / m.drop;
    return {scale_ * (ratio * m.drain - p.drain), scale_ * (m.drain * p.drop_slope / m.drop - p.drain_slope),
            scale_ * ratio * (m.drain_slope - m.drain * m.drop_slope / m.drop)};
  }

 private:
  double n_, supply_, zero_;
  double scale_ = 0;
};

/// (1 − e^(−x)) / x, its limit 1 at 0.
double relaxed(double x) {
  return std::abs(x) < 1e-9 ? 1.0 : -std::expm1(-x) / x;
}

}  // namespace

void run_volume(const OrificeVolume& volume, double sample_period_s, double first_psi, std::span<const double> steady,
                std::span<double> pressure, VolumeTangent* tangent) {
  assert(steady.size() == pressure.size());
  const Law law(volume);
  const std::size_t n = steady.size();
  if (tangent) {
    tangent->keep.assign(n, 0);
    tangent->pass.assign(n, 0);
  }
  double p = first_psi;
  double m = n > 0 ? steady[0] : 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double next_m = i + 1 < n ? steady[i + 1] : m;
    pressure[i] = p;
    const Flow middle = law.flow(0.5 * (m + next_m));
    // Half a step with the slope at its start, then the whole with the slope at the middle.
    const Law::Rate begin = law.rate(law.flow(p), middle);
    const double half = p + 0.5 * sample_period_s * begin.value * relaxed(-0.5 * sample_period_s * begin.by_p);
    const Law::Rate centre = law.rate(law.flow(half), middle);
    const double reach = sample_period_s * relaxed(-sample_period_s * centre.by_p);
    const double slope_there = centre.value + centre.by_p * (p - half);
    if (tangent) {
      tangent->keep[i] = std::exp(sample_period_s * centre.by_p);
      tangent->pass[i] = 0.5 * reach * centre.by_m;
    }
    p += reach * slope_there;
    m = next_m;
  }
}

}  // namespace valvetriage
