#include "core/discrepancy/machine_trials.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/discrepancy/machine_linear.h"
#include "core/mechanisms/mechanism.h"

namespace valvetriage {
namespace {

using Start = SignalLaw::Start;

MachineBlock law_block(MachineLaw law, std::vector<double> parameters) {
  MachineBlock block;
  block.law = law;
  block.parameters = std::move(parameters);
  return block;
}

SignalLaw backlash(const MachineGround& g) {
  SignalLaw law{"backlash", "on the input", true, {}};
  for (const double share : {0.02, 0.08, 0.25}) {
    law.starts.push_back({{law_block(MachineLaw::kPlay, {share * g.input_range()})},
                          {law_parameter(0, 0, 1e-6, g.input_range(), true)}});
  }
  return law;
}

SignalLaw stick_slip(const MachineGround& g) {
  SignalLaw law{"friction", "on the input", true, {}};
  for (const double share : {0.015, 0.04, 0.12}) {
    for (const double ratio : {0.3, 0.7}) {
      const double breakaway = share * g.input_range();
      law.starts.push_back(
          {{law_block(MachineLaw::kStickSlip, {breakaway, ratio * breakaway})},
           {law_parameter(0, 0, 1e-6, g.input_range(), true), law_parameter(0, 1, 1e-7, g.input_range(), true)}});
    }
  }
  return law;
}

SignalLaw smooth_loop(const MachineGround& g) {
  SignalLaw law{"hysteresis", "on the input", true, {}};
  for (const double reach : {0.15, 0.5}) {
    for (const double width : {0.1, 0.4}) {
      law.starts.push_back({{law_block(MachineLaw::kLoop, {width * reach * g.input_range(), reach * g.input_range()})},
                            {law_parameter(0, 0, 1e-6, g.input_range(), true),
                             law_parameter(0, 1, 0.02 * g.input_range(), g.input_range(), true)}});
    }
  }
  return law;
}

SignalLaw dead_band(const MachineGround& g) {
  SignalLaw law{"dead_band", "on the input", true, {}};
  const double middle = 0.5 * (g.input_low + g.input_high);
  for (const double width : {0.06, 0.25}) {
    for (const double centre : {std::clamp(g.input_zero, g.input_low, g.input_high), middle}) {
      law.starts.push_back(
          {{law_block(MachineLaw::kDeadBand, {centre, width * g.input_range()})},
           {law_parameter(0, 0, g.input_low, g.input_high), law_parameter(0, 1, 1e-6, 0.9 * g.input_range(), true)}});
    }
  }
  return law;
}

/// Limits above, below or on both sides of a signal that runs from low to high; `inside` is where they begin.
std::vector<Start> limit_starts(double low, double high, double inside, double softness) {
  const double range = high - low;
  const auto upper = law_block(MachineLaw::kUpperLimit, {high - inside * range, softness});
  const auto lower = law_block(MachineLaw::kLowerLimit, {low + inside * range, softness});
  const auto level = [&](std::size_t block) { return law_parameter(block, 0, low - 0.5 * range, high + 0.5 * range); };
  std::vector<Start> starts{{{upper}, {level(0)}}, {{lower}, {level(0)}}, {{upper, lower}, {level(0), level(1)}}};
  if (softness <= 0) return starts;
  for (Start& start : starts) {
    const std::size_t blocks = start.blocks.size();
    for (std::size_t b = 0; b < blocks; ++b) start.free.push_back(law_parameter(b, 1, 1e-4 * range, range, true));
  }
  return starts;
}

void saturations(const MachineGround& g, std::vector<SignalLaw>& laws) {
  SignalLaw output{"saturation", "on the output", false, limit_starts(g.output_low, g.output_high, 0.005, 0)};
  const auto deeper = limit_starts(g.output_low, g.output_high, 0.06, 0);
  output.starts.insert(output.starts.end(), deeper.begin(), deeper.end());
  SignalLaw input{"saturation", "on the input", true, limit_starts(g.input_low, g.input_high, 0.15, 0)};
  laws.push_back(std::move(output));
  laws.push_back(std::move(input));
}

SignalLaw curve(const MachineGround& g, bool on_input) {
  const double low = on_input ? g.input_low : g.output_low;
  const double range = on_input ? g.input_range() : g.output_range();
  SignalLaw law{"static_curve", on_input ? "on the input" : "on the output", on_input, {}};
  for (const double c : {-0.3, 0.3}) {
    law.starts.push_back({{law_block(MachineLaw::kCurve, {c, low, range})}, {law_parameter(0, 0, -3, 3)}});
  }
  return law;
}

SignalLaw rate_limit(const MachineGround& g) {
  SignalLaw law{"rate_limit", "on the input", true, {}};
  for (const double share : {0.5, 0.1, 0.02}) {
    law.starts.push_back({{law_block(MachineLaw::kRateLimit, {share * g.steepest_input_per_s})},
                          {law_parameter(0, 0, 1e-6 * g.steepest_input_per_s, g.steepest_input_per_s, true)}});
  }
  return law;
}

SignalLaw drift(const MachineGround& g) {
  return {"sensor_drift",
          "on the output",
          false,
          {{{law_block(MachineLaw::kDrift, {0})}, {law_parameter_in(1 / g.longest_s, 0, 0, -1e6, 1e6)}}}};
}

SignalLaw warming(const MachineGround& g) {
  SignalLaw law{"thermal_drift", "on the output", false, {}};
  for (const double share : {0.1, 0.3}) {
    law.starts.push_back(
        {{law_block(MachineLaw::kWarming, {-0.1, share * g.longest_s, g.output_zero})},
         {law_parameter(0, 0, -0.9, 0.9), law_parameter(0, 1, 0.02 * g.longest_s, g.longest_s, true)}});
  }
  return law;
}

SignalLaw gain_step(const MachineGround& g) {
  SignalLaw law{"intermittent", "on the output", false, {}};
  for (const GainStep& step : g.gain_steps) {
    law.starts.push_back({{law_block(MachineLaw::kGainStep, {step.change, step.time_s, g.output_zero})},
                          {law_parameter(0, 0, -1, 2), law_parameter(0, 1, 0.02 * g.longest_s, 0.98 * g.longest_s)}});
  }
  return law;
}

SignalLaw tone(const MachineGround& g) {
  SignalLaw law{"periodic_disturbance", "on the output", false, {}};
  for (const double f : g.tones_hz) {
    law.starts.push_back({{law_block(MachineLaw::kTone, {0.05, 0.05, f})},
                          {law_parameter(0, 0, -1e3, 1e3), law_parameter(0, 1, -1e3, 1e3),
                           law_parameter(0, 2, 0.98 * f, 1.02 * f, true)}});
  }
  return law;
}

SignalLaw side_input(const MachineGround& g) {
  constexpr double kMostOfASide = 1e3;  // of the output's deviation, for one of the channel's
  SignalLaw law{"side_input", "on the output", false, {}};
  for (const SideOfMachine& side : g.sides) {
    MachineBlock block = law_block(MachineLaw::kSide, {0, side.mean});
    block.channel = side.name;
    // As much as makes a part of the output of what the channel moves by.
    const double unit = 1 / side.spread;
    law.starts.push_back({{block}, {law_parameter_in(unit, 0, 0, -kMostOfASide * unit, kMostOfASide * unit)}});
  }
  return law;
}

/// A slower way down (or up) in place of one lag of the linear machine.
MachineTrial asymmetric(const MachineGround& g, int order) {
  MachineTrial trial{{"asymmetric_response"}, "in a lag behind the linear block", {}};
  const auto poles = poles_of(g.of_order(order).fit.machine.blocks[0].sections);
  double slowest = 0;
  for (const auto& pole : poles) slowest = std::max(slowest, std::abs(pole));
  if (!(slowest > 0 && slowest < 1)) return trial;
  const double lag_s = std::min(-g.linear.front().fit.machine.sample_period_s / std::log(slowest), g.longest_s);
  const int rest = std::max(0, order - 1);
  MachineFit base = rest > 0 ? g.of_order(rest).fit : g.linear.front().fit;
  if (rest == 0) {
    MachineBlock gain = base.machine.blocks[0];
    double at_rest = 0;
    for (const double c : gain.numerator) at_rest += c;
    gain.sections.clear();
    gain.numerator = {at_rest};
    std::erase_if(base.free, [](const FreeParameter& p) { return p.block == 0; });
    base.machine.blocks[0] = gain;
    for (const FreeParameter& p : free_dynamics(gain, 0)) base.free.push_back(p);
  }
  for (auto& start : base.starts) start.clear();
  for (const double ratio : {0.6, 1.6}) {
    MachineFit fit = base;
    fit.machine.blocks.push_back(law_block(MachineLaw::kLag, {lag_s * ratio, lag_s / ratio}));
    const std::size_t last = fit.machine.blocks.size() - 1;
    fit.free.push_back(law_parameter(last, 0, 0.1 * fit.machine.sample_period_s, 10 * g.longest_s, true));
    fit.free.push_back(law_parameter(last, 1, 0.1 * fit.machine.sample_period_s, 10 * g.longest_s, true));
    trial.starts.push_back(std::move(fit));
  }
  return trial;
}

/// Orders tried around a law: small ones, and the linear machine's own.
std::vector<int> law_orders(const MachineGround& g) {
  if (g.one_rate) return {g.linear.front().order};
  std::vector<int> orders{1, 2, g.chosen_order - 1, g.chosen_order};
  std::sort(orders.begin(), orders.end());
  orders.erase(std::unique(orders.begin(), orders.end()), orders.end());
  std::erase_if(orders, [&](int order) { return order < 1 || order > 4; });
  return orders;
}

}  // namespace

const LinearMachine& MachineGround::of_order(int order) const {
  for (const LinearMachine& machine : linear) {
    if (machine.order >= order) return machine;
  }
  return linear.back();
}

std::vector<SignalLaw> signal_laws(const MachineGround& g) {
  std::vector<SignalLaw> laws{backlash(g), stick_slip(g), smooth_loop(g), dead_band(g)};
  saturations(g, laws);
  laws.push_back(curve(g, true));
  laws.push_back(curve(g, false));
  if (!g.one_rate) laws.push_back(rate_limit(g));
  laws.push_back(drift(g));
  if (g.single_recording && !g.one_rate) {
    laws.push_back(warming(g));
    if (!g.gain_steps.empty()) laws.push_back(gain_step(g));
    if (!g.tones_hz.empty()) laws.push_back(tone(g));
  }
  if (!g.sides.empty()) laws.push_back(side_input(g));
  return laws;
}

MachineFit with_law(const MachineFit& fit, const SignalLaw& law, const SignalLaw::Start& start) {
  MachineFit joined = fit;
  auto& blocks = joined.machine.blocks;
  const std::size_t shift = law.on_input ? start.blocks.size() : 0;
  const std::size_t at = law.on_input ? 0 : blocks.size();
  blocks.insert(blocks.begin() + static_cast<std::ptrdiff_t>(at), start.blocks.begin(), start.blocks.end());
  for (FreeParameter& p : joined.free) p.block += shift;
  for (FreeParameter p : start.free) {
    p.block += at;
    joined.free.push_back(p);
  }
  std::size_t new_states = 0;
  for (const MachineBlock& block : start.blocks) new_states += start_size(block);
  for (auto& values : joined.starts) {
    values.insert(law.on_input ? values.begin() : values.end(), new_states, 0.0);
  }
  return joined;
}

std::vector<MachineTrial> single_trials(const MachineData& data, const MachineGround& g) {
  std::vector<MachineTrial> trials;
  for (const SignalLaw& law : signal_laws(g)) {
    MachineTrial trial{{law.cause}, law.place, {}};
    for (const int order : law_orders(g)) {
      for (const auto& start : law.starts) trial.starts.push_back(with_law(g.of_order(order).fit, law, start));
    }
    for (const LinearMachine& machine : g.beside) {
      for (const auto& start : law.starts) trial.starts.push_back(with_law(machine.fit, law, start));
    }
    if (law.cause == "friction" && !g.one_rate && g.least_delay > 0) {
      for (MachineFit& fit : held_input_frictions(data, g)) trial.starts.push_back(std::move(fit));
    }
    trials.push_back(std::move(trial));
  }
  const auto add = [&](std::vector<MachineTrial> more) {
    for (MachineTrial& trial : more) {
      if (!trial.starts.empty()) trials.push_back(std::move(trial));
    }
  };
  add({magnitude_trial(data, g)});
  if (g.one_rate) return trials;
  MachineTrial slower{{"asymmetric_response"}, "in a lag behind the linear block", {}};
  for (const int order : law_orders(g)) {
    const MachineTrial part = asymmetric(g, order);
    slower.starts.insert(slower.starts.end(), part.starts.begin(), part.starts.end());
  }
  add({slower});
  add(sandwich_trials(g));
  add(motion_trials(data, g));
  add(tank_trials(data, g));
  return trials;
}

std::string family_of(const std::string& cause) {
  const Mechanism* law = find_mechanism(cause);
  return law ? std::string(law->family) : "";
}
std::string origin_of(const std::string& cause) {
  const Mechanism* law = find_mechanism(cause);
  return law ? std::string(law->origin) : "either";
}

}  // namespace valvetriage
