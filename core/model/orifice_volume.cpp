#include "core/model/orifice_volume.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <deque>
#include <limits>
#include <vector>

namespace valvetriage {
namespace {

// Where flow through an orifice turns laminar: Reynolds number 1000 in holes of half a millimetre to a millimetre.
constexpr double kLaminar_psi = 0.1;
constexpr double kAtmosphere_psi = 14.7;
// A steady pressure and a volume that move by less within a sample stand still: nothing is integrated until they move.
constexpr double kAtRest_psi = 1e-10;
// Each step of a volume waits for the one before, and is longer than a processor sees ahead: several recordings, the
// parts of a step one beside another, keep it busy.
constexpr std::size_t kSideBySide = 6;
// The supply stays this far above the volume: a steady pressure at the supply has no drop to flow over.
constexpr double kLeastDrop_psi = 1.0;

/// What a pressure does to the flows, with derivatives by it.
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

/// Functions of one variable with their slopes.
template <std::size_t kFunctions>
struct Values {
  std::array<double, kFunctions> value{}, slope{};
};

/// Evenly spaced points.
struct Grid {
  double first = 0, step = 1;
  std::size_t points = 0;

  /// No points where last <= first.
  static Grid between(double first, double last, double step) {
    if (!(last > first)) return {first, step, 0};
    return {first, step, static_cast<std::size_t>(std::ceil((last - first) / step)) + 1};
  }
  double at(std::size_t i) const { return first + static_cast<double>(i) * step; }
};

/// Smooth functions on a grid, cubic between its points: a power costs ten times as much.
template <std::size_t kFunctions>
class Table {
 public:
  /// `at` gives the functions and their slopes at a point of the grid.
  template <typename At>
  Table(const Grid& grid, const At& at) : grid_(grid), per_step_(1 / grid.step) {
    if (grid.points < 2) return;
    last_ = grid.at(grid.points - 1);
    pieces_.resize(grid.points - 1);
    Values<kFunctions> begin = at(grid.first);
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      const Values<kFunctions> end = at(grid.at(i + 1));
      for (std::size_t k = 0; k < kFunctions; ++k) {
        const double rise = end.value[k] - begin.value[k];
        const double from = grid.step * begin.slope[k], to = grid.step * end.slope[k];
        pieces_[i][k] = {begin.value[k], from, 3 * rise - 2 * from - to, from + to - 2 * rise};
      }
      begin = end;
    }
  }

  bool holds(double x) const { return x >= grid_.first && x < last_; }

  Values<kFunctions> read(double x) const {
    const double place = (x - grid_.first) * per_step_;
    const auto i = static_cast<std::size_t>(place);
    const double t = place - static_cast<double>(i);
    Values<kFunctions> read;
    for (std::size_t k = 0; k < kFunctions; ++k) {
      const Cubic& of = pieces_[i][k];
      read.value[k] = of.a + t * (of.b + t * (of.c + t * of.d));
      read.slope[k] = (of.b + t * (2 * of.c + 3 * t * of.d)) * per_step_;
    }
    return read;
  }

 private:
  struct Cubic {
    double a = 0, b = 0, c = 0, d = 0;  ///< a + b t + c t² + d t³, t from 0 to 1 along a step
  };
  Grid grid_;
  double last_ = -std::numeric_limits<double>::infinity();
  double per_step_ = 1;
  std::vector<std::array<Cubic, kFunctions>> pieces_;
};

// Flows bend most at small pressures: cubics this far apart err by some 1e-5 psi at most, at zero, and by less than
// 1e-7 of the flow from half a psi on. Beyond the tables, for a reference pressure of any size, the law is evaluated as
// it is.
constexpr double kLowStep_psi = 1.0 / 32, kHighStep_psi = 1;
constexpr double kLow_psi = 16.0, kMostTabulated_psi = 512.0;
constexpr double kLeastTabulatedDrop_psi = 20.0;
// A valve's pressures end at twice the reference; something is left for overshoot.
constexpr double kTabulatedOverReference = 2.4;

class Law {
 public:
  explicit Law(const OrificeVolume& volume)
      : n_(volume.exponent),
        supply_(volume.supply_psi),
        zero_(std::pow(kLaminar_psi, volume.exponent)),
        per_fall_(1 / volume.fall_to_rise_ratio),
        air_(volume.air_share),
        reference_(volume.reference_psi),
        absolute_reference_(volume.reference_psi + kAtmosphere_psi) {
    const Flow at = flow(volume.reference_psi);
    scale_ = 1.0 / (volume.time_constant_s * (at.drain_slope - at.drain * at.drop_slope / at.drop));
    if (volume.drain_excess_exponent != 0) add_drain(volume, at.drain);
    if (volume.loss_fraction != 0) add_loss(volume);
  }

