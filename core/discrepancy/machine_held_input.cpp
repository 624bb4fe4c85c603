#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "core/discrepancy/machine_linear.h"

namespace valvetriage {
namespace {

// A valve moves on after a reversal once the input has gone back by breakaway + kinetic: a small error in this sum
// moves every slip or leaves it out. The jump, breakaway - kinetic, is a height; where the valve stands at first shifts
// all places that it jumps to, for ever.
constexpr double kLeastBand = 0.1, kMostBand = 0.99, kBandRatio = 1.03;  // of the input's range
constexpr std::array kJumps{0.04, 0.14, 0.24, 0.34, 0.46, 0.7};          // of the band
constexpr int kHolds = 12;                                               // on either side of the first input
constexpr std::array kLagsSamples{1.0, 2.0, 3.5, 6.0, 11.0, 25.0};
constexpr double kIntegrates = std::numeric_limits<double>::infinity();
constexpr double kForgets = 30;  // samples, after which an integrating machine's errors do not count
constexpr int kDelays = 12;
constexpr std::size_t kCoarseRows = 400, kFewestRows = 100;
constexpr std::array kFinerSteps{0.04, 0.02, 0.01, 0.005, 0.002};  // of the band
constexpr int kTries = 40;                                         // of each of them, any way
constexpr std::size_t kRefined = 60, kKept = 2;

/// How a valve sticks [scaled units]: how far the input must go back until it moves on, how far it then jumps, and how
/// far it stands off the first input.
struct Stick {
  double band = 0, jump = 0, hold = 0;

  double breakaway() const { return 0.5 * (band + jump); }
  double kinetic() const { return 0.5 * (band - jump); }
};

/// A stick, the lag and delay behind it, and what they leave of the output in free run.
struct Held {
  Stick stick;
  double lag_samples = 0;
  int delay = 0;
  double left = std::numeric_limits<double>::infinity();  ///< of the squares
};

MachineBlock block_of(const Stick& stick) {
  MachineBlock block;
  block.law = MachineLaw::kStickSlip;
  block.parameters = {stick.breakaway(), stick.kinetic()};
  return block;
}

/// What a lag makes of a signal about its mean.
std::vector<double> behind_lag(std::span<const double> x, double lag_samples) {
  double mean = 0;
  for (const double value : x) mean += value / static_cast<double>(x.size());
  const double keep = std::exp(-1 / lag_samples);
  std::vector<double> y(x.size());
  double state = x.front() - mean;
  for (std::size_t t = 0; t < x.size(); ++t) y[t] = state = keep * state + (1 - keep) * (x[t] - mean);
  return y;
}

/// A signal without what is slower than an integrating machine's errors count: such a machine is then a lag, too.
std::vector<double> without_slow(std::span<const double> y) {
  std::vector<double> rest = behind_lag(y, kForgets);
  for (std::size_t t = 0; t < y.size(); ++t) rest[t] = y[t] - rest[t];
  return rest;
}

/// Sums over the rows that one regressor and a constant are solved by.
struct Sums {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;

  void add(double a, double b) {
    n += 1;
    x += a;
    y += b;
    xx += a * a;
    xy += a * b;
    yy += b * b;
  }
  /// Share of y's squares about its mean that g x + c leaves.
  double left() const {
    const double sxx = xx - x * x / n, sxy = xy - x * y / n, syy = yy - y * y / n;
    return 1 - sxy * sxy / std::max(sxx * syy, 1e-12);
  }
};

class Search {
 public:
  Search(const MachineData& data, const MachineGround& ground)
      : data_(data), least_delay_(ground.least_delay), range_(ground.input_range()) {
    for (const MachineRecord& record : data.records) fast_outputs_.push_back(without_slow(record.output));
  }

  std::vector<Held> coarse() const {
    const std::vector<double> lags = all_lags();
    std::vector<Held> tried;
    for (double share = kLeastBand; share < kMostBand; share *= kBandRatio) {
      for (const double jump : kJumps) {
        for (int hold = -kHolds; hold <= kHolds; ++hold) {
          Stick stick{share * range_, jump * share * range_, 0};
          stick.hold = stick.breakaway() * hold / kHolds;
          tried.push_back(judged(stick, lags, least_delay_, kDelays, kCoarseRows));
        }
      }
    }
    std::stable_sort(tried.begin(), tried.end(), [](const auto& a, const auto& b) { return a.left < b.left; });
    return tried;
  }

  Held behind(const Stick& stick) const { return judged(stick, all_lags(), least_delay_, kDelays, kLinearRows); }

  /// Slips come or do not come: the cost has no slope in what they hang on, and is searched by ever smaller steps.
  Held refined(Held best) const {
    best.left = std::numeric_limits<double>::infinity();
    std::mt19937_64 random(1);
    const auto uniform = [&] { return std::ldexp(static_cast<double>(random() >> 11U), -52) - 1; };
    for (const double step : kFinerSteps) {
      for (int i = 0; i < kTries; ++i) {
        Stick moved = best.stick;
        const double size = i > 0 ? step * best.stick.band : 0;
        moved.band += size * uniform();
        moved.jump += size * uniform();
        moved.hold += size * uniform();
        if (!(moved.jump > 0 && moved.jump < moved.band)) continue;
        const double lag = best.lag_samples;
        const int first = std::max(least_delay_, best.delay - 1);
        const Held held = judged(moved, {lag * (1 - 4 * step), lag, lag * (1 + 4 * step)}, first,
                                 best.delay + 2 - first, kLinearRows);
        if (held.left < best.left) best = held;
      }
    }
    return best;
  }

