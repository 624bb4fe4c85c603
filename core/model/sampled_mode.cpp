#include "core/model/sampled_mode.h"

#include <cassert>

namespace valvetriage {
namespace {

/// A step of `dynamics` in the rising mode's coordinates: its own ẏ/ω is `ratio` times that.
SampledMode::Step step_of(const SampledValveDynamics& dynamics, double ratio) {
  const auto& a = dynamics.transition();
  SampledMode::Step step{{{{a(0, 0), a(0, 1) / ratio}, {a(1, 0) * ratio, a(1, 1)}}}, {}};
  for (int k = 0; k < 4; ++k)
    step.gain[static_cast<std::size_t>(k)] = {dynamics.gain(k)(0) / ratio, dynamics.gain(k)(1)};
  return step;
}

SampledMode::Start stepped(const SampledMode::Step& step, const SampledMode::Start& x, const std::array<double, 4>& u) {
  SampledMode::Start to{};
  for (std::size_t j = 0; j < 2; ++j) {
    const double driven =
        step.gain[0][j] * u[0] + step.gain[1][j] * u[1] + step.gain[2][j] * u[2] + step.gain[3][j] * u[3];
    to[j] = step.transition[j][0] * x[0] + step.transition[j][1] * x[1] + driven;
  }
  return to;
}

}  // namespace

SampledMode::SampledMode(const ValveDynamics& mode, double fall_to_rise_ratio, double sample_period_s)
    : is_symmetric_(fall_to_rise_ratio == 1) {
  assert(mode.order() == 2 && fall_to_rise_ratio > 0);
  const SampledValveDynamics rising(mode, sample_period_s);
  whole_delay_ = rising.whole_delay();
  steps_[0] = steps_[1] = step_of(rising, 1);
  if (is_symmetric_) return;
  ValveDynamics slower = mode;
  slower.natural_frequency_rad_s /= fall_to_rise_ratio;
  steps_[1] = step_of({slower, sample_period_s}, fall_to_rise_ratio);
}

/// falls(i, x, seen): whether it is to fall over sample i, from x on under the ends of the intervals seen.
template <typename Falls>
void SampledMode::run(const IntervalSignal& input, const Start& start, std::span<double> out,
                      const Falls& falls) const {
  assert(input.start.size() >= out.size() && input.end.size() >= out.size());
  if (out.empty()) return;
  const double before = input.start[0];
  Start x{start[0], before + start[1]};
  std::array<double, 4> seen{before, before, before, before};
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = x[1];
    if (i >= whole_delay_) {
      seen = {seen[2], seen[3], input.start[i - whole_delay_], input.end[i - whole_delay_]};
    }
    x = stepped(steps_[falls(i, x, seen)], x, seen);
  }
}

SampledMode::Way SampledMode::run(const IntervalSignal& input, const Start& start, std::span<double> out) const {
  Way way;
  if (is_symmetric_) {
    run_along(way, input, start, out);
    return way;
  }
  way.reserve(out.size());
  run(input, start, out, [&](std::size_t, const Start& x, const std::array<double, 4>& seen) {
    way.push_back(0.25 * (seen[0] + seen[1] + seen[2] + seen[3]) < x[1]);
    return way.back();
  });
  return way;
}

void SampledMode::run_along(const Way& way, const IntervalSignal& change, const Start& start,
                            std::span<double> out) const {
  const bool never = way.empty();
  run(change, start, out, [&](std::size_t i, const Start&, const std::array<double, 4>&) { return !never && way[i]; });
}

}  // namespace valvetriage
