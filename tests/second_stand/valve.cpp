#include "tests/second_stand/valve.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/linear_parts.h"
#include "tests/second_stand/magnet.h"
#include "tests/second_stand/output_stage.h"
#include "tests/second_stand/port.h"
#include "tests/second_stand/preisach.h"
#include "tests/second_stand/spool.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kSettlingS = 1.5;  // at the first command, before the record begins

/// (1) driver and latency, (2) eddy currents, (3) magnetic memory: from command to effective current.
class Coil {
 public:
  Coil(const Unit& unit, const Faults& faults, double step_s)
      : driver_(unit.driver_rad_s, unit.driver_damping, step_s),
        eddy_(unit.eddy_time_s, step_s),
        shorted_turn_(faults.shorted_turn_s, step_s),
        has_mode_(faults.mode_rad_s > 0),
        eddy_share_(unit.eddy_share),
        iron_(unit.loop_width_a + faults.loop_a) {
    if (has_mode_) mode_ = Resonator(faults.mode_rad_s, faults.mode_damping, step_s);
  }

  /// Magnetised by a past of its own, then settled at a current.
  void settle(double current_a, Random past) {
    for (int visit = 0; visit < 6; ++visit) iron_.advance(past.between(0.3, 2.3));
    driver_.settle(current_a);
    eddy_.settle(current_a);
    shorted_turn_.settle(current_a);
    current_a_ = current_a;
    effective_a_ = iron_.advance(current_a);
    mode_.settle(effective_a_);
  }

  /// Mean effective current of the step.
  double advance(double commanded_a) {
    const double before_a = current_a_;
    current_a_ = driver_.advance(commanded_a);
    change_a_ = current_a_ - before_a;
    const double flux_a = (1 - eddy_share_) * current_a_ + eddy_share_ * eddy_.advance(0.5 * (before_a + current_a_));
    const double now_a = iron_.advance(shorted_turn_.advance(flux_a));
    const double mean_a = 0.5 * (effective_a_ + now_a);
    effective_a_ = now_a;
    return has_mode_ ? mode_.advance(mean_a) : mean_a;
  }

  double current_a() const { return current_a_; }
  double change_a() const { return change_a_; }
  double effective_a() const { return effective_a_; }

 private:
  Resonator driver_, mode_;
  Lag eddy_, shorted_turn_;
  bool has_mode_;
  double eddy_share_;
  Preisach iron_;
  double current_a_ = 0, change_a_ = 0, effective_a_ = 0;
};

/// Play between armature and spool.
class Linkage {
 public:
  explicit Linkage(double width_mm) : half_mm_(0.5 * width_mm) {}
  void settle(double armature_mm, double share) { spool_mm_ = armature_mm + share * half_mm_; }
  double advance(double armature_mm) {
    return spool_mm_ = std::clamp(spool_mm_, armature_mm - half_mm_, armature_mm + half_mm_);
  }

 private:
  double half_mm_, spool_mm_ = 0;
};

/// (6) port and (7) volume, with what may happen in the port's flow.
class Chamber {
 public:
  Chamber(const Unit& unit, const Faults& faults, const Port& port, double step_s)
      : unit_(unit), faults_(faults), port_(port), step_s_(step_s), flow_at_120_(port.outlet().through(120)) {
    clings_mm_ = balanced_lift_mm(unit, 1.65);
    lets_go_mm_ = balanced_lift_mm(unit, 1.5);
  }

  void settle(double lift_mm) {
    lift_mm_ = lift_mm;
    pressure_psi_ = balanced_psi(port_.area(lift_mm), port_.outlet());
  }

  /// Heun's step while the spool goes straight to its new lift.
  double advance(double lift_mm) {
    const double speed = (lift_mm - lift_mm_) / step_s_;
    const double at_begin = rate(lift_mm_, speed, pressure_psi_);
    silt(std::abs(speed));
    lift_mm_ = lift_mm;
    cling();
    const double at_end = rate(lift_mm, speed, pressure_psi_ + step_s_ * at_begin);
    return pressure_psi_ += 0.5 * step_s_ * (at_begin + at_end);
  }