  MachineFit solved(const Held& held) const {
    MachineData behind;
    behind.records = data_.records;
    behind.period_s = data_.period_s;
    for (std::size_t r = 0; r < data_.records.size(); ++r) behind.records[r].input = held_input(held.stick, r);
    const std::complex<double> pole = std::exp(-1 / held.lag_samples);
    LinearMachine machine = linear_machine(1, std::span(&pole, 1), held.delay, 1, behind);
    MachineFit fit;
    fit.failed = !solve_linear(behind, machine);
    if (fit.failed) return fit;
    fit = std::move(machine.fit);
    fit.machine.blocks.insert(fit.machine.blocks.begin(), block_of(held.stick));
    for (FreeParameter& p : fit.free) p.block += 1;
    fit.free.push_back({0, MachineField::kParameter, 0, true, 1e-6, range_});
    fit.free.push_back({0, MachineField::kParameter, 1, true, 1e-7, range_});
    for (auto& start : fit.starts) start.insert(start.begin(), held.stick.hold);
    return fit;
  }

 private:
  static std::vector<double> all_lags() {
    std::vector<double> lags(kLagsSamples.begin(), kLagsSamples.end());
    lags.push_back(kIntegrates);
    return lags;
  }

  std::vector<double> held_input(const Stick& stick, std::size_t record) const {
    std::vector<double> held(data_.records[record].input.size());
    run_block(block_of(stick), data_.period_s, {}, std::span(&stick.hold, 1), data_.records[record].input, held);
    return held;
  }

  /// The best of some lags and delays behind a stick, by about so many samples.
  Held judged(const Stick& stick, const std::vector<double>& lags, int first_delay, int delays,
              std::size_t rows) const {
    const std::size_t step = std::max<std::size_t>(1, data_.samples() / rows);
    std::vector<std::vector<double>> held;
    for (std::size_t r = 0; r < data_.records.size(); ++r) held.push_back(held_input(stick, r));
    Held best{.stick = stick};
    for (const double lag : lags) {
      const bool integrates = std::isinf(lag);
      std::vector<Sums> sums(static_cast<std::size_t>(delays));
      for (std::size_t r = 0; r < data_.records.size(); ++r) {
        const auto& valid = data_.records[r].valid;
        const std::vector<double>& output = integrates ? fast_outputs_[r] : data_.records[r].output;
        const std::vector<double> lagged = behind_lag(held[r], integrates ? kForgets : lag);
        const auto most = static_cast<std::size_t>(first_delay + delays + (integrates ? 4 * kForgets : 0));
        const auto from = std::lower_bound(valid.begin(), valid.end(), most) - valid.begin();
        for (std::size_t i = static_cast<std::size_t>(from); i < valid.size(); i += step) {
          for (int d = 0; d < delays; ++d) {
            const std::size_t delay = static_cast<std::size_t>(first_delay + d);
            sums[static_cast<std::size_t>(d)].add(lagged[valid[i] - delay], output[valid[i]]);
          }
        }
      }
      for (int d = 0; d < delays; ++d) {
        const Sums& sum = sums[static_cast<std::size_t>(d)];
        if (sum.n >= kFewestRows && sum.left() < best.left) best = {stick, lag, first_delay + d, sum.left()};
      }
    }
    return best;
  }

  const MachineData& data_;
  std::vector<std::vector<double>> fast_outputs_;
  int least_delay_;
  double range_;
};

}  // namespace

std::vector<MachineFit> held_input_frictions(const MachineData& data, const MachineGround& ground) {
  const Search search(data, ground);
  std::vector<Held> best = search.coarse();
  if (best.size() > kRefined) best.resize(kRefined);
  for (Held& held : best) held = search.refined(held);
  std::stable_sort(best.begin(), best.end(), [](const auto& a, const auto& b) { return a.left < b.left; });
  if (best.size() > kKept) best.resize(kKept);
  std::vector<MachineFit> fits;
  for (const Held& held : best) {
    MachineFit fit = search.solved(held);
    if (!fit.failed) fits.push_back(std::move(fit));
  }
  return fits;
}

MachineFit held_input_friction(const MachineData& data, const MachineGround& ground, double breakaway, double kinetic) {
  const Search search(data, ground);
  const Held held = search.behind({.band = breakaway + kinetic, .jump = breakaway - kinetic, .hold = 0});
  MachineFit fit;
  fit.failed = !std::isfinite(held.left);
  if (fit.failed) return fit;
  fit = search.solved(held);
  std::erase_if(fit.free, [](const FreeParameter& p) { return p.block == 0; });
  return fit;
}

}  // namespace valvetriage
