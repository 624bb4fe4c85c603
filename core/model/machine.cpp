#include "core/model/machine.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using In = std::span<const double>;
using Out = std::span<double>;

constexpr double kLeaves = Machine::kLeaves;
constexpr int kLoopPlays = Machine::kLoopPlays;
constexpr int kSubSteps = Machine::kSubSteps;
constexpr double kStraight = Machine::kStraight;
constexpr std::size_t kSettleEvery = Machine::kSettleEvery;

/// A cascade of sections at work, its basis signals from the last section to the first.
class Cascade {
 public:
  Cascade(const std::vector<Section>& sections, double rest, In start) {
    std::size_t at = 0;
    for (const Section& section : sections) {
      SectionState state(section, rest);
      if (!start.empty()) {
        state.level += start[at++];
        if (section.order == 2) state.difference += start[at++];
      }
      states_.push_back(state);
      orders_.push_back(section.order);
    }
  }

  void step(double x) {
    input_ = x;
    for (SectionState& state : states_) x = state.step(x);
  }
  void settle() {
    for (SectionState& state : states_) state.settle();
  }
  /// Σ weight_i basis_i, for as many weights as there are.
  double output(In weights) const {
    double sum = 0;
    std::size_t i = 0;
    for (std::size_t s = states_.size(); s-- > 0 && i < weights.size();) {
      sum += weights[i++] * states_[s].level;
      if (orders_[s] == 2 && i < weights.size()) sum += weights[i++] * states_[s].difference;
    }
    if (i < weights.size()) sum += weights[i] * input_;
    return sum;
  }
  void basis(Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> row) const {
    Index i = 0;
    for (std::size_t s = states_.size(); s-- > 0 && i < row.size();) {
      row[i++] = states_[s].level;
      if (orders_[s] == 2 && i < row.size()) row[i++] = states_[s].difference;
    }
    if (i < row.size()) row[i] = input_;
  }

 private:
  std::vector<SectionState> states_;
  std::vector<int> orders_;
  double input_ = 0;
};

double delayed(In in, std::size_t t, int delay) {
  const auto d = static_cast<std::size_t>(delay);
  return in[t > d ? t - d : 0];
}

void run_linear(const MachineBlock& block, In start, In in, Out out) {
  Cascade cascade(block.sections, in[0], start);
  const std::vector<double> copy(in.begin(), in.end());
  for (std::size_t t = 0; t < in.size(); ++t) {
    cascade.step(delayed(copy, t, block.delay_samples));
    if (t % kSettleEvery == 0) cascade.settle();
    out[t] = cascade.output(block.numerator);
  }
}

double cube(double x) {
  return x * x * x;
}

/// y of y = linear + curved (y − centre)³, by Newton from the linear answer.
double spring_at_rest(double linear, double curved, double centre) {
  double y = linear;
  for (int i = 0; i < 50; ++i) {
    const double z = y - centre;
    const double slope = 1 - 3 * curved * z * z;
    if (std::abs(slope) < 1e-9) break;
    y -= (y - linear - curved * cube(z)) / slope;
  }
  return std::isfinite(y) ? y : linear;
}

void run_spring(const MachineBlock& block, In start, In in, Out out) {
  const double centre = block.parameters[0];
  const double rest = spring_at_rest(gain_at_rest(block.sections, block.numerator) * in[0],
                                     gain_at_rest(block.sections, block.feedback), centre);
  Cascade forward(block.sections, in[0], start);
  Cascade feedback(block.sections, cube(rest - centre), {});
  const std::vector<double> copy(in.begin(), in.end());
  double y = rest;
  for (std::size_t t = 0; t < in.size(); ++t) {
    forward.step(delayed(copy, t, block.delay_samples));
    feedback.step(cube(y - centre));
    y = forward.output(block.numerator) + feedback.output(block.feedback);
    if (!(std::abs(y) < kLeaves)) {
      std::fill(out.begin() + static_cast<std::ptrdiff_t>(t), out.end(), std::numeric_limits<double>::quiet_NaN());
      return;
    }
    out[t] = y;
  }
}

