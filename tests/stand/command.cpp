#include "tests/stand/command.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "tests/stand/random.h"

namespace valvetriage::stand {
namespace {

constexpr double kPeriodS = 0.005;
constexpr double kRestA = 1.0;
constexpr std::array<double, 5> kLevelsA = {1.2, 1.4, 1.6, 1.8, 2.0};

std::size_t samples_of(double seconds) {
  return static_cast<std::size_t>(std::lround(seconds / kPeriodS));
}

Command empty(const std::string& name, const std::string& test) {
  Command command;
  command.name = name;
  command.test = test;
  command.period_s = kPeriodS;
  return command;
}

void hold(Command& command, double level_a, double seconds) {
  const bool jumps = !command.value_a.empty() && command.value_a.back() != level_a;
  command.is_step.push_back(jumps ? 1 : 0);
  command.is_step.resize(command.is_step.size() + samples_of(seconds) - 1, 0);
  command.value_a.resize(command.value_a.size() + samples_of(seconds), level_a);
}

void ramp(Command& command, double to_a, double seconds) {
  const double from_a = command.value_a.back();
  const std::size_t n = samples_of(seconds);
  for (std::size_t k = 1; k <= n; ++k)
    command.value_a.push_back(from_a + (to_a - from_a) * static_cast<double>(k) / static_cast<double>(n));
  command.is_step.resize(command.value_a.size(), 0);
}

std::string level_name(double level_a) {
  const int tenths = static_cast<int>(std::lround(level_a * 10));
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + "A";
}

std::vector<Command> steps() {
  std::vector<Command> commands;
  for (const double level : kLevelsA) {
    Command command = empty("step_" + level_name(level), "step");
    hold(command, kRestA, 1.5);
    hold(command, level, 4.0);
    hold(command, kRestA, 2.5);
    commands.push_back(command);
  }
  return commands;
}

Command steps_in_one() {
  Command command = empty("steps", "step");
  hold(command, kRestA, 1.5);
  for (const double level : kLevelsA) {
    hold(command, level, 2.2);
    hold(command, kRestA, 1.5);
  }
  return command;
}

Command step_up() {
  Command command = empty("step_up_1.6A", "step");
  hold(command, kRestA, 1.5);
  hold(command, 1.6, 4.0);
  return command;
}

Command staircase() {
  Command command = empty("staircase", "staircase");
  hold(command, kRestA, 1.9);
  for (const double level : kLevelsA) hold(command, level, 1.8);
  for (int i = 3; i >= 0; --i) hold(command, kLevelsA[static_cast<std::size_t>(i)], 1.8);
  hold(command, kRestA, 1.9);
  return command;
}

Command triangle(const std::string& name, double ramp_s, int cycles) {
  Command command = empty(name, "triangle");
  hold(command, kRestA, 1.0);
  for (int i = 0; i < cycles; ++i) {
    ramp(command, 2.0, ramp_s);
    ramp(command, kRestA, ramp_s);
  }
  hold(command, kRestA, 1.0);
  return command;
}

/// Logarithmic sweep, 0.2 to 20 Hz in 19 s around 1.6 A.
Command sweep(const std::string& name, double amplitude_a) {
  constexpr double kLowHz = 0.2, kHighHz = 20, kSeconds = 19, kCentreA = 1.6;
  Command command = empty(name, "sweep");
  hold(command, kCentreA, 1.0);
  const double growth = std::log(kHighHz / kLowHz) / kSeconds;
  for (std::size_t k = 1; k <= samples_of(kSeconds); ++k) {
    const double t = static_cast<double>(k) * kPeriodS;
    const double phase = 2 * std::numbers::pi * kLowHz * std::expm1(growth * t) / growth;
    command.value_a.push_back(kCentreA + amplitude_a * std::sin(phase));
  }
  command.is_step.resize(command.value_a.size(), 0);
  return command;
}

Command multisine_around_mid() {
  Command command = empty("multisine", "other");
  for (const double value : multisine(kPeriodS, 5, 15, 4)) command.value_a.push_back(1.6 + 0.06 * value);
  command.is_step.resize(command.value_a.size(), 0);
  return command;
}

}  // namespace

std::size_t Command::index_at(double t_s) const {
  const auto guess = static_cast<std::size_t>(std::max(0.0, std::floor(t_s / period_s + 1e-9)));
  if (tick_s.empty()) return guess;
  std::size_t k = std::min(guess + 1, tick_s.size() - 1);  // a tick comes early or late by less than half a period
  while (k > 0 && tick_s[k] > t_s) --k;
  return k;
}

double Command::at(double t_s, std::size_t next_step) const {
  const std::size_t last = std::min(next_step, value_a.size()) - 1;
  if (t_s <= instant_s(0)) return value_a.front();
  const std::size_t k = index_at(t_s);
  if (k >= last) return value_a[last];
  const double fraction = (t_s - instant_s(k)) / (instant_s(k + 1) - instant_s(k));
  return value_a[k] + fraction * (value_a[k + 1] - value_a[k]);
}

std::size_t Command::step_after(std::size_t k) const {
  for (std::size_t i = k + 1; i < value_a.size(); ++i)
    if (is_step[i]) return i;
  return value_a.size();
}

double Command::at(double t_s) const {
  return at(t_s, step_after(std::min(index_at(t_s), value_a.size() - 1)));
}

double Command::dither_at(double t_s) const {
  return dither_a == 0 ? 0 : dither_a * std::sin(2 * std::numbers::pi * dither_hz * t_s);
}

double Command::step_time_s(std::size_t step) const {
  if (step >= value_a.size()) return std::numeric_limits<double>::infinity();
  return instant_s(step);
}

const std::vector<std::string>& repertoire() {
  static const std::vector<std::string> names = {"steps",         "step",  "step_up",    "staircase", "triangle",
                                                 "triangle_fast", "sweep", "sweep_high", "multisine"};
  return names;
}

std::vector<Command> commands_of(const std::string& test) {
  if (test == "steps") return {steps_in_one()};
  if (test == "step") return steps();
  if (test == "step_up") return {step_up()};
  if (test == "staircase") return {staircase()};
  if (test == "triangle") return {triangle("triangle", 9.0, 1)};
  if (test == "triangle_fast") return {triangle("triangle_fast", 1.5, 6)};
  if (test == "sweep") return {sweep("sweep", 0.1)};
  if (test == "sweep_high") return {sweep("sweep_high", 0.3)};
  if (test == "multisine") return {multisine_around_mid()};
  std::string known;
  for (const std::string& name : repertoire()) known += " " + name;
  throw std::invalid_argument("the stand has no test '" + test + "'; it has" + known);
}

std::vector<double> multisine(double sample_period_s, double period_s, double highest_hz, int periods) {
  Random random(1, "multisine");  // one signal for all: it is part of the repertoire
  const auto n = static_cast<std::size_t>(std::lround(period_s / sample_period_s));
  std::vector<double> one(n, 0.0);
  int line = 1, lines = 0;
  while (line / period_s <= highest_hz) {
    const int left_out = random.below(4);
    for (int i = 0; i < 4; ++i, line += 2) {
      const double phase = 2 * std::numbers::pi * random.uniform();
      if (i == left_out) continue;
      ++lines;
      for (std::size_t k = 0; k < n; ++k)
        one[k] += std::cos(2 * std::numbers::pi * line * static_cast<double>(k) / static_cast<double>(n) + phase);
    }
  }
  std::vector<double> all;
  for (int period = 0; period < periods; ++period)
    for (const double value : one) all.push_back(value * std::sqrt(2.0 / lines));
  return all;
}

Command command_of_samples(const std::string& name, double period_s, std::vector<double> value_a) {
  constexpr double kSmallestStepA = 0.02;
  Command command = empty(name, "other");
  command.period_s = period_s;
  command.value_a = std::move(value_a);
  command.is_step.assign(command.value_a.size(), 0);
  const auto increment = [&](std::size_t k) {
    return k > 0 && k < command.value_a.size() ? std::abs(command.value_a[k] - command.value_a[k - 1]) : 0.0;
  };
  for (std::size_t k = 1; k < command.value_a.size(); ++k)
    command.is_step[k] =
        increment(k) > kSmallestStepA && increment(k) > 4 * std::max(increment(k - 1), increment(k + 1));
  return command;
}

}  // namespace valvetriage::stand
