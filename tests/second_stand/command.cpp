#include "tests/second_stand/command.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/second_stand/random.h"

namespace valvetriage::second_stand {
namespace {

constexpr double kRateHz = 200, kRestA = 1.0, kMiddleA = 1.6;
constexpr std::array<double, 5> kLevelsA = {1.2, 1.4, 1.6, 1.8, 2.0};

/// Writes a command piece by piece.
class Score {
 public:
  Score(std::string name, std::string test) {
    command_.name = std::move(name);
    command_.test = std::move(test);
  }
  Score& hold(double level_a, double seconds) {
    const auto count = static_cast<std::size_t>(std::lround(seconds * kRateHz));
    for (std::size_t k = 0; k < count; ++k) play(level_a, k == 0);
    return *this;
  }
  Score& go(double to_a, double seconds) {
    const double from_a = command_.value_a.back();
    const auto count = static_cast<std::size_t>(std::lround(seconds * kRateHz));
    for (std::size_t k = 1; k <= count; ++k)
      play(from_a + (to_a - from_a) * static_cast<double>(k) / static_cast<double>(count), false);
    return *this;
  }
  template <class Function>
  Score& follow(double seconds, Function value_a) {
    const auto count = static_cast<std::size_t>(std::lround(seconds * kRateHz));
    for (std::size_t k = 0; k < count; ++k) play(value_a(static_cast<double>(k) / kRateHz), false);
    return *this;
  }
  Command done() { return std::move(command_); }