/// h after dh/dx = 1 − rate h over a length of x.
double grown(double h, double rate, double length) {
  const double bent = rate * length;
  return h * std::exp(-bent) + (std::abs(bent) < kStraight ? length : -std::expm1(-bent) / rate);
}

/// Where a parabola through three values turns between the last two; the earlier of these where it does not.
double turning_point(double long_before, double before, double now) {
  const double rise = 0.5 * (now - long_before), bend = now - 2 * before + long_before, at = -rise / bend;
  return at > 0 && at < 1 ? before + 0.5 * rise * at : before;
}

void run_restoring_loop(const MachineBlock& block, In start, In in, Out out) {
  const double beta = block.parameters[0], delta = block.parameters[1];
  const auto states = static_cast<std::size_t>(order_of(block.sections));
  Cascade forward(block.sections, in[0], start.empty() ? start : start.first(states));
  double h = start.empty() ? 0 : start[states];
  Cascade feedback(block.sections, h, {});
  const std::vector<double> copy(in.begin(), in.end());
  double y = gain_at_rest(block.sections, block.numerator) * in[0] + gain_at_rest(block.sections, block.feedback) * h;
  double before = y, long_before = y;
  for (std::size_t t = 0; t < in.size(); ++t) {
    const double turn = turning_point(long_before, before, y);
    h = loop_after(h, turn - before, beta, delta);
    h = loop_after(h, y - turn, beta, delta);
    long_before = before;
    before = y;
    forward.step(delayed(copy, t, block.delay_samples));
    feedback.step(h);
    y = forward.output(block.numerator) + feedback.output(block.feedback);
    if (!(std::abs(y) < kLeaves)) {
      std::fill(out.begin() + static_cast<std::ptrdiff_t>(t), out.end(), std::numeric_limits<double>::quiet_NaN());
      return;
    }
    out[t] = y;
    if (t == 0) before = long_before = y;
  }
}

void run_motion(const MachineBlock& block, double period_s, In start, In in, Out out) {
  const auto& p = block.parameters;
  const double gain = p[0], gain_before = p[1], bias = p[2], stiffness = p[3], damping = p[4], coulomb = p[5];
  const double breakaway = std::max(p[6], coulomb);
  const bool shows_speed = p[7] != 0;
  const double h = period_s / kSubSteps;
  const double drag = 1 + h * damping;
  const std::vector<double> copy(in.begin(), in.end());
  double x = stiffness > 0 ? ((gain + gain_before) * in[0] + bias) / stiffness : 0;
  double v = 0;
  if (!start.empty()) {
    x += start[0];
    v += start[1];
  }
  for (std::size_t t = 0; t < in.size(); ++t) {
    out[t] = shows_speed ? v : x;
    if (!(std::abs(x) < kLeaves)) out[t] = std::numeric_limits<double>::quiet_NaN();
    const double now = delayed(copy, t, block.delay_samples), past = delayed(copy, t, block.delay_samples + 1);
    const double push = gain * now + gain_before * past + bias;
    for (int step = 0; step < kSubSteps; ++step) {
      const double free = (v + h * (push - stiffness * x)) / drag;
      const double hold = h / drag * (v == 0 ? breakaway : coulomb);
      const double slide = h / drag * coulomb;
      v = std::abs(free) <= hold ? 0 : free - std::copysign(std::min(slide, std::abs(free)), free);
      x += h * v;
    }
  }
}

/// hⁿ for a level that is not below its outlet.
double outflow(double level, double exponent) {
  if (level <= 0) return 0;
  return exponent == 0.5 ? std::sqrt(level) : std::pow(level, exponent);
}

