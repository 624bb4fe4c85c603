#include <array>
#include <cmath>

#include "core/model/machine.h"

namespace valvetriage {
namespace {

using Names = std::span<const std::string_view>;

constexpr std::array<std::string_view, 2> kAffineNames{"scale", "offset"};
constexpr std::array<std::string_view, 1> kPlayNames{"width"};
constexpr std::array<std::string_view, 2> kStickNames{"breakaway", "kinetic"};
constexpr std::array<std::string_view, 2> kLoopNames{"width", "reach"};
constexpr std::array<std::string_view, 2> kBandNames{"centre", "width"};
constexpr std::array<std::string_view, 2> kLimitNames{"level", "softness"};
constexpr std::array<std::string_view, 3> kCurveNames{"curvature", "zero", "range"};
constexpr std::array<std::string_view, 1> kFoldNames{"fold"};
constexpr std::array<std::string_view, 1> kRateNames{"limit_per_s"};
constexpr std::array<std::string_view, 2> kLagNames{"rising_s", "falling_s"};
constexpr std::array<std::string_view, 1> kSpringNames{"centre"};
constexpr std::array<std::string_view, 2> kBoucWenNames{"beta", "delta"};
constexpr std::array<std::string_view, 8> kMotionNames{"gain",    "gain_before", "bias",      "stiffness",
                                                       "damping", "coulomb",     "breakaway", "shows_speed"};
constexpr std::array<std::string_view, 11> kTankNames{"tanks",         "gain",     "closed",        "outflow_upper",
                                                      "outflow_lower", "exponent", "rim_upper",     "share",
                                                      "rim_lower",     "zero",     "exponent_upper"};
constexpr std::array<std::string_view, 3> kToneNames{"sine", "cosine", "frequency_hz"};
constexpr std::array<std::string_view, 1> kDriftNames{"rate_per_s"};
constexpr std::array<std::string_view, 3> kWarmingNames{"gain_change", "time_constant_s", "centre"};
constexpr std::array<std::string_view, 3> kStepNames{"gain_change", "time_s", "centre"};
constexpr std::array<std::string_view, 2> kSideNames{"coefficient", "centre"};

struct LawEntry {
  MachineLaw law;
  std::string_view name;
  Names parameters;
};

const std::array<LawEntry, kMachineLaws> kLaws{{{MachineLaw::kLinear, "linear", {}},
                                                {MachineLaw::kAffine, "affine", kAffineNames},
                                                {MachineLaw::kPlay, "play", kPlayNames},
                                                {MachineLaw::kStickSlip, "stick_slip", kStickNames},
                                                {MachineLaw::kLoop, "loop", kLoopNames},
                                                {MachineLaw::kDeadBand, "dead_band", kBandNames},
                                                {MachineLaw::kUpperLimit, "upper_limit", kLimitNames},
                                                {MachineLaw::kLowerLimit, "lower_limit", kLimitNames},
                                                {MachineLaw::kCurve, "curve", kCurveNames},
                                                {MachineLaw::kMagnitude, "magnitude", kFoldNames},
                                                {MachineLaw::kRateLimit, "rate_limit", kRateNames},
                                                {MachineLaw::kLag, "lag", kLagNames},
                                                {MachineLaw::kSpring, "spring", kSpringNames},
                                                {MachineLaw::kRestoringLoop, "restoring_loop", kBoucWenNames},
                                                {MachineLaw::kMotion, "motion", kMotionNames},
                                                {MachineLaw::kTanks, "tanks", kTankNames},
                                                {MachineLaw::kTone, "tone", kToneNames},
                                                {MachineLaw::kDrift, "drift", kDriftNames},
                                                {MachineLaw::kWarming, "warming", kWarmingNames},
                                                {MachineLaw::kGainStep, "gain_step", kStepNames},
                                                {MachineLaw::kSide, "side", kSideNames}}};

const LawEntry& entry_of(MachineLaw law) {
  return kLaws[static_cast<std::size_t>(law)];
}

bool is_finite(std::span<const double> values) {
  for (const double value : values) {
    if (!std::isfinite(value)) return false;
  }
  return true;
}

bool is_stable(const Section& s) {
  if (s.order == 1) return s.f > 0 && s.f < 2;
  return s.order == 2 && s.e > 0 && s.e < 2 && s.f > 0 && s.f < 4 - 2 * s.e;
}

Result<void> check_block(const MachineBlock& block) {
  const auto bad = [&](const char* what) {
    return fail("machine_malformed", std::string(name_of(block.law)) + ": " + what);
  };
  constexpr int kMostDelay = 1'000'000;
  if (block.parameters.size() != parameter_names(block.law).size()) return bad("not as many parameters as the law has");
  if (!is_finite(block.parameters) || !is_finite(block.numerator) || !is_finite(block.feedback)) {
    return bad("a number that is not finite");
  }
  for (const Section& section : block.sections) {
    if (!is_stable(section)) return bad("a section that is not stable");
  }
  const auto order = static_cast<std::size_t>(order_of(block.sections));
  if (block.numerator.size() > order + 1 || block.feedback.size() > order) return bad("more coefficients than states");
  if (block.delay_samples < 0 || block.delay_samples > kMostDelay) return bad("a delay out of range");
  return {};
}

}  // namespace

std::string_view name_of(MachineLaw law) {
  return entry_of(law).name;
}

std::optional<MachineLaw> machine_law_from(std::string_view name) {
  for (const LawEntry& entry : kLaws) {
    if (entry.name == name) return entry.law;
  }
  return std::nullopt;
}

std::span<const std::string_view> parameter_names(MachineLaw law) {
  return entry_of(law).parameters;
}

Result<void> check_machine(const Machine& machine) {
  if (!(machine.sample_period_s > 0)) return fail("machine_malformed", "a machine needs a positive sample period");
  for (const MachineBlock& block : machine.blocks) {
    if (const auto checked = check_block(block); !checked) return checked;
  }
  return {};
}

}  // namespace valvetriage
