// dead_band: no response inside an input interval, and no memory of the way there.
//
//   x > c + w/2: x − w/2     x < c − w/2: x + w/2     else c
//
// Source     Tao and Kokotović, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996), dead zone;
//            overlap of a spool's lands: Merritt, Hydraulic Control Systems (1967), chapter 5
// Looks like a flat in the steady map at one level, the same up and down; everything beyond is shifted by half the
// width Confused   with static_curve (bends everywhere), saturation (a flat that is not left at higher inputs),
// backlash and friction (a flat at every reversal)

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kCentre, kWidth };

constexpr std::array<MechanismParameter, 2> kParameters{
    {{"centre_A", "A", "middle of the interval"}, {"width_A", "A", "its full width"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"static_curve", "saturation", "backlash", "friction"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  MechanismBounds bounds{.lower = {scales.input_low, 0},
                         .upper = {scales.input_high, 0.5 * range},
                         .step = {1e-3 * range, 2e-4 * range},
                         .starts = {}};
  if (!(range > 0)) return bounds;
  // A narrow one shows nowhere but at its middle: a start every fortieth of the range.
  constexpr int kMiddles = 40;
  for (int i = 0; i < kMiddles; ++i) {
    bounds.starts.push_back({scales.input_low + (i + 0.5) / kMiddles * range, 0.01 * range});
  }
  for (const double at : {0.3, 0.55, 0.8}) bounds.starts.push_back({scales.input_low + at * range, 0.06 * range});
  return bounds;
}

/// A flat that the input does not leave on both sides may as well be a stop: a saturation. It leaves it where it goes
/// past it by more than its noise.
bool is_cut_off(std::span<const double> parameters, std::span<const double> lower, std::span<const double> upper) {
  constexpr double kNoise = 0.01;  // of the range of the input
  const double past = kNoise * (upper[kCentre] - lower[kCentre]);
  const double centre = parameters[kCentre], half = 0.5 * parameters[kWidth];
  return centre - half <= lower[kCentre] + past || centre + half >= upper[kCentre] - past;
}

void apply(std::span<const double> parameters, const LawContext&, std::span<double> x) {
  const double centre = parameters[kCentre], half = 0.5 * parameters[kWidth];
  for (double& value : x) {
    const double from = value - centre;
    value = from > half ? value - half : from < -half ? value + half : half > 0 ? centre : value;
  }
}

void tangent(std::span<const double> parameters, const LawContext&, std::span<const double> before,
             std::span<double> change) {
  const double centre = parameters[kCentre], half = 0.5 * parameters[kWidth];
  for (std::size_t i = 0; i < change.size(); ++i) {
    const double from = before[i] - centre;
    if (half > 0 && from <= half && from >= -half) change[i] = 0;
  }
}

}  // namespace

extern constinit const Mechanism kDeadBand{
    .order = 4,
    .cause = "dead_band",
    .family = "static",
    .origin = "valve",
    .wrong = "no response inside an input interval, no memory",
    .law = "x − w/2 above c + w/2, x + w/2 below c − w/2, c between",
    .source =
        "Tao, Kokotović, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996); Merritt, "
        "Hydraulic Control Systems (1967), chapter 5",
    .signature = "a flat in the steady map at one level, the same up and down; beyond it the map is shifted",
    .confused_with = kConfusedWith,
    .place = Place::kPosition,
    .parameters = kParameters,
    .size_parameter = kWidth,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr,
    .is_cut_off = is_cut_off};

}  // namespace valvetriage