void run_tanks(const MachineBlock& block, double period_s, In start, In in, Out out) {
  const auto& p = block.parameters;
  const bool two = p[0] > 1;
  const double gain = p[1], closed = p[2], upper = p[3], lower = p[4], exponent = p[5], exponent_upper = p[10];
  const double rim_upper = p[6], share = p[7], zero = p[9], rim_lower = std::max(p[8] - zero, 1e-6);
  const double h = period_s / kSubSteps;
  const std::vector<double> copy(in.begin(), in.end());
  const auto inflow = [&](std::size_t t) {
    return std::max(0.0, gain * (delayed(copy, t, block.delay_samples) - closed));
  };
  double h1 = std::min(std::pow(inflow(0) / upper, 1 / exponent_upper), rim_upper);
  double h2 =
      std::min(std::pow((two ? upper * outflow(h1, exponent_upper) : inflow(0)) / lower, 1 / exponent), rim_lower);
  if (!start.empty()) {
    h1 = std::clamp(h1 + start[0], 0.0, rim_upper);
    h2 = std::clamp(h2 + start[1], 0.0, rim_lower);
  }
  for (std::size_t t = 0; t < in.size(); ++t) {
    out[t] = h2 + zero;
    const double in_flow = inflow(t);
    for (int step = 0; step < kSubSteps; ++step) {
      double feed = in_flow;
      if (two) {
        const double passed = std::min(upper * outflow(h1, exponent_upper), h1 / h + in_flow);
        h1 += h * (in_flow - passed);
        const double spill = std::max(0.0, h1 - rim_upper) / h;
        h1 = std::min(h1, rim_upper);
        feed = passed + share * spill;
      }
      h2 = std::clamp(h2 + h * (feed - lower * outflow(h2, exponent)), 0.0, rim_lower);
    }
  }
}

void run_play(double half_width, double memory, In in, Out out) {
  double held = in[0] + std::clamp(memory, -half_width, half_width);
  for (std::size_t t = 0; t < in.size(); ++t) {
    held = std::max(in[t] - half_width, std::min(in[t] + half_width, held));
    out[t] = held;
  }
}

void run_stick_slip(double breakaway, double kinetic, double memory, In in, Out out) {
  double held = in[0] + std::clamp(memory, -breakaway, breakaway);
  for (std::size_t t = 0; t < in.size(); ++t) {
    const double x = in[t];
    if (std::abs(x - held) > breakaway) held = x - std::copysign(std::min(kinetic, breakaway), x - held);
    out[t] = held;
  }
}

void run_loop(double width, double reach, double memory, In in, Out out) {
  const double weight = width / (reach * (kLoopPlays + 1) / kLoopPlays) / kLoopPlays;
  std::array<double, kLoopPlays> held{};
  for (int j = 0; j < kLoopPlays; ++j) held[j] = in[0] + std::clamp(memory, -1.0, 1.0) * reach * (j + 1) / kLoopPlays;
  for (std::size_t t = 0; t < in.size(); ++t) {
    const double x = in[t];
    double sum = 0;
    for (int j = 0; j < kLoopPlays; ++j) {
      const double half = reach * (j + 1) / kLoopPlays;
      held[j] = std::max(x - half, std::min(x + half, held[j]));
      sum += held[j] - x;
    }
    out[t] = x + weight * sum;
  }
}

/// min(x, 0), rounded over s.
double soft_minimum(double x, double s) {
  if (s <= 0) return std::min(x, 0.0);
  const double r = x / s;
  if (r > 30) return 0;
  if (r < -30) return x;
  return x - s * std::log1p(std::exp(r));
}

double dead_band(double x, double centre, double half) {
  const double z = x - centre;
  if (z > half) return centre + z - half;
  return z < -half ? centre + z + half : centre;
}

template <typename Law>
void each(In in, Out out, Law law) {
  for (std::size_t t = 0; t < in.size(); ++t) out[t] = law(in[t]);
}

template <typename Law>
void each_at(double period_s, const MachineSurroundings& around, In in, Out out, Law law) {
  for (std::size_t t = 0; t < in.size(); ++t) {
    out[t] = law(in[t], around.start_s + static_cast<double>(t) * period_s);
  }
}

void run_rate_limit(double step, In in, Out out) {
  double y = in[0];
  for (std::size_t t = 0; t < in.size(); ++t) out[t] = y += std::clamp(in[t] - y, -step, step);
}

void run_lag(double keep_rising, double keep_falling, double memory, In in, Out out) {
  double y = in[0] + memory;
  for (std::size_t t = 0; t < in.size(); ++t) {
    const double x = in[t];
    y = x + (x > y ? keep_rising : keep_falling) * (y - x);
    out[t] = y;
  }
}

