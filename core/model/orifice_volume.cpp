#include "core/model/orifice_volume.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

namespace valvetriage {
namespace {

// Where flow through an orifice turns laminar: Reynolds number 1000 in holes of half a millimetre to a millimetre.
constexpr double kLaminar_psi = 0.1;
constexpr double kAtmosphere_psi = 14.7;
// The supply stays this far above the volume: a steady pressure at the supply has no drop to flow over.
constexpr double kLeastDrop_psi = 1.0;

/// φ and φ' at a pressure, ((P_s − p))^n and its derivative.
struct Flow {
  double drain = 0, drain_slope = 0;
  double drop = 0, drop_slope = 0;
  double out = 0, out_slope = 0;  ///< what leaves a volume with faults: drain and loss
};

constexpr double kLeastExponent = 0.05;

/// (p + ε)^n − ε^n and its slope, the tangent below zero.
void orifice(double p, double n, double zero, double& flow, double& slope) {
  if (p >= 0) {
    const double power = std::pow(p + kLaminar_psi, n);
    flow = power - zero;
    slope = n * power / (p + kLaminar_psi);
  } else {
    slope = n * zero / kLaminar_psi;
    flow = slope * p;
  }
}

// A supply of any pressure gets a table of a quarter megabyte at most; beyond 8192 psi the law is evaluated as it is.
constexpr double kMostIntervals = 8192;

/// A smooth function of one variable on evenly spaced points, cubic between them: a power costs ten times as much.
class Table {
 public:
  /// at(x) gives value and slope; nothing is tabulated where last <= first.
  template <typename At>
  Table(double first, double last, double step, At at) : first_(first), per_step_(1 / step) {
    if (!(last > first)) return;
    const auto intervals = static_cast<std::size_t>(std::min(std::ceil((last - first) * per_step_), kMostIntervals));
    points_.reserve(intervals + 1);
    for (std::size_t i = 0; i <= intervals; ++i) {
      Point point;
      at(first + static_cast<double>(i) * step, point.value, point.slope);
      point.slope *= step;
      points_.push_back(point);
    }
    last_ = first + static_cast<double>(intervals) * step;
  }

  bool holds(double x) const { return x >= first_ && x < last_; }

  void read(double x, double& value, double& slope) const {
    const double place = (x - first_) * per_step_;
    const auto i = static_cast<std::size_t>(place);
    const double t = place - static_cast<double>(i);
    const Point &a = points_[i], &b = points_[i + 1];
    const double rise = b.value - a.value;
    const double c = 3 * rise - 2 * a.slope - b.slope, d = a.slope + b.slope - 2 * rise;
    value = a.value + t * (a.slope + t * (c + t * d));
    slope = (a.slope + t * (2 * c + 3 * t * d)) * per_step_;
  }

 private:
  struct Point {
    double value = 0, slope = 0;
  };
  double first_ = 0, last_ = 0, per_step_ = 1;
  std::vector<Point> points_;
};

// In the root of the pressure a flow is nearly straight: cubics this far apart [√psi] err by less than 1e-8 of it.
constexpr double kRootStep = 0.025;
constexpr double kDropStep_psi = 1.0;
constexpr double kLeastTabulatedDrop_psi = 20.0;

class Law {
 public:
  explicit Law(const OrificeVolume& volume)
      : n_(volume.exponent),
        supply_(volume.supply_psi),
        zero_(std::pow(kLaminar_psi, volume.exponent)),
        fall_(volume.fall_to_rise_ratio),
        air_(volume.air_share),
        absolute_reference_(volume.reference_psi + kAtmosphere_psi) {
    const Flow at = flow(volume.reference_psi);
    scale_ = 1.0 / (volume.time_constant_s * (at.drain_slope - at.drain * at.drop_slope / at.drop));
    if (volume.drain_excess_exponent != 0) add_drain(volume, at.drain);
    if (volume.loss_fraction != 0) add_loss(volume);
  }

