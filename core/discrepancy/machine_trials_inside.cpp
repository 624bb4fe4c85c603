#include <algorithm>
#include <cmath>
#include <complex>
#include <optional>

#include "core/discrepancy/machine_trials.h"

namespace valvetriage {
namespace {

using Field = MachineField;

constexpr int kMostSandwichOrder = 6;
constexpr std::size_t kMostSplits = 14;  // all of four parts: nothing says which side of a law a mode is on

double gain_at_rest(const MachineBlock& block) {
  return valvetriage::gain_at_rest(block.sections, block.numerator);
}

/// Ways to give some of the sections to the first block and the rest to the second; halves of a section of real poles
/// count as sections. The most even first.
std::vector<std::pair<std::vector<Section>, std::vector<Section>>> splits(const std::vector<Section>& sections) {
  std::vector<std::vector<std::complex<double>>> parts;
  for (const Section& section : sections) {
    const auto poles = poles_of(std::span(&section, 1));
    if (poles.size() == 2 && poles[0].imag() == 0) {
      parts.push_back({poles[0]});
      parts.push_back({poles[1]});
    } else {
      parts.push_back(poles);
    }
  }
  std::vector<std::pair<std::vector<Section>, std::vector<Section>>> all;
  const SectionLimits free_range(1'000'000'000);
  std::vector<unsigned> masks;
  for (unsigned mask = 1; mask + 1 < (1U << parts.size()); ++mask) masks.push_back(mask);
  const auto imbalance = [&](unsigned mask) {
    int difference = 0;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const int poles = static_cast<int>(parts[i].size());
      difference += (mask >> i & 1U) != 0 ? poles : -poles;
    }
    return std::abs(difference);
  };
  std::stable_sort(masks.begin(), masks.end(), [&](unsigned a, unsigned b) { return imbalance(a) < imbalance(b); });
  if (masks.size() > kMostSplits) masks.resize(kMostSplits);
  for (const unsigned mask : masks) {
    std::vector<std::complex<double>> first, second;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      auto& side = (mask >> i & 1U) != 0 ? first : second;
      side.insert(side.end(), parts[i].begin(), parts[i].end());
    }
    all.emplace_back(sections_from_poles(first, free_range), sections_from_poles(second, free_range));
  }
  return all;
}

/// Linear block, law, linear block. The first has gain 1 on its slowest state; the second carries the gain.
MachineFit sandwich(const MachineGround& g, const std::vector<Section>& first, const std::vector<Section>& second,
                    double gain, const std::vector<MachineBlock>& laws, const std::vector<FreeParameter>& law_free) {
  MachineBlock in, out;
  in.sections = first;
  in.delay_samples = g.dead_samples;
  in.numerator.assign(static_cast<std::size_t>(order_of(first)) + 1, 0.0);
  in.numerator[0] = 1;
  out.sections = second;
  out.numerator.assign(static_cast<std::size_t>(order_of(second)) + 1, 0.0);
  out.numerator[0] = gain;
  MachineFit fit;
  fit.machine.sample_period_s = g.linear.front().fit.machine.sample_period_s;
  fit.machine.blocks.push_back(in);
  fit.machine.blocks.insert(fit.machine.blocks.end(), laws.begin(), laws.end());
  fit.machine.blocks.push_back(out);
  const std::size_t last = fit.machine.blocks.size() - 1;
  MachineBlock offset;
  offset.law = MachineLaw::kAffine;
  offset.parameters = {1, 0};
  fit.machine.blocks.push_back(offset);
  for (const FreeParameter& p : free_dynamics(in, 0)) {
    if (p.field != Field::kNumerator || p.index != 0) fit.free.push_back(p);
  }
  for (FreeParameter p : law_free) {
    p.block += 1;
    fit.free.push_back(p);
  }
  for (const FreeParameter& p : free_dynamics(out, last)) fit.free.push_back(p);
  fit.free.push_back(law_parameter(last + 1, 1, -1e3, 1e3));
  return fit;
}

struct MiddleLaw {
  const char* cause;
  std::vector<MachineBlock> blocks;
  std::vector<FreeParameter> free;
};

MachineBlock block_of(MachineLaw law, std::vector<double> parameters) {
  MachineBlock block;
  block.law = law;
  block.parameters = std::move(parameters);
  return block;
}

std::vector<MiddleLaw> middle_laws(const MachineGround& g) {
  const double range = g.input_range();
  const auto upper = block_of(MachineLaw::kUpperLimit, {0.3 * g.input_high, 0.05 * range});
  const auto lower = block_of(MachineLaw::kLowerLimit, {0.3 * g.input_low, 0.05 * range});
  const auto level = [&](std::size_t b) { return law_parameter(b, 0, g.input_low - range, g.input_high + range); };
  const auto soft = [&](std::size_t b) { return law_parameter(b, 1, 1e-4 * range, range, true); };
  return {{"saturation", {upper}, {level(0), soft(0)}},
          {"saturation", {lower}, {level(0), soft(0)}},
          {"saturation", {upper, lower}, {level(0), soft(0), level(1), soft(1)}},
          {"dead_band",
           {block_of(MachineLaw::kDeadBand, {0, 0.1 * range})},
           {law_parameter(0, 0, g.input_low, g.input_high), law_parameter(0, 1, 1e-6, range, true)}},
          {"static_curve", {block_of(MachineLaw::kCurve, {0.3, g.input_low, range})}, {law_parameter(0, 0, -3, 3)}}};
}

/// The linear machine with the powers of its own output fed back: a hardening (or softening) spring.
MachineFit spring(const LinearMachine& linear, double cubic) {
  MachineFit fit = linear.fit;
  MachineBlock& block = fit.machine.blocks[0];
  block.law = MachineLaw::kSpring;
  const double offset = fit.machine.blocks[1].parameters[1];
  block.parameters = {-offset};
  block.feedback.assign(static_cast<std::size_t>(linear.order), 0.0);
  block.feedback[0] = -cubic;
  const auto fixed = fit.free;
  fit.free = free_dynamics(block, 0);
  for (const FreeParameter& p : fixed) {
    if (p.block == 1) fit.free.push_back(p);
  }
  return fit;
}

void add_free_loop(MachineFit& fit) {
  fit.free.push_back(law_parameter(0, 0, 1e-3, 1e3, true));
  fit.free.push_back(law_parameter(0, 1, -1e3, 1e3));
}

MachineFit restoring_loop(const LinearMachine& linear, double share, double beta) {
  MachineFit fit = linear.fit;
  MachineBlock& block = fit.machine.blocks[0];
  block.law = MachineLaw::kRestoringLoop;
  block.parameters = {beta, 0};
  block.feedback.assign(static_cast<std::size_t>(linear.order), 0.0);
  block.feedback[0] = -share;
  for (double& c : block.numerator) c *= 1 + share;
  const auto fixed = fit.free;
  fit.free = free_dynamics(block, 0);
  add_free_loop(fit);
  for (const FreeParameter& p : fixed) {
    if (p.block == 1) fit.free.push_back(p);
  }
  for (auto& start : fit.starts) start.insert(start.begin() + linear.order, 0.0);
  return fit;
}

/// Friction inside a motion. Without a spring the motion integrates: its place is free, a constant force acts instead.
MachineFit friction_in_motion(const MachineGround& g, const MotionEquation& equation, double offset, bool shows_speed) {
  constexpr double kSlowest = 1e-6, kFastest = 1e3;       // radians in a record, in a sample
  constexpr double kLeastForce = 1e-9, kMostForce = 1e9;  // of those that the search begins with
  const double force = std::max(equation.coulomb, 1e-3 * std::abs(equation.gain) * g.input_range());
  const double damping = std::max(equation.damping, 1e-3 / g.longest_s);
  const double stiffness = shows_speed ? 0 : std::max(equation.stiffness, 0.0);
  MachineFit fit;
  fit.machine.sample_period_s = g.linear.front().fit.machine.sample_period_s;
  MachineBlock motion = block_of(MachineLaw::kMotion, {equation.gain, 0, stiffness > 0 ? 0 : equation.bias, stiffness,
                                                       damping, force, 1.2 * force, shows_speed ? 1.0 : 0.0});
  motion.delay_samples = g.dead_samples;
  fit.machine.blocks = {motion, block_of(MachineLaw::kAffine, {1, offset})};
  // From what no record shows to what no sample does.
  const double slowest = kSlowest / g.longest_s, fastest = kFastest / fit.machine.sample_period_s;
  const double unit = std::max(std::abs(equation.gain), force), most = kMostForce * unit;
  fit.free = {law_parameter_in(unit, 0, 0, -most, most), law_parameter_in(unit, 0, 1, -most, most),
              law_parameter(0, 4, slowest, fastest, true), law_parameter(0, 5, kLeastForce * force, most, true),
              law_parameter(0, 6, kLeastForce * force, most, true)};
  if (stiffness > 0) {
    fit.free.push_back(law_parameter(0, 3, slowest * slowest, fastest * fastest, true));
    fit.free.push_back(law_parameter(1, 1, -1e3, 1e3));
  } else {
    fit.free.push_back(law_parameter_in(unit, 0, 2, -most, most));
  }
  return fit;
}

/// A mass whose poles are those of a linear machine, with some friction.
MachineFit friction_beside(const MachineGround& g, const LinearMachine& linear, double share, bool shows_speed) {
  const MachineBlock& block = linear.fit.machine.blocks[0];
  const double period = linear.fit.machine.sample_period_s;
  std::complex<double> sum = 0, product = 1;
  for (const auto& pole : poles_of(block.sections)) {
    const std::complex<double> rate = std::log(pole) / period;
    sum -= rate;
    product *= -rate;
  }
  MotionEquation equation{.damping = sum.real(), .stiffness = product.real()};
  equation.gain = gain_at_rest(block) * (shows_speed ? equation.damping : equation.stiffness);
  equation.coulomb = share * std::abs(equation.gain) * g.input_range();
  return friction_in_motion(g, equation, linear.fit.machine.blocks[1].parameters[1], shows_speed);
}

/// Motions with friction by their equation of motion: at rest anywhere (no spring) or drawn to one place.
std::vector<MachineFit> frictions_by_equation(const MachineData& data, const MachineGround& g) {
  std::vector<MachineFit> starts;
  for (const double lag_samples : {1.0, 3.0, 8.0}) {
    for (const bool spring : {true, false}) {
      for (const bool shows_speed : {false, true}) {
        if (spring && shows_speed) continue;
        const auto equation =
            motion_equation(data, {.stiffness = spring, .coulomb = true, .shows_speed = shows_speed}, lag_samples);
        if (!equation || (spring && equation->stiffness <= 0)) continue;
        const double offset = spring ? equation->bias / equation->stiffness : 0;
        starts.push_back(friction_in_motion(g, *equation, offset, shows_speed));
      }
    }
  }
  return starts;
}

/// A motion with a law of its output fed back, by its equation: the poles are those without what is fed back.
MachineFit fed_back_by_equation(const MachineData& data, const MachineGround& g, const MotionEquation& equation,
                                MachineLaw law, std::vector<double> parameters, double fed_back) {
  const double period = data.period_s;
  const double damping = std::max(equation.damping, 1e-3 / g.longest_s);
  const std::complex<double> root = std::sqrt(std::complex<double>(damping * damping / 4 - equation.stiffness));
  const std::vector<std::complex<double>> poles{std::exp(-period * (damping / 2 + root)),
                                                std::exp(-period * (damping / 2 - root))};
  MachineBlock block = block_of(law, std::move(parameters));
  block.sections = sections_from_poles(poles, SectionLimits(1'000'000'000));
  block.delay_samples = g.dead_samples;
  block.numerator = {equation.gain / equation.stiffness, 0, 0};
  block.feedback = {-fed_back / equation.stiffness, 0};
  MachineFit fit;
  fit.machine.sample_period_s = period;
  fit.machine.blocks = {block, block_of(MachineLaw::kAffine, {1, equation.bias / equation.stiffness})};
  fit.free = free_dynamics(block, 0);
  return fit;
}

/// A hardening spring by its equation of motion: the poles are those of small movements.
std::vector<MachineFit> springs_by_equation(const MachineData& data, const MachineGround& g) {
  std::vector<MachineFit> starts;
  for (const double lag_samples : {0.5, 1.0, 3.0}) {
    const auto equation = motion_equation(data, {.stiffness = true, .cubic = true}, lag_samples);
    if (!equation || equation->stiffness <= 0) continue;
    const double centre = -equation->bias / equation->stiffness;
    starts.push_back(fed_back_by_equation(data, g, *equation, MachineLaw::kSpring, {centre}, equation->cubic));
    starts.back().free.push_back(law_parameter(1, 1, -1e3, 1e3));
  }
  return starts;
}

/// Loops in the restoring force by their equations of motion: of a grid of shapes those that leave least. From a linear
/// machine the way to them is a long valley, in which a loop of any shape is soon as good as it gets.
std::vector<MachineFit> loops_by_equation(const MachineData& data, const MachineGround& g) {
  constexpr std::size_t kKept = 3;
  std::vector<MachineFit> starts;
  for (const double lag_samples : {0.5, 1.0, 3.0}) {
    std::vector<std::pair<MotionEquation, LoopShape>> found;
    for (const double bend : {0.5, 1.0, 2.0, 5.0, 12.0}) {  // of the output's range: beta y
      for (const double share : {-1.4, -0.7, 0.0, 0.7, 1.4}) {
        const double beta = bend / g.output_range();
        const LoopShape shape{beta, share * beta};
        const auto equation = motion_equation(data, {.stiffness = true, .loop = shape}, lag_samples);
        if (equation && equation->stiffness > 0 && equation->loop > 0) found.emplace_back(*equation, shape);
      }
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const auto& a, const auto& b) { return a.first.squares < b.first.squares; });
    if (found.size() > kKept) found.resize(kKept);
    for (const auto& [equation, shape] : found) {
      starts.push_back(fed_back_by_equation(data, g, equation, MachineLaw::kRestoringLoop, {shape.beta, shape.delta},
                                            equation.loop));
      add_free_loop(starts.back());
      starts.back().free.push_back(law_parameter(1, 1, -1e3, 1e3));
    }
  }
  return starts;
}

/// An equation of motion knows nothing of the linear machine's delay, which may be what the law holds back.
void add_with_delays(const MachineGround& g, MachineFit fit, std::vector<MachineFit>& starts) {
  starts.push_back(fit);
  if (g.dead_samples == g.least_delay) return;
  fit.machine.blocks[0].delay_samples = g.least_delay;
  starts.push_back(std::move(fit));
}

struct Emptying {
  double lag_s = 0;  ///< of one tank
  double gain = 0;   ///< level over input, at rest
};

/// How slowly each of so many equal tanks empties and how high it stands, by the linear machines. A mode slower than
/// half the record is the machine's wander and no tank; then the lag of a machine with one state is shared out. Empty
/// for a tank that empties within samples, or fills when told to empty.
std::optional<Emptying> emptying_of(const MachineGround& g, int tanks) {
  const double period = g.linear.front().fit.machine.sample_period_s;
  for (int order = tanks; order > 0; --order) {
    const MachineBlock& block = g.of_order(order).fit.machine.blocks[0];
    double slowest = 0;
    for (const auto& pole : poles_of(block.sections)) slowest = std::max(slowest, std::abs(pole));
    const double lag_s = -period / std::log(std::min(slowest, 1 - 1e-12));
    const double gain = gain_at_rest(block);
    if (slowest > 0.3 && gain > 0 && lag_s < 0.5 * g.longest_s) return Emptying{lag_s / tanks, gain};
  }
  return {};
}

}  // namespace

std::vector<MachineTrial> sandwich_trials(const MachineGround& g) {
  std::vector<MachineTrial> trials;
  for (const MiddleLaw& law : middle_laws(g)) {
    MachineTrial trial{{law.cause}, "between two linear blocks", {}};
    for (const LinearMachine& linear : g.linear) {
      if (linear.order < 2 || linear.order > kMostSandwichOrder) continue;
      if (linear.order != 2 && linear.order != g.chosen_order && linear.order != g.chosen_order + 1) continue;
      const MachineBlock& block = linear.fit.machine.blocks[0];
      for (const auto& [first, second] : splits(block.sections)) {
        trial.starts.push_back(sandwich(g, first, second, gain_at_rest(block), law.blocks, law.free));
      }
    }
    trials.push_back(std::move(trial));
  }
  return trials;
}

std::vector<MachineTrial> motion_trials(const MachineData& data, const MachineGround& g) {
  MachineTrial stiffening{{"stiffening_spring"}, "in the restoring force", {}};
  std::vector<MachineTrial> loops;  // one for each order: early in a fit, a further state hides the better loop
  MachineTrial friction{{"friction"}, "inside the motion", {}};
  for (const LinearMachine& linear : g.linear) {
    if (linear.order < 1 || linear.order > 3) continue;
    if (linear.order >= 2) {
      loops.push_back({{"hysteresis"}, "in the restoring force", {}});
      if (linear.order == 2) {
        for (MachineFit& fit : loops_by_equation(data, g)) add_with_delays(g, std::move(fit), loops.back().starts);
      }
      for (const double cubic : {0.005, 0.05, 0.2}) stiffening.starts.push_back(spring(linear, cubic));
      for (const double share : {0.1, 0.5}) {
        for (const double beta : {0.3, 2.0}) loops.back().starts.push_back(restoring_loop(linear, share, beta));
      }
    }
    if (linear.order > 2) continue;
    for (const double share : {0.01, 0.05, 0.2}) {
      friction.starts.push_back(friction_beside(g, linear, share, linear.order == 1));
    }
  }
  for (MachineFit& fit : springs_by_equation(data, g)) add_with_delays(g, std::move(fit), stiffening.starts);
  for (MachineFit& fit : frictions_by_equation(data, g)) add_with_delays(g, std::move(fit), friction.starts);
  loops.push_back(std::move(stiffening));
  loops.push_back(std::move(friction));
  return loops;
}

namespace {

MachineFit tank_fit(MachineBlock tank, double input_high, double period_s) {
  const bool two = tank.parameters[0] > 1;
  MachineFit fit;
  fit.machine.sample_period_s = period_s;
  fit.machine.blocks = {std::move(tank)};
  fit.free = {law_parameter(0, 1, 1e-9, 1e9, true), law_parameter(0, 2, -1e3, input_high),
              law_parameter(0, 4, 1e-9, 1e9, true)};
  if (two) fit.free.push_back(law_parameter(0, 3, 1e-9, 1e9, true));
  return fit;
}

FreeParameter rim_of(const MachineGround& g) {
  return law_parameter(0, 8, g.output_high - 0.3 * g.output_range(), g.output_high + 0.1 * g.output_range());
}

/// Levels that follow their inflow in proportion, one of them up to a rim: what overflows does not come back, as behind
/// a reading that stops it would. The outlets lie so far below all levels that nothing runs dry.
MachineTrial overflow_trial(const MachineData& data, const MachineGround& g) {
  constexpr double kOutletBelow = 2;  // ranges of the output
  MachineTrial trial{{"saturation"}, "of a level, at a rim", {}};
  for (const double tanks : {1.0, 2.0}) {
    const auto emptying = emptying_of(g, tanks > 1 ? 2 : 1);
    if (!emptying) continue;
    const auto [lag_s, gain] = *emptying;
    const double zero = g.output_low - kOutletBelow * g.output_range(), rate = 1 / lag_s;
    const MachineFit fit = tank_fit(
        block_of(MachineLaw::kTanks, {tanks, gain * rate, zero / gain, rate, rate, 1, kNoRim, 0, kNoRim, zero, 1}),
        g.input_high, data.period_s);
    trial.starts.push_back(fit);
    trial.starts.back().machine.blocks[0].parameters[8] = g.output_high;
    trial.starts.back().free.push_back(rim_of(g));
    if (tanks < 2) continue;
    const double deepest = g.output_high - zero;
    trial.starts.push_back(fit);
    trial.starts.back().machine.blocks[0].parameters[6] = deepest;
    trial.starts.back().free.push_back(law_parameter(0, 6, 0.05 * deepest, 50 * deepest, true));
  }
  return trial;
}

}  // namespace

std::vector<MachineTrial> tank_trials(const MachineData& data, const MachineGround& g) {
  constexpr double kLeastExponent = 0.2;  // an orifice has 1/2, a long pipe 1; a tank that widens has less of either
  const std::vector<FreeParameter> exponents{law_parameter(0, 5, kLeastExponent, 1),
                                             law_parameter(0, 10, kLeastExponent, 1)};
  MachineTrial plain{{"orifice_flow"}, "in the outflow", {}, exponents};
  MachineTrial spilling{{"orifice_flow", "saturation"}, "in the outflow, with a rim", {}, exponents};
  for (const double tanks : {1.0, 2.0}) {
    const auto emptying = emptying_of(g, tanks > 1 ? 2 : 1);
    if (!emptying) continue;
    const auto [lag_s, gain] = *emptying;
    for (const double depth : {0.05, 0.2, 0.6}) {
      const double zero = g.output_low - depth * g.output_range();
      const double mean_level = -zero;  // outputs are about their mean
      const double outflow = 2 * std::sqrt(mean_level) / lag_s;
      const double inflow = outflow * std::sqrt(mean_level);
      const double slope = gain * outflow / (2 * std::sqrt(mean_level));
      const double closed = -inflow / slope;
      MachineFit fit = tank_fit(
          block_of(MachineLaw::kTanks, {tanks, slope, closed, outflow, outflow, 0.5, kNoRim, 0, kNoRim, zero, 0.5}),
          g.input_high, data.period_s);
      fit.free.push_back(law_parameter(0, 9, -50, g.output_low));
      plain.starts.push_back(fit);
      auto& rims = fit.machine.blocks[0].parameters;
      const double deepest = g.output_high - zero;
      rims[8] = g.output_high;
      fit.free.push_back(rim_of(g));
      spilling.starts.push_back(fit);
      if (tanks < 2) continue;
      for (const double rim : {0.6, 1.0, 1.6}) {
        for (const double share : {0.3, 0.85}) {
          rims[6] = rim * deepest;
          rims[7] = share;
          MachineFit both = fit;
          both.free.push_back(law_parameter(0, 6, 0.05 * deepest, 50 * deepest, true));
          both.free.push_back(law_parameter(0, 7, 0, 1));
          spilling.starts.push_back(both);
        }
      }
    }
  }
  return {plain, spilling, overflow_trial(data, g)};
}

}  // namespace valvetriage