  /// dp/dt = A(p) Q(m) − B(p): what the pressure alone and the steady pressure alone decide.
  using OfPressure = Values<2>;  ///< A and B
  using OfSteady = Values<1>;    ///< Q
  OfPressure of_pressure(double p) const { return of_pressure(p, flow(p)); }
  OfSteady of_steady(double m) const { return of_steady(flow(m)); }

  /// The same from tables, exact outside them: worth it for hundreds of samples.
  class Tabulated {
   public:
    explicit Tabulated(const Law& law)
        : law_(law),
          low_(law, Grid::between(0, std::min(kLow_psi, law.tabulated_to()), kLowStep_psi)),
          high_(law, Grid::between(kLow_psi, law.tabulated_to(), kHighStep_psi)) {}

    OfPressure of_pressure(double p) const {
      if (high_.pressure.holds(p)) return high_.pressure.read(p);
      return low_.pressure.holds(p) ? low_.pressure.read(p) : law_.of_pressure(p);
    }
    OfSteady of_steady(double m) const {
      if (high_.steady.holds(m)) return high_.steady.read(m);
      return low_.steady.holds(m) ? low_.steady.read(m) : law_.of_steady(m);
    }

   private:
    struct Tables {
      Tables(const Law& law, const Grid& grid)
          : pressure(grid, [&](double p) { return law.of_pressure(p); }),
            steady(grid, [&](double m) { return law.of_steady(m); }) {}
      Table<2> pressure;
      Table<1> steady;
    };
    const Law& law_;
    Tables low_, high_;
  };

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
    flow.drop = std::sqrt(drop);
    flow.drop_slope = -0.5 * flow.drop / drop;
    return flow;
  }

  /// dp/dt under an inflow Q, and its derivatives by p and Q.
  struct Rate {
    double value = 0, by_p = 0, by_inflow = 0;
  };
  Rate rate(const OfPressure& p, double inflow) const {
    Rate rate{p.value[0] * inflow - p.value[1], p.slope[0] * inflow - p.slope[1], p.value[0]};
    if (rate.value < 0) rate = {rate.value * per_fall_, rate.by_p * per_fall_, rate.by_inflow * per_fall_};
    return rate;
  }

 private:
  OfPressure of_pressure(double p, const Flow& at) const {
    const Capacity capacity = air_ != 0 ? capacity_at(p) : Capacity{};
    const double scale = scale_ * capacity.inverse, scale_slope = scale_ * capacity.inverse_slope;
    return {{scale * at.drop, scale * at.out},
            {scale * at.drop_slope + scale_slope * at.drop, scale * at.out_slope + scale_slope * at.out}};
  }
  static OfSteady of_steady(const Flow& at) {
    const double inflow = at.drain / at.drop;
    return {{inflow}, {(at.drain_slope - inflow * at.drop_slope) / at.drop}};
  }

  double tabulated_to() const {
    return std::min({supply_ - kLeastTabulatedDrop_psi, kTabulatedOverReference * reference_, kMostTabulated_psi});
  }