  /// The same from tables, exact outside them: worth it for hundreds of samples.
  class Tabulated {
   public:
    explicit Tabulated(const Law& law)
        : law_(law),
          in_(kRoot0, std::sqrt(law.supply_ + kLaminar_psi), kRootStep,
              [&](double root, double& value, double& slope) {
                const Flow at = law.flow(root * root - kLaminar_psi);
                value = at.drain;
                slope = at.drain_slope * 2 * root;
              }),
          out_(kRoot0, law.is_healthy() ? kRoot0 : std::sqrt(law.supply_ + kLaminar_psi), kRootStep,
               [&](double root, double& value, double& slope) {
                 const Flow at = law.flow(root * root - kLaminar_psi);
                 value = at.out;
                 slope = at.out_slope * 2 * root;
               }),
          drop_(0, law.supply_ - kLeastTabulatedDrop_psi, kDropStep_psi, [&](double p, double& value, double& slope) {
            const Flow at = law.flow(p);
            value = at.drop;
            slope = at.drop_slope;
          }) {}

    Flow flow(double p) const {
      if (!drop_.holds(p)) return law_.flow(p);
      const double root = std::sqrt(p + kLaminar_psi);
      if (!in_.holds(root)) return law_.flow(p);
      Flow flow;
      const double by_p = 0.5 / root;
      in_.read(root, flow.drain, flow.drain_slope);
      flow.drain_slope *= by_p;
      flow.out = flow.drain;
      flow.out_slope = flow.drain_slope;
      if (!law_.is_healthy()) {
        out_.read(root, flow.out, flow.out_slope);
        flow.out_slope *= by_p;
      }
      drop_.read(p, flow.drop, flow.drop_slope);
      return flow;
    }

   private:
    static inline const double kRoot0 = std::sqrt(kLaminar_psi);
    const Law& law_;
    Table in_, out_, drop_;
  };

  bool is_healthy() const { return drain_share_ == 0 && loss_share_ == 0; }

