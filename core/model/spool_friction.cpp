#include "core/model/spool_friction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

namespace valvetriage {
namespace {

constexpr double kStepOverNatural = 0.15;
constexpr int kMostSubsteps = 64;
// A lag never arrives; this near it has [A].
constexpr double kArrived = 1e-9;
// Each step of a spool waits for the one before: several one beside another keep a processor busy.
constexpr std::size_t kSideBySide = 4;

/// The input at any time, straight inside an interval, held before the first.
class DelayedInput {
 public:
  DelayedInput(const IntervalSignal& input, std::size_t samples, double period_s, double delay_s)
      : input_(input), last_(samples - 1), delay_(delay_s / period_s) {}

  /// time in samples
  double at(double time) const {
    const double t = time - delay_;
    if (t <= 0) return input_.start[0];
    const auto m = std::min(static_cast<std::size_t>(t), last_);
    const double share = std::min(t - static_cast<double>(m), 1.0);
    return input_.start[m] + (input_.end[m] - input_.start[m]) * share;
  }

  /// When it jumps between two times that are no farther apart than a sample; empty where it does not.
  std::optional<double> jump_between(double from, double to) const {
    const double t = to - delay_;
    if (t < 1) return std::nullopt;
    const auto m = std::min(static_cast<std::size_t>(t), last_);
    const double edge = static_cast<double>(m) + delay_;
    const bool is_inside = edge > from && edge < to;
    return is_inside && input_.start[m] != input_.end[m - 1] ? std::optional(edge) : std::nullopt;
  }

  /// Whether all of the sample interval that begins at sample i sees no values but these.
  bool stays_within(std::size_t i, double lowest, double highest) const {
    const double t = static_cast<double>(i) - delay_;
    const auto first = t <= 0 ? 0 : std::min(static_cast<std::size_t>(t), last_);
    const auto last = std::min(t + 1 <= 0 ? 0 : static_cast<std::size_t>(t + 1), last_);
    for (std::size_t m = first; m <= last; ++m) {
      const auto [low, high] = std::minmax(input_.start[m], input_.end[m]);
      if (!(low >= lowest && high <= highest)) return false;
    }
    return true;
  }

 private:
  const IntervalSignal& input_;
  std::size_t last_;
  double delay_;
};

/// Where the slips of a spool begin whose rests are known.
class KnownRests {
 public:
  explicit KnownRests(std::span<const double> rests) : rests_(rests) {}

  void slipped() { has_slipped_ = true; }
  /// For a spool that stands at x at sample i. A rest it has slipped from is no other place to slip from.
  double next_slip_from(std::size_t i, double x) {
    if (rests_.empty() || !has_slipped_ || !std::isfinite(rests_[i]) || rests_[i] == last_) return x;
    has_slipped_ = false;
    last_ = rests_[i];
    return last_;
  }

 private:
  std::span<const double> rests_;
  bool has_slipped_ = true;
  double last_ = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace

int sliding_substeps(const ValveDynamics& dynamics, double sample_period_s) {
  const double steps = std::ceil(dynamics.natural_frequency_rad_s * sample_period_s / kStepOverNatural);
  return static_cast<int>(std::clamp(steps, 2.0, static_cast<double>(kMostSubsteps)));
}

namespace {

/// One spool on its way through a recording.
class SlidingSpool {
 public:
  explicit SlidingSpool(const SlidingRun& run)
      : run_(run),
        substeps_(sliding_substeps(*run.dynamics, run.sample_period_s)),
        delayed_(*run.input, run.position.size(), run.sample_period_s, run.dynamics->delay_s),
        known_(run.rests) {
    per_substep_ = 1.0 / substeps_;
    whole_ = step_over(per_substep_);
    breakaway_ = run.friction->breakaway_a;
    kinetic_ = std::min(run.friction->kinetic_a, breakaway_);
    inverse_speed_ = 1 / run.friction->stribeck_a_per_s;
    lagged_ = delayed_.at(0);
    x_ = lagged_ - run.offset * breakaway_ * run.friction->growth.share_at(lagged_);
    if (!run.rests.empty() && std::isfinite(run.rests[0])) x_ = known_.next_slip_from(0, run.rests[0]);
    landed_ = x_;
  }

  std::size_t samples() const { return run_.position.size(); }
  int substeps() const { return substeps_; }
  bool moves() const { return moves_; }

  void begin(std::size_t i) {
    if (v_ == 0) x_ = known_.next_slip_from(i, x_);
    run_.position[i] = v_ == 0 ? landed_ : x_;
    const double most = breakaway_ * run_.friction->growth.share_at(x_);
    const bool sticks = v_ == 0 && std::abs(lagged_ - x_) <= most;
    const bool is_lagged = whole_.half_way < 1;
    moves_ = !sticks ||
             !(is_lagged ? delayed_.stays_within(i, lagged_, lagged_) : delayed_.stays_within(i, x_ - most, x_ + most));
    if (!moves_ && !is_lagged) lagged_ = delayed_.at(static_cast<double>(i) + (substeps_ - 0.5) * per_substep_);
  }