  /// 1 over the capacity at a pressure over that at the reference.
  struct Capacity {
    double inverse = 1, inverse_slope = 0;
  };
  Capacity capacity_at(double p) const {
    const double q = absolute_reference_ / (std::max(p, 0.0) + kAtmosphere_psi);
    const double inverse = (1 + air_) / (1 + air_ * q * q);
    const double slope = p >= 0 ? inverse * inverse * 2 * air_ * q * q * q / (absolute_reference_ * (1 + air_)) : 0;
    return {inverse, slope};
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

  double n_, supply_, zero_, per_fall_, air_, reference_, absolute_reference_;
  double scale_ = 0;
  double drain_n_ = 0, drain_zero_ = 0, drain_share_ = 0;  // share 0: the healthy drain
  double loss_share_ = 0;
};

// Up to here a series of ten terms holds 1e-12.
constexpr double kSeries = 0.3;

/// (1 − e^(−x)) / x by its series to x^9 / 10!, in pairs, for the sum is on the critical path.
inline double relaxed_a_little(double x) {
  const double x2 = x * x, x4 = x2 * x2;
  const double first = (1 - x * (1.0 / 2)) + x2 * (1.0 / 6 - x * (1.0 / 24));
  const double second = (1.0 / 120 - x * (1.0 / 720)) + x2 * (1.0 / 5040 - x * (1.0 / 40320));
  return first + x4 * (second + x4 * (1.0 / 362880 - x * (1.0 / 3628800)));
}

double relaxed_far(double x) {
  if (std::abs(x) > 4 * kSeries) return -std::expm1(-x) / x;
  // Of twice h it is f(h) (2 − h f(h)) / 2.
  const double h = 0.25 * x;
  const double once = relaxed_a_little(h);
  const double twice = once * (1 - 0.5 * h * once);
  return twice * (1 - h * twice);
}

/// (1 − e^(−x)) / x, its limit 1 at 0.
inline double relaxed(double x) {
  return std::abs(x) <= kSeries ? relaxed_a_little(x) : relaxed_far(x);
}

/// One volume on its way through a recording.
class VolumeAtWork {
 public:
  VolumeAtWork(const VolumeRun& run, const Law& law, const Law::Tabulated& table)
      : run_(run), law_(law), table_(table), stop_psi_(run.volume->stop_psi), ceiling_psi_(run.volume->ceiling_psi) {
    assert(run.steady.size() == 2 * run.pressure.size());
    const std::size_t n = run.pressure.size();
    if (run.tangent) {
      for (std::vector<double>* part : parts(*run.tangent)) part->assign(n, 0);
    }
    p_ = std::min(run.first_psi, ceiling_psi_);
    if (n > 0) at_ = asked(run.steady[0]);
  }

  std::size_t samples() const { return run_.pressure.size(); }

  /// A sample's step in three parts, which those of other volumes go between: what is asked for from sample i on.
  void ask(std::size_t i) {
    // Before the pressure is written: it may stand in the memory of what was read.
    const double middle_m = run_.steady[2 * i + 1], end_m = i + 1 < samples() ? run_.steady[2 * i + 2] : middle_m;
    run_.pressure[i] = p_;
    const double middle_psi = std::min(middle_m, stop_psi_), end_psi = std::min(end_m, stop_psi_);
    stays_ = std::abs(end_psi - at_.psi) <= kAtRest_psi && std::abs(middle_psi - at_.psi) <= kAtRest_psi;
    if (stands_still()) return;
    middle_ = asked(middle_m);
    end_ = asked(end_m);
    inflow_ = (at_.flow.value[0] + 4 * middle_.flow.value[0] + end_.flow.value[0]) * (1.0 / 6);
  }
  /// Half a step with the slope at its start.
  void go_half() {
    if (stands_still()) return;
    const Law::Rate begin = law_.rate(table_.of_pressure(p_), inflow_);
    half_ = p_ + 0.5 * run_.sample_period_s * begin.value * relaxed(-0.5 * run_.sample_period_s * begin.by_p);
  }
  /// The whole of it with the slope at the middle.
  void go(std::size_t i) {
    if (stands_still()) {
      if (run_.tangent) {
        for (std::vector<double>* part : parts(*run_.tangent)) (*part)[i] = (*part)[i - 1];
      }
      return;
    }
    const Law::Rate centre = law_.rate(table_.of_pressure(half_), inflow_);
    const double reach = run_.sample_period_s * relaxed(-run_.sample_period_s * centre.by_p);
    const double slope_there = centre.value + centre.by_p * (p_ - half_);
    if (run_.tangent) {
      const double sixth = reach * centre.by_inflow * (1.0 / 6);
      run_.tangent->keep[i] = 1 + centre.by_p * reach;  // e^(T ∂rate/∂p)
      run_.tangent->begin[i] = sixth * at_.slope();
      run_.tangent->middle[i] = 4 * sixth * middle_.slope();
      run_.tangent->end[i] = sixth * end_.slope();
    }
    p_ += reach * slope_there;
    rests_ = stays_ && std::abs(reach * slope_there) <= kAtRest_psi;
    if (p_ > ceiling_psi_) {
      p_ = ceiling_psi_;
      if (run_.tangent) {
        for (std::vector<double>* part : parts(*run_.tangent)) (*part)[i] = 0;
      }
    }
    at_ = end_;
  }

