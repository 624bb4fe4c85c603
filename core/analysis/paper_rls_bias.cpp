#include "core/analysis/paper_rls_bias.h"

#include <cassert>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>

#include "core/classify/paper_table.h"
#include "core/model/model.h"
#include "core/residual/fit_figures.h"
#include "core/residual/step_response.h"

namespace valvetriage {
namespace {

constexpr double kRest_psi = 26;

/// Normal deviates that are the same on every machine: splitmix64 (Steele, Lea and Flood 2014), Box and Muller.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : state_(seed) {}
  double normal() {
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  double uniform() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    z ^= z >> 31;
    return (static_cast<double>(z >> 11) + 0.5) * 0x1p-53;
  }
  std::uint64_t state_;
};

Model true_model(const RlsBiasScene& scene) {
  const double w = scene.natural_frequency_rad_s, zeta = scene.damping_ratio;
  const std::complex<double> pole(-zeta * w, w * std::sqrt(1 - zeta * zeta));
  Model model;
  model.kind = "linear";
  model.dynamics = {.domain = Domain::kS, .poles = {pole, std::conj(pole)}, .gain = scene.static_gain * w * w};
  model.input_offset = kPaperLow_a;
  model.output_offset = kRest_psi;
  return model;
}

std::size_t step_sample(const RlsBiasScene& scene) {
  return static_cast<std::size_t>(std::lround(scene.step_at_s * scene.sample_rate_hz));
}

Recording step_recording(const RlsBiasScene& scene, std::uint64_t seed) {
  const auto n = static_cast<std::size_t>(std::lround(scene.duration_s * scene.sample_rate_hz));
  const std::size_t step = step_sample(scene);
  Recording recording;
  recording.sample_period_s = 1 / scene.sample_rate_hz;
  recording.input.values.assign(n, kPaperHigh_a);
  std::fill_n(recording.input.values.begin(), step, kPaperLow_a);
  recording.segments = {
      {.kind = SegmentKind::kHold, .begin = 0, .end = step, .level = kPaperLow_a},
      {.kind = SegmentKind::kStep, .begin = step, .end = n, .level = kPaperHigh_a, .from_level = kPaperLow_a}};
  recording.output.values = *simulate(true_model(scene), recording, {});
  Noise noise(seed);
  for (double& y : recording.output.values) y += scene.noise_psi * noise.normal();
  return recording;
}

double eq20(const RlsBiasScene& scene, const Recording& recording, std::span<const double> simulated) {
  const StepWindow step{0, step_sample(scene), recording.samples(), kPaperHigh_a};
  const Eq20Window window{scene.sample_rate_hz, scene.duration_s - scene.step_at_s};
  return error_eq20(recording, simulated, step, window).value();
}

RlsOutcome identify_by(RlsForm form, const RlsBiasScene& scene, std::uint64_t seed, const Recording& recording) {
  RlsOptions options;
  options.form = form;
  options.delay_samples = 1;  // a held second-order system answers one sample later
  options.input_terms = 2;
  auto rls = *RecursiveLeastSquares::create(options);
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    const auto updated = rls.update(recording.input.values[i], recording.output.values[i]);
    assert(updated && "samples of the scene are finite");
    (void)updated;
  }
  const RationalCoefficients c = rls.coefficients(recording.sample_period_s);
  Model model;
  model.kind = "linear";
  model.dynamics = *to_transfer_function(c);
  model.input_offset = kPaperLow_a;
  const auto rest = recording.output.values.begin();
  const auto step = static_cast<std::ptrdiff_t>(step_sample(scene));
  model.output_offset = std::accumulate(rest, rest + step, 0.0) / static_cast<double>(step);
  RlsOutcome outcome{.form = form, .seed = seed, .stable = is_stable(model.dynamics), .a = c.a, .b = c.b};
  outcome.static_gain = static_gain(model.dynamics);
  const auto simulated = simulate(model, recording, {}, Horizon::kFinite);
  if (!simulated) return outcome;
  outcome.free_run_rmse = fit_figures(recording.output.values, *simulated, {}).rmse;
  outcome.error_eq20 = eq20(scene, recording, *simulated);
  return outcome;
}

}  // namespace

RationalCoefficients true_coefficients(const RlsBiasScene& scene) {
  return *to_coefficients(*discretise_zoh(true_model(scene).dynamics, 1 / scene.sample_rate_hz));
}

std::vector<RlsOutcome> compare_rls_forms(const RlsBiasScene& scene, std::span<const std::uint64_t> seeds) {
  std::vector<RlsOutcome> outcomes;
  for (const std::uint64_t seed : seeds) {
    const Recording recording = step_recording(scene, seed);
    for (const RlsForm form : {RlsForm::kIncremental, RlsForm::kExtended, RlsForm::kAbsolute}) {
      outcomes.push_back(identify_by(form, scene, seed, recording));
    }
  }
  return outcomes;
}

SimulatedDataReadings compare_simulated_data_readings(const RlsBiasScene& good, double slower_by, std::uint64_t seed) {
  RlsBiasScene returned = good;
  returned.natural_frequency_rad_s /= slower_by;
  const Recording recording = step_recording(returned, seed);
  return {.own_model = eq20(good, recording, simulate(true_model(returned), recording, {}).value()),
          .good_model = eq20(good, recording, simulate(true_model(good), recording, {}).value())};
}

}  // namespace valvetriage