 private:
  void play(double value_a, bool jump) {
    const bool moves = !command_.value_a.empty() && command_.value_a.back() != value_a;
    command_.instant_s.push_back(static_cast<double>(command_.value_a.size()) / kRateHz);
    command_.value_a.push_back(value_a);
    command_.jumps.push_back(jump && moves);
  }
  Command command_;
};

Command steps() {
  Score score("steps", "step");
  score.hold(kRestA, 1.5);
  for (const double level_a : kLevelsA) score.hold(level_a, 2.2).hold(kRestA, 1.5);
  return score.done();
}

std::vector<Command> step_per_level() {
  std::vector<Command> all;
  for (const double level_a : kLevelsA) {
    const auto tenths = std::to_string(std::lround(level_a * 10));
    Score score("step_" + tenths.substr(0, 1) + "." + tenths.substr(1) + "A", "step");
    all.push_back(score.hold(kRestA, 1.5).hold(level_a, 4).hold(kRestA, 2.5).done());
  }
  return all;
}

Command staircase() {
  Score score("staircase", "staircase");
  score.hold(kRestA, 1.9);
  for (const double level_a : kLevelsA) score.hold(level_a, 1.8);
  for (auto level = kLevelsA.rbegin() + 1; level != kLevelsA.rend(); ++level) score.hold(*level, 1.8);
  return score.hold(kRestA, 1.9).done();
}

Command triangle(const std::string& name, double ramp_s, int cycles) {
  Score score(name, "triangle");
  score.hold(kRestA, 1);
  for (int i = 0; i < cycles; ++i) score.go(2.0, ramp_s).go(kRestA, ramp_s);
  return score.hold(kRestA, 1).done();
}

/// Frequency rises by one octave in equal times, 0.2 to 20 Hz.
Command sweep(const std::string& name, double amplitude_a) {
  constexpr double kFromHz = 0.2, kToHz = 20, kSeconds = 19;
  const double octaves_per_s = std::log2(kToHz / kFromHz) / kSeconds;
  const double turns_per_octave = kFromHz / (octaves_per_s * std::numbers::ln2);
  return Score(name, "sweep")
      .hold(kMiddleA, 1)
      .follow(kSeconds,
              [&](double t) {
                const double turns = turns_per_octave * (std::exp2(octaves_per_s * t) - 1);
                return kMiddleA + amplitude_a * std::sin(2 * std::numbers::pi * turns);
              })
      .done();
}

/// Four periods of 5 s: lines 1, 3, 5 ... of 0.2 Hz to 15 Hz, every fourth of them left out, with Schroeder's phases
/// (Schroeder 1970), which keep the crest low.
Command multisine() {
  constexpr double kLineHz = 0.2, kHighestHz = 15, kRmsA = 0.06;
  std::vector<int> lines;
  for (int odd = 0; (2 * odd + 1) * kLineHz <= kHighestHz; ++odd)
    if (odd % 4 != 2) lines.push_back(2 * odd + 1);
  const auto count = static_cast<double>(lines.size());
  return Score("multisine", "other")
      .follow(4 / kLineHz,
              [&](double t) {
                double sum = 0;
                for (std::size_t i = 0; i < lines.size(); ++i) {
                  const auto n = static_cast<double>(i);
                  sum += std::cos(2 * std::numbers::pi * kLineHz * lines[i] * t - std::numbers::pi * n * n / count);
                }
                return kMiddleA + kRmsA * std::sqrt(2 / count) * sum;
              })
      .done();
}

}  // namespace

const std::vector<std::string>& repertoire() {
  static const std::vector<std::string> names = {"steps",         "step",  "step_up",    "staircase", "triangle",
                                                 "triangle_fast", "sweep", "sweep_high", "multisine"};
  return names;
}

std::vector<std::string> full_session() {
  return {"steps", "staircase", "triangle", "triangle_fast", "sweep", "multisine"};
}

std::vector<Command> commands_of(const std::string& test) {
  if (test == "steps") return {steps()};
  if (test == "step") return step_per_level();
  if (test == "step_up") return {Score("step_up_1.6A", "step").hold(kRestA, 1.5).hold(kMiddleA, 4).done()};
  if (test == "staircase") return {staircase()};
  if (test == "triangle") return {triangle("triangle", 9, 1)};
  if (test == "triangle_fast") return {triangle("triangle_fast", 1.5, 6)};
  if (test == "sweep") return {sweep("sweep", 0.1)};
  if (test == "sweep_high") return {sweep("sweep_high", 0.3)};
  if (test == "multisine") return {multisine()};
  throw std::invalid_argument("no test '" + test + "' in the repertoire (see `effects`)");
}

Command given_command(const std::string& name, std::vector<double> instant_s, std::vector<double> value_a) {
  constexpr double kSmallestJumpA = 0.02, kStandsStill = 0.25;
  Command command{name, "other", std::move(instant_s), std::move(value_a), {}};
  const auto change = [&](std::size_t k) {
    return k > 0 && k < command.value_a.size() ? std::abs(command.value_a[k] - command.value_a[k - 1]) : 0.0;
  };
  for (std::size_t k = 0; k < command.value_a.size(); ++k)
    command.jumps.push_back(change(k) > kSmallestJumpA &&
                            std::max(change(k - 1), change(k + 1)) < kStandsStill * change(k));
  return command;
}

double CommandReader::mean(double from_s, double to_s) {
  double area = 0, at_s = from_s;
  const auto& instants = command_->instant_s;
  for (; segment_ < instants.size() && instants[segment_] < to_s; ++segment_) {
    if (instants[segment_] <= at_s) continue;
    area += inside(at_s, instants[segment_]);
    at_s = instants[segment_];
  }
  return (area + inside(at_s, to_s)) / (to_s - from_s);
}

double CommandReader::inside(double from_s, double to_s) const {
  const auto& c = *command_;
  if (segment_ == 0) return (to_s - from_s) * c.value_a.front();
  if (segment_ == c.value_a.size()) return (to_s - from_s) * c.value_a.back();
  const double before_a = c.value_a[segment_ - 1], began_s = c.instant_s[segment_ - 1];
  if (c.jumps[segment_]) return (to_s - from_s) * before_a;
  const double slope = (c.value_a[segment_] - before_a) / (c.instant_s[segment_] - began_s);
  return (to_s - from_s) * (before_a + slope * (0.5 * (from_s + to_s) - began_s));
}

}  // namespace valvetriage::second_stand