void run_side(const MachineBlock& block, const MachineSurroundings& around, In in, Out out) {
  const auto channel = std::find_if(around.side.begin(), around.side.end(),
                                    [&](const Channel& side) { return side.name == block.channel; });
  const bool known = channel != around.side.end() && channel->values.size() >= in.size();
  for (std::size_t t = 0; t < in.size(); ++t) {
    out[t] = in[t] + (known ? block.parameters[0] * (channel->values[t] - block.parameters[1]) : 0);
  }
}

double unit_of_start(const MachineBlock& block, std::size_t state, double sample_period_s) {
  if (block.law != MachineLaw::kMotion) return 1;
  const bool shows_speed = block.parameters[7] != 0;
  if (state == 0) return shows_speed ? sample_period_s : 1;
  return shows_speed ? 1 : 1 / sample_period_s;
}

}  // namespace

std::size_t start_size(const MachineBlock& block) {
  const auto order = static_cast<std::size_t>(order_of(block.sections));
  switch (block.law) {
    case MachineLaw::kLinear:
    case MachineLaw::kSpring:
      return order;
    case MachineLaw::kRestoringLoop:
      return order + 1;
    case MachineLaw::kMotion:
    case MachineLaw::kTanks:
      return 2;
    case MachineLaw::kPlay:
    case MachineLaw::kStickSlip:
    case MachineLaw::kLoop:
    case MachineLaw::kLag:
      return 1;
    default:
      return 0;
  }
}

std::size_t start_size(const Machine& machine) {
  std::size_t size = 0;
  for (const MachineBlock& block : machine.blocks) size += start_size(block);
  return size;
}

std::vector<double> units_of_start(const Machine& machine) {
  std::vector<double> units;
  for (const MachineBlock& block : machine.blocks) {
    for (std::size_t state = 0; state < start_size(block); ++state) {
      units.push_back(unit_of_start(block, state, machine.sample_period_s));
    }
  }
  return units;
}

void run_block(const MachineBlock& block, double period_s, const MachineSurroundings& around, In start, In in,
               Out out) {
  if (in.empty()) return;
  const auto& p = block.parameters;
  const double memory = start.empty() ? 0 : start[0];
  switch (block.law) {
    case MachineLaw::kLinear:
      return run_linear(block, start, in, out);
    case MachineLaw::kSpring:
      return run_spring(block, start, in, out);
    case MachineLaw::kRestoringLoop:
      return run_restoring_loop(block, start, in, out);
    case MachineLaw::kMotion:
      return run_motion(block, period_s, start, in, out);
    case MachineLaw::kTanks:
      return run_tanks(block, period_s, start, in, out);
    case MachineLaw::kAffine:
      return each(in, out, [&](double x) { return p[0] * x + p[1]; });
    case MachineLaw::kPlay:
      return run_play(p[0] / 2, memory, in, out);
    case MachineLaw::kStickSlip:
      return run_stick_slip(p[0], p[1], memory, in, out);
    case MachineLaw::kLoop:
      return run_loop(p[0], p[1], memory, in, out);
    case MachineLaw::kDeadBand:
      return each(in, out, [&](double x) { return dead_band(x, p[0], p[1] / 2); });
    case MachineLaw::kUpperLimit:
      return each(in, out, [&](double x) { return p[0] + soft_minimum(x - p[0], p[1]); });
    case MachineLaw::kLowerLimit:
      return each(in, out, [&](double x) { return p[0] - soft_minimum(p[0] - x, p[1]); });
    case MachineLaw::kCurve:
      return each(in, out, [&](double x) {
        const double q = (x - p[1]) / p[2];
        return x + p[0] * p[2] * q * (1 - q);
      });
    case MachineLaw::kMagnitude:
      return each(in, out, [&](double x) { return p[0] + std::abs(x - p[0]); });
    case MachineLaw::kRateLimit:
      return run_rate_limit(p[0] * period_s, in, out);
    case MachineLaw::kLag:
      return run_lag(std::exp(-period_s / p[0]), std::exp(-period_s / p[1]), memory, in, out);
    case MachineLaw::kTone:
      return each_at(period_s, around, in, out, [&](double x, double t) {
        const double angle = 2 * std::numbers::pi * p[2] * t;
        return x + p[0] * std::sin(angle) + p[1] * std::cos(angle);
      });
    case MachineLaw::kDrift:
      return each_at(period_s, around, in, out, [&](double x, double t) { return x + p[0] * t; });
    case MachineLaw::kWarming:
      return each_at(period_s, around, in, out,
                     [&](double x, double t) { return p[2] + (x - p[2]) * (1 - p[0] * std::expm1(-t / p[1])); });
    case MachineLaw::kGainStep:
      return each_at(period_s, around, in, out,
                     [&](double x, double t) { return t < p[1] ? x : p[2] + (x - p[2]) * (1 + p[0]); });
    case MachineLaw::kSide:
      return run_side(block, around, in, out);
  }
}

