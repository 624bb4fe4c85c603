#include "core/analysis/folded_tones.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "core/identify/spectrum.h"

namespace valvetriage {
namespace {

// A fold must hold this many times the power at the frequency that was found: it has it all, or next to nothing.
constexpr double kClearlyMore = 4;

double angle_at(double frequency_hz, const Recording& recording, std::size_t i) {
  return 2 * std::numbers::pi * frequency_hz * static_cast<double>(i) * recording.sample_period_s;
}

/// Of a recording's residual, over its valid samples.
SineFit::Amplitudes sine_in(const Recording& recording, const std::vector<double>& without, double frequency_hz) {
  SineFit sine;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    if (recording.is_valid(i)) sine.add(angle_at(frequency_hz, recording, i), recording.output.values[i] - without[i]);
  }
  return sine.amplitudes();
}

struct Fold {
  double frequency_hz = 0;
  bool is_mirrored = false;  ///< k fₛ − f: it runs the other way round
};

/// Where a tone may truly be: below half the rate of the slowest recording that was thinned.
std::vector<Fold> folds_of(double frequency_hz, std::span<const Recording> recordings, const PartToFit& part) {
  double kept_hz = 0, given_hz = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    if (part.stride[r] == 1 || (given_hz > 0 && recordings[r].sample_rate_hz() > given_hz)) continue;
    given_hz = recordings[r].sample_rate_hz();
    kept_hz = given_hz / static_cast<double>(part.stride[r]);
  }
  std::vector<Fold> folds;
  for (double k = 1; kept_hz > 0 && k * kept_hz - frequency_hz < 0.5 * given_hz; ++k) {
    folds.push_back({k * kept_hz - frequency_hz, true});
    if (k * kept_hz + frequency_hz < 0.5 * given_hz) folds.push_back({k * kept_hz + frequency_hz, false});
  }
  return folds;
}

/// The fold that the recordings hold rather than the frequency as it was found.
std::optional<Fold> true_place(double found_hz, std::span<const Recording> recordings, const PartToFit& part,
                               const FreeRunsOf& without) {
  const auto power_at = [&](double frequency_hz) {
    double power = 0;
    for (std::size_t r = 0; r < recordings.size(); ++r) {
      if (part.stride[r] > 1) power += sine_in(recordings[r], without[r], frequency_hz).power();
    }
    return power;
  };
  double most = kClearlyMore * power_at(found_hz);
  std::optional<Fold> place;
  for (const Fold& fold : folds_of(found_hz, recordings, part)) {
    const double power = power_at(fold.frequency_hz);
    if (power <= most) continue;
    most = power;
    place = fold;
  }
  return place;
}

void move_to(const Fold& fold, NamedCause& cause) {
  for (auto& [name, estimate] : cause.parameters) {
    if (name != "frequency_hz") continue;
    std::array<double, 2> off{estimate.ci95[0] - estimate.value, estimate.ci95[1] - estimate.value};
    if (fold.is_mirrored) off = {-off[1], -off[0]};
    estimate.value = fold.frequency_hz;
    estimate.ci95 = {fold.frequency_hz + off[0], fold.frequency_hz + off[1]};
  }
}

}  // namespace

void unfold_tones(std::span<const Recording> recordings, const PartToFit& part, std::span<const FreeRunsOf> without,
                  std::vector<NamedCause>& causes, Model& model, FreeRunsOf& extended) {
  const std::size_t before = model.mechanisms.size() - causes.size();
  for (std::size_t c = 0; c < causes.size(); ++c) {
    if (causes[c].cause != "periodic_disturbance") continue;
    std::vector<double>& parameters = model.mechanisms[before + c].parameters;
    const auto fold = true_place(parameters[0], recordings, part, without[c]);
    if (!fold) continue;
    move_to(*fold, causes[c]);
    parameters[0] = fold->frequency_hz;
    for (std::size_t r = 0; r < recordings.size(); ++r) {
      const SineFit::Amplitudes sine = sine_in(recordings[r], without[c][r], fold->frequency_hz);
      if (r == 0) parameters[2] = sine.phase_rad();
      for (std::size_t i = 0; i < recordings[r].samples(); ++i) {
        const double angle = angle_at(fold->frequency_hz, recordings[r], i);
        extended[r][i] = without[c][r][i] + sine.sine * std::sin(angle) + sine.cosine * std::cos(angle);
      }
    }
  }
}

}  // namespace valvetriage
