#include "tests/hidden_effects/output_rivals.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::VectorXd;
using Whitener = std::function<VectorXd(const VectorXd&)>;

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kPeriodS = 0.005;

double left_by(const VectorXd& left, const VectorXd& column) {
  const double energy = column.squaredNorm();
  if (energy < 1e-9) return left.squaredNorm();
  const double along = column.dot(left);
  return left.squaredNorm() - along * along / energy;
}

/// A change of gain from an instant of one recording on: all recordings, instants on a grid, then halving around the
/// best.
double left_by_contact(const TwinBench& bench, const VectorXd& healthy_psi, const VectorXd& left,
                       const Whitener& whitened) {
  constexpr Index kGrid = 24;
  double best = left.squaredNorm();
  for (std::size_t i = 0; i < bench.recordings(); ++i) {
    const auto left_from = [&](Index row) {
      return left_by(left, whitened(gain_changed_from(bench, healthy_psi, i, row)));
    };
    Index step = bench.size(i) / kGrid, at = 0;
    double lowest = std::numeric_limits<double>::infinity();
    for (Index row = 0; row < bench.size(i) - step; row += step)
      if (const double remains = left_from(row); remains < lowest) {
        lowest = remains;
        at = row;
      }
    if (lowest < 1.2 * best)
      for (step /= 2; step > 0; step /= 2)
        for (const Index row : {at - step, at + step})
          if (row >= 0 && row < bench.size(i) - 1)
            if (const double remains = left_from(row); remains < lowest) {
              lowest = remains;
              at = row;
            }
    best = std::min(best, lowest);
  }
  return best;
}

/// Rotations e^{iφ(k)} with an envelope, one phase per recording and one amplitude for all.
template <class Phasor>
double left_by_tone(const TwinBench& bench, const VectorXd& left, const Whitener& whitened, Phasor phasor) {
  std::vector<std::complex<double>> turn(bench.recordings());
  for (std::size_t i = 0; i < bench.recordings(); ++i) {
    std::complex<double> along = 0;
    for (Index k = 0; k < bench.size(i); ++k) along += left[bench.begin(i) + k] * std::conj(phasor(i, k));
    turn[i] = along / std::max(std::abs(along), 1e-12);
  }
  return left_by(left,
                 whitened(bench.column_of([&](std::size_t i, Index k) { return (turn[i] * phasor(i, k)).real(); })));
}

/// Sum over recordings of |<left, tone>|: what one amplitude with free phases would explain.
double tone_strength(const TwinBench& bench, const VectorXd& left, double hertz) {
  double sum = 0;
  const std::complex<double> turn = std::polar(1.0, -kTwoPi * hertz * kPeriodS);
  for (std::size_t i = 0; i < bench.recordings(); ++i) {
    std::complex<double> along = 0, at = 1;
    for (Index k = 0; k < bench.size(i); ++k, at *= turn) along += left[bench.begin(i) + k] * at;
    sum += std::abs(along);
  }
  return sum;
}

double strongest_hz(const TwinBench& bench, const VectorXd& left) {
  constexpr double kLowHz = 0.5, kHighHz = 45;
  const double resolution = 0.3 / (kPeriodS * static_cast<double>(bench.size(0)));
  double best = 0, at = kLowHz;
  for (double hertz = kLowHz; hertz < kHighHz; hertz += resolution)
    if (const double strength = tone_strength(bench, left, hertz); strength > best) {
      best = strength;
      at = hertz;
    }
  for (double step = resolution / 2; step > resolution / 40; step /= 2)
    for (const double hertz : {at - step, at + step})
      if (const double strength = tone_strength(bench, left, hertz); strength > best) {
        best = strength;
        at = hertz;
      }
  return at;
}