double loop_after(double h, double move, double beta, double delta) {
  const double to = move < 0 ? -1 : 1;
  double left = std::abs(move), along = to * h;  // seen in the direction of the move
  if (along < 0) {
    const double rate = beta - delta;
    const double to_none = std::abs(rate * along) < kStraight ? -along : std::log1p(-rate * along) / rate;
    if (!(to_none < left)) return to * grown(along, rate, left);
    left -= to_none;
    along = 0;
  }
  return to * grown(along, beta + delta, left);
}

Eigen::MatrixXd linear_basis(const MachineBlock& block, In start, In in) {
  Eigen::MatrixXd basis(static_cast<Index>(in.size()), static_cast<Index>(block.numerator.size()));
  Cascade cascade(block.sections, in.empty() ? 0 : in[0], start);
  for (std::size_t t = 0; t < in.size(); ++t) {
    cascade.step(delayed(in, t, block.delay_samples));
    if (t % kSettleEvery == 0) cascade.settle();
    cascade.basis(basis.row(static_cast<Index>(t)));
  }
  return basis;
}

std::vector<double> run_machine(const Machine& machine, const MachineSurroundings& around, In start, In input) {
  std::vector<double> signal(input.begin(), input.end());
  std::size_t at = 0;
  for (const MachineBlock& block : machine.blocks) {
    const std::size_t size = start_size(block);
    run_block(block, machine.sample_period_s, around, start.empty() ? start : start.subspan(at, size), signal, signal);
    at += size;
  }
  return signal;
}

std::vector<double> start_towards(const Machine& machine, const MachineSurroundings& around, In input, In measured) {
  constexpr int kIterations = 8;
  const std::size_t states = start_size(machine);
  const std::size_t samples = std::min(measured.size(), input.size());
  std::vector<double> start(states);
  if (states == 0 || samples == 0) return start;
  const std::vector<double> units = units_of_start(machine);
  const auto gap_of = [&](In from) {
    Eigen::VectorXd gap(static_cast<Index>(samples));
    const auto y = run_machine(machine, around, from, input.first(samples));
    for (std::size_t t = 0; t < samples; ++t) {
      gap[static_cast<Index>(t)] = std::isfinite(measured[t]) ? measured[t] - y[t] : 0;
    }
    return gap;
  };
  Eigen::VectorXd gap = gap_of(start);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::MatrixXd columns(static_cast<Index>(samples), static_cast<Index>(states));
    for (std::size_t j = 0; j < states; ++j) {
      const double probe = 1e-5 * units[j];
      std::vector<double> moved = start;
      moved[j] += probe;
      columns.col(static_cast<Index>(j)) = (gap - gap_of(moved)) / probe;
    }
    if (!columns.allFinite() || !gap.allFinite()) return start;
    const Eigen::VectorXd move = scaled_least_squares(columns, gap);
    bool lower = false;
    for (double length = 1; length > 0.05 && !lower; length /= 2) {
      std::vector<double> trial = start;
      for (std::size_t j = 0; j < states; ++j) trial[j] += length * move[static_cast<Index>(j)];
      Eigen::VectorXd trial_gap = gap_of(trial);
      lower = trial_gap.squaredNorm() < gap.squaredNorm() * (1 - 1e-9);
      if (!lower) continue;
      start = std::move(trial);
      gap = std::move(trial_gap);
    }
    if (!lower) break;
  }
  return start;
}

}  // namespace valvetriage
