// hysteresis: magnetic memory; a smooth, rate-independent loop between current and force.
//
//   x = u − (W/2) Σ_k w_k E_k / r_k,   E_k ← clamp(E_k + Δu, −r_k, r_k),   r_k = r k/n,   w_k = 2k / (n (n+1))
//
// Stops of thresholds spread evenly up to r: branches are parabolas after a reversal (Rayleigh's law) and straight
// beyond 2r. It comes on top of a good valve's own loop.
//
// Source     Kuhnen, Eur. J. Control 9 (2003) 407 (Prandtl-Ishlinskii); Bertotti, Hysteresis in Magnetism (1998)
// Looks like a lens between the way up and the way down, rounded at reversals, the same at every rate
// Confused   with backlash and friction (flat after a reversal), extra_lag (a lens that grows with the rate)

#include <algorithm>
#include <array>
#include <vector>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kWidth, kReversal, kMemory };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"width_A", "A", "full width of the major loop at mid range, beyond a good valve's own"},
     {"reversal_A", "A", "half of the way after a reversal on which the loop is crossed"},
     {"memory", "", "state in which the recording begins, from -1 to 1; each recording has its own"}}};
constexpr std::size_t kStops = 8;
constexpr std::array<std::string_view, 3> kConfusedWith{"backlash", "friction", "extra_lag"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  MechanismBounds bounds{.lower = {0, 0.005 * range, -1},
                         .upper = {0.5 * range, 0.5 * range, 1},
                         .step = {1e-4 * range, 1e-3 * range, 0.05},
                         .starts = {}};
  for (const double width : {0.01 * range, 0.05 * range}) {
    for (const double reversal : spread(0.02 * range, 0.3 * range, 3)) bounds.starts.push_back({width, reversal, 0});
  }
  return bounds;
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> x) {
  if (x.empty() || parameters[kWidth] == 0) return;
  const std::vector<double> driver = context.driver.empty()
                                         ? std::vector<double>(x.begin(), x.end())
                                         : std::vector<double>(context.driver.begin(), context.driver.end());
  std::array<double, kStops> stop{};
  const double memory = parameters.size() > kMemory ? parameters[kMemory] : 0;
  for (std::size_t k = 0; k < kStops; ++k) {
    stop[k] = memory * parameters[kReversal] * static_cast<double>(k + 1) / kStops;
  }
  double previous = driver[0];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double move = driver[i] - previous;
    previous = driver[i];
    double held_back = 0;
    for (std::size_t k = 0; k < kStops; ++k) {
      const double bound = parameters[kReversal] * static_cast<double>(k + 1) / kStops;
      stop[k] = std::clamp(stop[k] + move, -bound, bound);
      held_back += stop[k];  // w_k / r_k is the same for all
    }
    x[i] -= parameters[kWidth] * held_back / (parameters[kReversal] * (kStops + 1));
  }
}

constexpr MemoryWidth kMemoryWidth{
    .has_corners = false,
    .width_a = [](std::span<const double> parameters) { return parameters[kWidth]; },
    .take_over = [](double width_a, std::span<double> parameters) { parameters[kWidth] = width_a; }};

}  // namespace

extern constinit const Mechanism kHysteresis{
    .order = 3,
    .cause = "hysteresis",
    .family = "memory",
    .origin = "valve",
    .wrong = "magnetic memory: smooth, rate-independent loop",
    .law = "x = u − (W/2) Σ w_k E_k / r_k,  E_k ← clamp(E_k + Δu, −r_k, r_k)",
    .source = "Kuhnen, Eur. J. Control 9 (2003) 407; Bertotti, Hysteresis in Magnetism (1998)",
    .signature = "a lens between the way up and the way down, rounded at reversals, the same at every rate",
    .confused_with = kConfusedWith,
    .place = Place::kInput,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = nullptr,
    .own_per_recording = 1,
    .memory = &kMemoryWidth};

}  // namespace valvetriage
