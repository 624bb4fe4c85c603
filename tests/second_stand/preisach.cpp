#include "tests/second_stand/preisach.h"

#include <cmath>
#include <numbers>

namespace valvetriage::second_stand {
namespace {

constexpr double kLowestA = -0.5, kHighestA = 3.5;  // both saturated
constexpr double kStrength = 0.4;                   // χ
constexpr double kModulation = 0.4;                 // m
constexpr double kCentreA = 1.5, kPerA = std::numbers::pi / 1.5;

}  // namespace

Preisach::Preisach(double width_a) : turns_{{kLowestA, 0}}, current_a_(kLowestA) {
  if (width_a <= 0) return;
  double low_a = 0, high_a = 1;
  for (int halving = 0; halving < 50; ++halving) {
    const double middle_a = 0.5 * (low_a + high_a);
    (loop_width_a(middle_a) < width_a ? low_a : high_a) = middle_a;
  }
  coercive_a_ = 0.5 * (low_a + high_a);
}

double Preisach::loop_width_a(double coercive_a) {
  coercive_a_ = coercive_a;
  const double rising = everett(1.6, 1.0), falling = everett(2.0, 1.0) - everett(2.0, 1.6);
  return kStrength * (falling - rising);
}

double Preisach::everett(double high_a, double low_a) const {
  // ∫ over the triangle of relays that switch up below `high_a` and down above `low_a`, in closed form
  const double half = 0.5 * (high_a - low_a), w = coercive_a_, turn = kPerA * w;
  const double left = std::exp(-half / w);
  const double even = half - w * (1 - left);
  const double wave = (std::sin(kPerA * half) - turn * (std::cos(kPerA * half) - left)) / (kPerA * (1 + turn * turn));
  return 2 * (even + kModulation * std::cos(kPerA * (0.5 * (high_a + low_a) - kCentreA)) * wave);
}

double Preisach::advance(double current_a) {
  if (coercive_a_ == 0) return current_a;
  const auto rising = [&] { return turns_.size() % 2 == 1; };  // the last turn was a low one
  if (current_a != current_a_ && (current_a > current_a_) != rising()) {
    const double at_turn = rising() ? turns_.back().magnetisation + everett(current_a_, turns_.back().current_a)
                                    : turns_.back().magnetisation - everett(turns_.back().current_a, current_a_);
    turns_.push_back({current_a_, at_turn});
  }
  // A turn is forgotten together with the one after it once the current passes it (wiping out).
  while (turns_.size() >= 3 && (rising() ? current_a >= turns_[turns_.size() - 2].current_a
                                         : current_a <= turns_[turns_.size() - 2].current_a))
    turns_.resize(turns_.size() - 2);
  current_a_ = current_a;
  const Turn& last = turns_.back();
  const double now = rising() ? last.magnetisation + everett(current_a, last.current_a)
                              : last.magnetisation - everett(last.current_a, current_a);
  const double up = everett(current_a, kLowestA);
  const double down = everett(kHighestA, kLowestA) - everett(kHighestA, current_a);
  return current_a + kStrength * (now - 0.5 * (up + down));
}

}  // namespace valvetriage::second_stand