 private:
  /// A steady pressure that the spool asks for, and the inflow that goes with it.
  struct Asked {
    double psi = 0;
    bool is_free = true;  ///< of the stop, beyond which it stays
    Law::OfSteady flow;

    double slope() const { return is_free ? flow.slope[0] : 0; }
  };
  Asked asked(double steady_psi) const {
    const double psi = std::min(steady_psi, stop_psi_);
    return {psi, steady_psi < stop_psi_, table_.of_steady(psi)};
  }
  bool stands_still() const { return stays_ && rests_; }
  static std::array<std::vector<double>*, 4> parts(VolumeTangent& tangent) {
    return {&tangent.keep, &tangent.begin, &tangent.middle, &tangent.end};
  }

  const VolumeRun& run_;
  const Law& law_;
  const Law::Tabulated& table_;
  double stop_psi_, ceiling_psi_;
  double p_ = 0;
  Asked at_;
  bool rests_ = false;
  // Of the sample that is stepped over.
  Asked middle_, end_;
  double inflow_ = 0, half_ = 0;
  bool stays_ = false;
};

/// A volume's law with its tables.
struct TabulatedLaw {
  explicit TabulatedLaw(const OrificeVolume& volume) : law(volume), table(law) {}
  Law law;
  Law::Tabulated table;
};

}  // namespace

void run_volumes(std::span<const VolumeRun> runs) {
  std::deque<TabulatedLaw> laws;  // stays where it is as it grows
  const OrificeVolume* tabulated = nullptr;
  std::vector<VolumeAtWork> at_work;
  for (const VolumeRun& run : runs) {
    if (!tabulated || !(*tabulated == *run.volume)) laws.emplace_back(*run.volume);
    tabulated = run.volume;
    at_work.emplace_back(run, laws.back().law, laws.back().table);
  }
  for (std::size_t first = 0; first < at_work.size(); first += kSideBySide) {
    const auto some = std::span(at_work).subspan(first, std::min(kSideBySide, at_work.size() - first));
    std::size_t longest = 0;
    for (const VolumeAtWork& volume : some) longest = std::max(longest, volume.samples());
    for (std::size_t i = 0; i < longest; ++i) {
      const auto each = [&](const auto& part) {
        for (VolumeAtWork& volume : some) {
          if (i < volume.samples()) part(volume);
        }
      };
      each([i](VolumeAtWork& volume) { volume.ask(i); });
      each([](VolumeAtWork& volume) { volume.go_half(); });
      each([i](VolumeAtWork& volume) { volume.go(i); });
    }
  }
}

void run_volume(const OrificeVolume& volume, double sample_period_s, double first_psi, std::span<const double> steady,
                std::span<double> pressure, VolumeTangent* tangent) {
  const VolumeRun run{&volume, sample_period_s, first_psi, steady, pressure, tangent};
  run_volumes({&run, 1});
}

OrificeVolume without_stop(OrificeVolume volume) {
  volume.stop_psi = std::numeric_limits<double>::infinity();
  return volume;
}

double settled_psi(const OrificeVolume& volume, double steady_psi) {
  const double asked_psi = std::min(steady_psi, volume.stop_psi);
  double settled = asked_psi;
  if (volume.drain_excess_exponent != 0 || volume.loss_fraction != 0) {
    const Law law(volume);
    const double inflow = law.of_steady(asked_psi).value[0];
    // The rate falls with p, so a bracket around its zero can be halved: to the last bit, and no slope is needed.
    double low = std::min(asked_psi, 0.0) - 1, high = std::max(volume.supply_psi, asked_psi + 1);
    for (int halving = 0; halving < 80; ++halving) {
      const double middle = 0.5 * (low + high);
      (law.rate(law.of_pressure(middle), inflow).value > 0 ? low : high) = middle;
    }
    settled = 0.5 * (low + high);
  }
  return std::min(settled, volume.ceiling_psi);
}

}  // namespace valvetriage