  Flow flow(double p) const {
    Flow flow;
    orifice(p, n_, zero_, flow.drain, flow.drain_slope);
    flow.out = flow.drain;
    flow.out_slope = flow.drain_slope;
    if (drain_share_ != 0) {
      orifice(p, drain_n_, drain_zero_, flow.out, flow.out_slope);
      flow.out *= drain_share_;
      flow.out_slope *= drain_share_;
    }
    if (loss_share_ != 0) {
      double loss = 0, loss_slope = 0;
      orifice(p, 0.5, std::sqrt(kLaminar_psi), loss, loss_slope);
      flow.out += loss_share_ * loss;
      flow.out_slope += loss_share_ * loss_slope;
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
  Rate rate(double at_psi, const Flow& p, const Flow& m) const {
    const double per_drop = 1 / m.drop;
    const double inflow = m.drain * per_drop;
    Rate rate{scale_ * (p.drop * inflow - p.out), scale_ * (inflow * p.drop_slope - p.out_slope),
              scale_ * p.drop * per_drop * (m.drain_slope - inflow * m.drop_slope)};
    if (air_ != 0) soften(at_psi, rate);
    if (fall_ != 1 && rate.value < 0) rate = {rate.value / fall_, rate.by_p / fall_, rate.by_m / fall_};
    return rate;
  }

 private:
  /// Divides by the capacity at a pressure over that at the reference.
  void soften(double at_psi, Rate& rate) const {
    const double q = absolute_reference_ / (std::max(at_psi, 0.0) + kAtmosphere_psi);
    const double per_capacity = (1 + air_) / (1 + air_ * q * q);
    const double slope =
        at_psi > 0 ? per_capacity * per_capacity * 2 * air_ * q * q * q / (absolute_reference_ * (1 + air_)) : 0;
    rate = {rate.value * per_capacity, rate.by_p * per_capacity + rate.value * slope, rate.by_m * per_capacity};
  }

  /// Another exponent of the drain, its flow at the reference pressure unchanged.
  void add_drain(const OrificeVolume& volume, double flow_at_reference) {
    drain_n_ = std::max(n_ + volume.drain_excess_exponent, kLeastExponent);
    drain_zero_ = std::pow(kLaminar_psi, drain_n_);
    double flow = 0, slope = 0;
    orifice(volume.reference_psi, drain_n_, drain_zero_, flow, slope);
    drain_share_ = flow_at_reference / flow;
  }

  /// A second orifice that passes a fraction of the healthy through-flow at the highest pressure.
  void add_loss(const OrificeVolume& volume) {
    const double highest = volume.highest_psi > 0 ? volume.highest_psi : 2 * volume.reference_psi;
    double through = 0, loss = 0, slope = 0;
    orifice(highest, n_, zero_, through, slope);
    orifice(highest, 0.5, std::sqrt(kLaminar_psi), loss, slope);
    loss_share_ = volume.loss_fraction * through / loss;
  }

  double n_, supply_, zero_, fall_, air_, absolute_reference_;
  double scale_ = 0;
  double drain_n_ = 0, drain_zero_ = 0, drain_share_ = 0;  // share 0: the healthy drain
  double loss_share_ = 0;
};

/// (1 − e^(−x)) / x, its limit 1 at 0.
double relaxed(double x) {
  if (std::abs(x) > 0.3) return -std::expm1(-x) / x;
  // The series to x^9 / 10!: what is left out is below 1e-12. In pairs, for the sum is on the critical path.
  const double x2 = x * x, x4 = x2 * x2;
  const double first = (1 - x * (1.0 / 2)) + x2 * (1.0 / 6 - x * (1.0 / 24));
  const double second = (1.0 / 120 - x * (1.0 / 720)) + x2 * (1.0 / 5040 - x * (1.0 / 40320));
  return first + x4 * (second + x4 * (1.0 / 362880 - x * (1.0 / 3628800)));
}

}  // namespace

void run_volume(const OrificeVolume& volume, double sample_period_s, double first_psi, std::span<const double> steady,
                std::span<double> pressure, VolumeTangent* tangent) {
  assert(steady.size() == pressure.size());
  const Law law(volume);
  const Law::Tabulated table(law);
  const std::size_t n = steady.size();
  if (tangent) {
    tangent->keep.assign(n, 0);
    tangent->pass.assign(n, 0);
  }
  double p = std::min(first_psi, volume.ceiling_psi);
  double m = n > 0 ? std::min(steady[0], volume.stop_psi) : 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double next_m = i + 1 < n ? std::min(steady[i + 1], volume.stop_psi) : m;
    pressure[i] = p;
    const Flow middle = table.flow(0.5 * (m + next_m));
    // Half a step with the slope at its start, then the whole with the slope at the middle.
    const Law::Rate begin = law.rate(p, table.flow(p), middle);
    const double half = p + 0.5 * sample_period_s * begin.value * relaxed(-0.5 * sample_period_s * begin.by_p);
    const Law::Rate centre = law.rate(half, table.flow(half), middle);
    const double reach = sample_period_s * relaxed(-sample_period_s * centre.by_p);
    const double slope_there = centre.value + centre.by_p * (p - half);
    if (tangent) {
      tangent->keep[i] = 1 + centre.by_p * reach;  // e^(T ∂rate/∂p)
      // Where the spool is at its stop, m stays.
      const double moving = 0.5 * ((m < volume.stop_psi ? 1 : 0) + (next_m < volume.stop_psi ? 1 : 0));
      tangent->pass[i] = 0.5 * reach * centre.by_m * moving;
    }
    p += reach * slope_there;
    if (p > volume.ceiling_psi) {
      p = volume.ceiling_psi;
      if (tangent) tangent->keep[i] = tangent->pass[i] = 0;
    }
    m = next_m;
  }
}

double settled_psi(const OrificeVolume& volume, double steady_psi) {
  const double asked_psi = std::min(steady_psi, volume.stop_psi);
  double settled = asked_psi;
  if (volume.drain_excess_exponent != 0 || volume.loss_fraction != 0) {
    const Law law(volume);
    const Flow m = law.flow(asked_psi);
    // The rate falls with p, so a bracket around its zero can be halved: to the last bit, and no slope is needed.
    double low = std::min(asked_psi, 0.0) - 1, high = std::max(volume.supply_psi, asked_psi + 1);
    for (int halving = 0; halving < 80; ++halving) {
      const double middle = 0.5 * (low + high);
      (law.rate(middle, law.flow(middle), m).value > 0 ? low : high) = middle;
    }
    settled = 0.5 * (low + high);
  }
  return std::min(settled, volume.ceiling_psi);
}

}  // namespace valvetriage
