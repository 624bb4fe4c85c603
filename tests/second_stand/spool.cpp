#include "tests/second_stand/spool.h"

#include <algorithm>
#include <cmath>

#include "tests/second_stand/magnet.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kSpeedMemoryS = 0.002;  // frictional memory
constexpr double kRestS = 0.3;           // half of the growth of breakaway at rest
constexpr double kAsperityRatio = 60;    // presliding stiffness over the spring's
constexpr int kMostEventsPerStep = 6;

double natural_rad_s(const Unit& unit) {
  return std::sqrt(1000 * unit.spring_n_per_mm / unit.mass_kg);
}

}  // namespace

Spool::Spool(const Unit& unit, const Faults& faults, double highest_mm, double step_s)
    : step_s_(step_s),
      spring_(unit.spring_n_per_mm),
      stroke_loss_(unit.stroke_loss_per_mm),
      preload_(unit.preload_n),
      full_mm_(balanced_lift_mm(unit, 2.0) - balanced_lift_mm(unit, 1.0)),
      closed_mm_(balanced_lift_mm(unit, 1.0)),
      highest_mm_(highest_mm),
      fresh_ratio_(unit.fresh_ratio),
      stribeck_mm_per_s_(unit.stribeck_mm_per_s),
      asperity_n_per_mm_(kAsperityRatio * unit.spring_n_per_mm),
      unit_(unit),
      free_(natural_rad_s(unit), unit.damping_ratio, step_s),
      remembered_speed_(kSpeedMemoryS, step_s) {
  const double ampere_n = force_of_ampere_n(unit);
  static_n_ = (unit.breakaway_a + faults.breakaway_a) * ampere_n;
  coulomb_n_ = (unit.breakaway_a * unit.kinetic_ratio + faults.kinetic_a) * ampere_n;
  cubic_ = faults.spring_cubic * spring_;
  fastest_mm_per_s_ = faults.slew_a_per_s * ampere_n / spring_;
}

double Spool::force_n(double coil_n, double lift_mm) const {
  const double z = (lift_mm - closed_mm_) / full_mm_;
  return coil_n * (1 - stroke_loss_ * lift_mm) - preload_ - spring_ * lift_mm - cubic_ * full_mm_ * z * z * z;
}

double Spool::breakaway_n(double rested_s) const {
  const double grown = fresh_ratio_ + (1 - fresh_ratio_) * rested_s / (rested_s + kRestS);
  return coulomb_n_ + (static_n_ - coulomb_n_) * grown;
}

double Spool::sliding_friction_n() const {
  const double ratio = remembered_speed_.value() / stribeck_mm_per_s_;
  return coulomb_n_ + (static_now_n_ - coulomb_n_) / (1 + ratio * ratio);
}

void Spool::place(double effective_a, double share, double rested_s) {
  const double coil_n = coil_force_n(unit_, effective_a);
  rested_s_ = rested_s;
  static_now_n_ = breakaway_n(0);
  // Newton steps for the lift at which spring and coil leave just this force to friction
  double lift_mm = balanced_lift_mm(unit_, effective_a);
  for (int i = 0; i < 8; ++i)
    lift_mm += (force_n(coil_n, lift_mm) - share * static_now_n_) / (spring_ + stroke_loss_ * coil_n);
  motion_ = {std::clamp(lift_mm, 0.0, highest_mm_), 0};
  if (motion_.position != lift_mm) return stop_at(motion_.position);
  come_to_rest(coil_n);
  rested_s_ = rested_s;
}

double Spool::advance(double effective_a) {
  const double coil_n = coil_force_n(unit_, effective_a);
  double left_s = step_s_;
  for (int event = 0; left_s > 0 && event < kMostEventsPerStep; ++event) {
    if (phase_ == Phase::kStopped) leave_stop(coil_n);
    if (phase_ == Phase::kStuck) hold(coil_n, left_s);
    if (phase_ != Phase::kSliding) break;
    left_s = slide(coil_n, left_s);
  }
  remembered_speed_.advance(std::abs(speed_mm_per_s()));
  return motion_.position;
}

void Spool::hold(double coil_n, double seconds) {
  // the asperities take what the spring leaves: k_t (x - anchor) = force(x), linear but for the small cubic part
  const double slope = asperity_n_per_mm_ + spring_ + stroke_loss_ * coil_n;
  for (int i = 0; i < 2; ++i) {
    const double held = asperity_n_per_mm_ * (motion_.position - anchor_mm_);
    motion_.position += (force_n(coil_n, motion_.position) - held) / slope;
  }
  const double held = asperity_n_per_mm_ * (motion_.position - anchor_mm_);
  static_now_n_ = breakaway_n(rested_s_);
  rested_s_ += seconds;
  if (std::abs(held) <= static_now_n_) return;
  phase_ = Phase::kSliding;
  direction_ = std::copysign(1, held);
  motion_.speed = 0;
  remembered_speed_.settle(0);
}

double Spool::slide(double coil_n, double seconds) {
  const auto moved = [&](double time_s) {
    const double push = force_n(coil_n, motion_.position) + spring_ * motion_.position;
    const double target = (push - direction_ * sliding_friction_n()) / spring_;
    return time_s == step_s_ ? free_.advanced(motion_, target) : free_.advanced(motion_, target, time_s);
  };
  Oscillator::State next = moved(seconds);
  double used_s = seconds;
  const bool turns = next.speed * direction_ < 0;
  if (turns) {  // the instant of standstill
    double before_s = 0;
    for (int halving = 0; halving < 24; ++halving) {
      const double middle_s = 0.5 * (before_s + used_s);
      (moved(middle_s).speed * direction_ < 0 ? used_s : before_s) = middle_s;
    }
    next = moved(used_s);
    next.speed = 0;
  }
  const double farthest_mm = fastest_mm_per_s_ * used_s;
  if (std::abs(next.position - motion_.position) > farthest_mm) {
    next.position = motion_.position + std::copysign(farthest_mm, next.position - motion_.position);
    next.speed = std::clamp(next.speed, -fastest_mm_per_s_, fastest_mm_per_s_);
  }
  motion_ = next;
  if (motion_.position < 0 || motion_.position > highest_mm_)
    stop_at(std::clamp(motion_.position, 0.0, highest_mm_));
  else if (turns)
    come_to_rest(coil_n);
  return seconds - used_s;
}

void Spool::come_to_rest(double coil_n) {
  const double force = force_n(coil_n, motion_.position);
  motion_.speed = 0;
  static_now_n_ = breakaway_n(0);
  direction_ = std::copysign(1, force);
  if (std::abs(force) > static_now_n_) {
    phase_ = Phase::kSliding;
    return;
  }
  phase_ = Phase::kStuck;
  rested_s_ = 0;
  anchor_mm_ = motion_.position - force / asperity_n_per_mm_;
}

void Spool::stop_at(double lift_mm) {
  motion_ = {lift_mm, 0};
  phase_ = Phase::kStopped;
  direction_ = lift_mm > 0 ? -1 : 1;  // the only way out
}

void Spool::leave_stop(double coil_n) {
  if (force_n(coil_n, motion_.position) * direction_ <= coulomb_n_) return;
  phase_ = Phase::kSliding;
  static_now_n_ = breakaway_n(0);
}

}  // namespace valvetriage::second_stand