/// Hunting as the stand makes it, its cycle followed along the healthy output: strongest at one level, frequency with
/// it.
double left_by_hunting(const TwinBench& bench, const VectorXd& healthy_psi, const VectorXd& left,
                       const Whitener& whitened, double hertz, double level_psi) {
  constexpr double kGrowthPerS = 10, kWidthPsi = 60, kAway = 0.5, kStir = 0.02, kRangePsi = 210;
  Eigen::VectorXcd cycle(bench.samples());
  for (std::size_t i = 0; i < bench.recordings(); ++i) {
    std::complex<double> z = 0;
    for (Index k = -300; k < bench.size(i); ++k) {
      const double from = healthy_psi[bench.begin(i) + std::max<Index>(k, 0)] - level_psi;
      const double drive = (std::exp(-0.5 * from * from / (kWidthPsi * kWidthPsi)) - kAway) / (1 - kAway);
      const double growth = kGrowthPerS * (drive - std::norm(z));
      z = (z + kStir * kPeriodS) * std::exp(growth * kPeriodS) *
          std::polar(1.0, kTwoPi * hertz * (1 + 0.25 * from / kRangePsi) * kPeriodS);
      if (k >= 0) cycle[bench.begin(i) + k] = z;
    }
  }
  return left_by_tone(bench, left, whitened, [&](std::size_t i, Index k) { return cycle[bench.begin(i) + k]; });
}

double left_by_best_hunting(const TwinBench& bench, const VectorXd& healthy_psi, const VectorXd& left,
                            const Whitener& whitened, double strongest) {
  double best = left.squaredNorm();
  if (strongest < 2 || strongest > 20) return best;
  for (const double level_psi : {110.0, 130.0, 150.0, 170.0})
    for (double ratio = 0.85; ratio < 1.16; ratio += 0.01)
      best = std::min(best, left_by_hunting(bench, healthy_psi, left, whitened, ratio * strongest, level_psi));
  return best;
}

}  // namespace

VectorXd gain_changed_from(const TwinBench& bench, const VectorXd& healthy_psi, std::size_t recording, Index row) {
  VectorXd column = VectorXd::Zero(bench.samples());
  const Index rows = bench.size(recording) - row;
  column.segment(bench.begin(recording) + row, rows) = healthy_psi.segment(bench.begin(recording) + row, rows);
  return column;
}

VectorXd warmth(const TwinBench& bench) {
  return bench.column_of([&](std::size_t i, Index k) {
    const stand::Environment& around = bench.environment(i);
    return around.temperature_c.at(bench.time_s(i, k)) - around.day_temperature_c;
  });
}

VectorXd supply(const TwinBench& bench) {
  return bench.column_of([&](std::size_t i, Index k) {
    const stand::Environment& around = bench.environment(i);
    return around.supply_psi.at(bench.time_s(i, k)) - around.day_supply_psi;
  });
}

VectorXd time(const TwinBench& bench) {
  return bench.column_of([&](std::size_t i, Index k) { return bench.time_s(i, k); });
}

std::vector<OutputFit> output_rivals(const TwinBench& bench, const VectorXd& healthy_psi, const VectorXd& left,
                                     const Whitener& whitened) {
  std::vector<OutputFit> fits;
  fits.push_back({"sensor_offset", left_by(left, whitened(VectorXd::Ones(bench.samples())))});
  fits.push_back({"sensor_drift", left_by(left, whitened(time(bench)))});
  fits.push_back(
      {"side_input", std::min(left_by(left, whitened(warmth(bench))), left_by(left, whitened(supply(bench))))});
  fits.push_back({"intermittent", left_by_contact(bench, healthy_psi, left, whitened)});
  const double hertz = strongest_hz(bench, left);
  fits.push_back({"periodic_disturbance", left_by_tone(bench, left, whitened, [&](std::size_t i, Index k) {
                    return std::polar(1.0, kTwoPi * hertz * bench.time_s(i, k));
                  })});
  fits.push_back({"self_oscillation", left_by_best_hunting(bench, healthy_psi, left, whitened, hertz)});
  return fits;
}

}  // namespace valvetriage::hidden_effects
