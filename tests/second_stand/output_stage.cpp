#include "tests/second_stand/output_stage.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/second_stand/hydraulics.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kEddyMemoryS = 0.03;

}  // namespace

OutputStage::OutputStage(const Unit& unit, const Faults& faults, const Day& day, double begins_s, double step_s)
    : unit_(unit),
      faults_(faults),
      day_(day),
      begins_s_(begins_s),
      step_s_(step_s),
      now_s_(begins_s),
      warmth_(faults.warm_time_s, step_s),
      gauge_(unit.gauge_rad_s, unit.gauge_damping, step_s),
      turbulence_(day.past_seed, "turbulence"),
      eddies_(kEddyMemoryS, step_s) {}

void OutputStage::settle(double pressure_psi) {
  before_psi_ = pressure_psi * faults_.ratio;
  gauge_.settle(before_psi_);
  line_psi_.assign(1, before_psi_);
  gauge_psi_.assign(1, before_psi_);
}

void OutputStage::advance(double pressure_psi, double flow_ratio, double current_a, double change_a) {
  now_s_ += step_s_;
  const double staged = staged_psi(pressure_psi, current_a) + hunting_psi(pressure_psi) + turbulence_psi(flow_ratio);
  const double in_line = echoed_psi(staged) + stand_psi();
  double reading = gauge_.advance(0.5 * (before_psi_ + in_line));
  before_psi_ = in_line;
  reading += unit_.gauge_offset_psi + faults_.offset_psi + faults_.drift_psi_per_s * std::max(now_s_, 0.0);
  gauge_psi_.push_back(reading + faults_.pick_up_psi_s_per_a * change_a / step_s_);
}

double OutputStage::staged_psi(double pressure_psi, double current_a) {
  double gain = faults_.ratio;
  if (faults_.warm_gain_change != 0 && now_s_ > 0) {
    const double losses = (current_a / 1.6) * (current_a / 1.6);
    gain *= 1 + faults_.warm_gain_change * warmth_.advance(losses);
  }
  if (now_s_ >= faults_.contact_s) gain *= 1 + faults_.contact_gain_change;
  return gain * pressure_psi;
}

double OutputStage::hunting_psi(double pressure_psi) {
  if (faults_.hunting_psi == 0) return 0;
  // van der Pol: ẍ = μ ω (g - 4 x²) ẋ - ω² x has the amplitude √g; g is 1 at its level and negative far away
  constexpr double kStiffness = 0.4, kWidthPsi = 55, kAway = 0.6, kStir = 1e-3;
  const double from = (pressure_psi - faults_.hunting_level_psi) / kWidthPsi;
  const double growth = (1 + kAway) * std::exp(-from * from) - kAway;
  const double rad_s = kTurn * faults_.hunting_hz * (1 + 0.06 * from);
  cycle_rate_ += step_s_ * rad_s * (kStiffness * (growth - 4 * cycle_ * cycle_) * cycle_rate_ - cycle_ + kStir);
  cycle_ += step_s_ * rad_s * cycle_rate_;
  return faults_.hunting_psi * cycle_;
}

double OutputStage::turbulence_psi(double flow_ratio) {
  if (faults_.turbulence_psi == 0) return 0;
  const double to_unit_rms = std::sqrt(2 * kEddyMemoryS / step_s_);
  return faults_.turbulence_psi * flow_ratio * flow_ratio * eddies_.advance(to_unit_rms * turbulence_.normal());
}

double OutputStage::echoed_psi(double pressure_psi) {
  if (faults_.echo == 0) return pressure_psi;
  line_psi_.push_back(pressure_psi);
  const auto late = static_cast<std::size_t>(std::lround(faults_.echo_s / step_s_));
  const double back_psi = line_psi_[line_psi_.size() > late ? line_psi_.size() - 1 - late : 0];
  return (pressure_psi + faults_.echo * back_psi) / (1 + faults_.echo);
}

double OutputStage::stand_psi() const {
  double sum = 0;
  if (faults_.tone_psi != 0) {
    const double phase = kTurn * faults_.tone_hz * now_s_ + day_.tone_phase;
    sum += faults_.tone_psi * (std::sin(phase) + 0.15 * std::sin(2 * phase));
  }
  if (faults_.psi_per_c != 0) sum += faults_.psi_per_c * (day_.temperature_c.at(now_s_) - day_.mean_temperature_c);
  if (faults_.psi_per_supply_psi != 0)
    sum += faults_.psi_per_supply_psi * (day_.supply_psi_at(now_s_) - day_.mean_supply_psi);
  return sum;
}

double OutputStage::reading_psi(double t_s) const {
  const double late_s = faults_.gauge_delay_s + (t_s >= faults_.slip_at_s ? faults_.slip_s : 0);
  const double place =
      std::clamp((t_s - late_s - begins_s_) / step_s_, 0.0, static_cast<double>(gauge_psi_.size()) - 1.001);
  const auto k = static_cast<std::size_t>(place);
  return gauge_psi_[k] + (place - static_cast<double>(k)) * (gauge_psi_[k + 1] - gauge_psi_[k]);
}

}  // namespace valvetriage::second_stand