  /// One that the input jumps in is taken in two: what the jump sets free sets off then, not with the next substep, and
  /// how late it does goes with the delay, not in steps of it.
  void substep(std::size_t i, int k) {
    const double from = static_cast<double>(i) + k * per_substep_, to = from + per_substep_;
    if (const auto jump = delayed_.jump_between(from, to)) {
      advance(step_over(*jump - from), delayed_.at(0.5 * (from + *jump)));
      advance(step_over(to - *jump), delayed_.at(0.5 * (*jump + to)));
    } else {
      advance(whole_, delayed_.at(static_cast<double>(i) + (k + 0.5) * per_substep_));
    }
  }

 private:
  /// The trapezoidal rule over some time.
  struct Step {
    double keep = 0, push = 0, share = 0, half_s = 0;
    double half_way = 1;  ///< of the lag, over half of it
  };

  /// Over some samples.
  Step step_over(double samples) const {
    const ValveDynamics& dynamics = *run_.dynamics;
    const double wn = dynamics.natural_frequency_rad_s, h = samples * run_.sample_period_s;
    const double stiff = 0.25 * h * h * wn * wn, damp = h * dynamics.damping_ratio * wn;
    const double lag_s = dynamics.lag_s.empty() ? 0 : dynamics.lag_s.front();
    return {.keep = 1 - stiff - damp,
            .push = h * wn * wn,
            .share = 1 / (1 + stiff + damp),
            .half_s = 0.5 * h,
            .half_way = lag_s > 0 ? -std::expm1(-0.5 * h / lag_s) : 1};
  }

  /// At a speed, over what it grows by along the way.
  double force_at(double speed) const {
    const double relative = speed * inverse_speed_;
    const double square = relative * relative;
    const double drop = breakaway_ - kinetic_;
    return kinetic_ + (square == 0 ? drop : square < 30 ? drop * std::exp(-square) : 0);
  }

  void advance(const Step& step, double commanded) {
    double u = commanded;
    if (step.half_way == 1) {
      lagged_ = commanded;
    } else {
      u = lagged_ += step.half_way * (commanded - lagged_);
      lagged_ += step.half_way * (commanded - lagged_);
      if (std::abs(commanded - lagged_) < kArrived) lagged_ = commanded;
    }
    // The speed without friction, and what friction takes of it: at most all.
    const double free = v_ * step.keep + step.push * (u - x_);
    const double push = step.push * run_.friction->growth.share_at(x_);
    if (v_ == 0 && std::abs(free) <= push * kinetic_) return;
    const double most = push * force_at(v_);
    const double moved = step.share * (free - std::clamp(free, -most, most));
    if (v_ != 0 && moved == 0) {
      // Slowed as it is it comes to rest inside the step. A whole step would carry it on by up to a few per cent of a
      // slip, and by more or less from one slip to the next.
      x_ += step.half_s * v_ * v_ / (v_ - step.share * (free - std::copysign(most, v_)));
      landed_ = x_;
      known_.slipped();
    } else {
      x_ += step.half_s * (v_ + moved);
    }
    v_ = moved;
  }

  const SlidingRun& run_;
  int substeps_ = 1;
  DelayedInput delayed_;
  KnownRests known_;
  double per_substep_ = 0;
  Step whole_;
  double breakaway_ = 0, kinetic_ = 0, inverse_speed_ = 0;
  double lagged_ = 0, x_ = 0, v_ = 0, landed_ = 0;
  bool moves_ = false;
};

}  // namespace

void run_sliding_spools(std::span<const SlidingRun> runs) {
  std::vector<SlidingSpool> spools;
  for (const SlidingRun& run : runs) {
    if (!run.position.empty()) spools.emplace_back(run);
  }
  for (std::size_t first = 0; first < spools.size(); first += kSideBySide) {
    const auto some = std::span(spools).subspan(first, std::min(kSideBySide, spools.size() - first));
    std::size_t longest = 0;
    for (const SlidingSpool& spool : some) longest = std::max(longest, spool.samples());
    for (std::size_t i = 0; i < longest; ++i) {
      std::array<SlidingSpool*, kSideBySide> moving{};
      std::size_t count = 0;
      int most_substeps = 0;
      for (SlidingSpool& spool : some) {
        if (i >= spool.samples()) continue;
        spool.begin(i);
        if (!spool.moves()) continue;
        moving[count++] = &spool;
        most_substeps = std::max(most_substeps, spool.substeps());
      }
      for (int k = 0; k < most_substeps; ++k) {
        for (std::size_t j = 0; j < count; ++j) {
          if (k < moving[j]->substeps()) moving[j]->substep(i, k);
        }
      }
    }
  }
}

void run_sliding_spool(const ValveDynamics& dynamics, const SpoolFriction& friction, double sample_period_s,
                       const IntervalSignal& input, double offset, std::span<double> position,
                       std::span<const double> rests) {
  const SlidingRun run{&dynamics, &friction, sample_period_s, &input, offset, position, rests};
  run_sliding_spools({&run, 1});
}

}  // namespace valvetriage