  double pressure_psi() const { return pressure_psi_; }
  double flow_ratio() const { return port_.outlet().through(pressure_psi_) / flow_at_120_; }

 private:
  double rate(double lift_mm, double speed_mm_per_s, double pressure_psi) const {
    constexpr double kDisplacedPsiPerMm = 0.5;  // the spool's end takes its volume from the chamber
    double area = port_.area(lift_mm) * (1 - faults_.silting * silt_);
    if (clings_) area *= 1 + faults_.jet_change;
    const double net = port_flow(area, kSupplyPsi - pressure_psi) - port_.outlet().flow(pressure_psi) -
                       kDisplacedPsiPerMm * speed_mm_per_s;
    const double capacity = unit_.volume * air_capacity(unit_.air, pressure_psi);
    return net / (net < 0 ? capacity * faults_.fall_to_rise : capacity);
  }

  /// Dirt settles in a standing port within a second and is washed out by some hundredths of a millimetre of motion.
  void silt(double speed_mm_per_s) {
    constexpr double kSettlesS = 0.8, kWashesMm = 0.03;
    const double settles = step_s_ / kSettlesS, washes = step_s_ * speed_mm_per_s / kWashesMm;
    silt_ = (silt_ + settles) / (1 + settles + washes);
  }

  /// The jet clings to the wall above one lift and lets go below another.
  void cling() {
    if (lift_mm_ > clings_mm_) clings_ = true;
    if (lift_mm_ < lets_go_mm_) clings_ = false;
  }

  const Unit& unit_;
  const Faults& faults_;
  const Port& port_;
  double step_s_, flow_at_120_, clings_mm_, lets_go_mm_;
  double lift_mm_ = 0, pressure_psi_ = 0, silt_ = 0;
  bool clings_ = false;
};

}  // namespace

std::vector<double> play_valve(const Unit& unit, const Faults& faults, const Command& command, const Day& day,
                               double dither_a, double step_s) {
  Random past(day.past_seed, "past");
  const Port port(unit, faults);
  Coil coil(unit, faults, step_s);
  Spool spool(unit, faults, port.highest_mm(), step_s);
  Linkage linkage(faults.play_a * force_of_ampere_n(unit) / unit.spring_n_per_mm);
  Chamber chamber(unit, faults, port, step_s);
  OutputStage output(unit, faults, day, -kSettlingS, step_s);

  coil.settle(command.value_a.front(), Random(day.past_seed, "magnetic past"));
  const double share = past.between(-0.9, 0.9), rested_s = past.log_between(0.1, 100);
  spool.place(coil.effective_a(), share, rested_s);
  linkage.settle(spool.lift_mm(), past.between(-1, 1));
  chamber.settle(linkage.advance(spool.lift_mm()));
  output.settle(chamber.pressure_psi());

  CommandReader reader(command);
  const auto steps = static_cast<long>(std::ceil((command.instant_s.back() + kSettlingS) / step_s)) + 1;
  for (long k = 0; k < steps; ++k) {
    const double from_s = static_cast<double>(k) * step_s - kSettlingS, to_s = from_s + step_s;
    double commanded_a = reader.mean(from_s - unit.latency_s, to_s - unit.latency_s);
    if (dither_a != 0) commanded_a += dither_a * std::sin(2 * std::numbers::pi * kDitherHz * (from_s + 0.5 * step_s));
    chamber.advance(linkage.advance(spool.advance(coil.advance(commanded_a))));
    output.advance(chamber.pressure_psi(), chamber.flow_ratio(), coil.current_a(), coil.change_a());
  }
  std::vector<double> readings_psi;
  for (const double instant_s : command.instant_s) readings_psi.push_back(output.reading_psi(instant_s));
  return readings_psi;
}

double steady_psi(const Unit& unit, const Faults& faults, double current_a) {
  const Port port(unit, faults);
  const double lift_mm = std::clamp(balanced_lift_mm(unit, current_a), 0.0, port.highest_mm());
  return faults.ratio * balanced_psi(port.area(lift_mm), port.outlet());
}

}  // namespace valvetriage::second_stand
