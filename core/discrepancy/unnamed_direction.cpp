#include "core/discrepancy/unnamed_direction.h"

#include <fmt/core.h>

#include <cmath>
#include <limits>

#include "core/discrepancy/evidence.h"

namespace valvetriage {
namespace {

// Slower than any lag a cause stands for, and within what a test holds a level for.
constexpr double kCreep_s = 5;

using Change = void (*)(std::vector<double>& output, double sample_period_s);

/// By a second of delay after a second.
void make_later_and_later(std::vector<double>& output, double) {
  const std::vector<double> before = output;
  const double middle = 0.5 * static_cast<double>(before.size() - 1);
  for (std::size_t i = 1; i + 1 < before.size(); ++i) {
    // Seconds of the slope and of the time cancel: both are counted in samples.
    output[i] -= 0.5 * (before[i + 1] - before[i - 1]) * (static_cast<double>(i) - middle);
  }
}

/// All of it.
void make_follow_for_seconds(std::vector<double>& output, double sample_period_s) {
  const double keep = std::exp(-sample_period_s / kCreep_s);
  double late = output.front();
  for (double& value : output) value = late = keep * late + (1 - keep) * value;
}

/// Whitened, per unit.
Stack effect_of(Change change, const LinearisedValve& fit) {
  Stack effect;
  for (std::size_t r = 0; r < fit.error().size(); ++r) {
    std::vector<double> changed = fit.run(r).output;
    if (!changed.empty()) change(changed, fit.problem().recording(r).sample_period_s);
    effect.push_back(fit.whitened(r, changed));
  }
  return effect;
}

std::string growing_delay_words(double size) {
  return fmt::format(
      "the output comes {} and {} by {:.3g} us in every second of a recording, as where its clock runs "
      "{:.3g} ppm {} than the input's",
      size > 0 ? "later" : "sooner", size > 0 ? "later" : "sooner", 1e6 * std::abs(size), 1e6 * std::abs(size),
      size > 0 ? "faster" : "slower");
}

std::string creep_words(double size) {
  return size > 0 ? fmt::format("{:.2g} % of the output follows some {:.0f} s late, as where a part creeps", 100 * size,
                                kCreep_s)
                  : fmt::format("the output moves {:.2g} % too far and comes back within some {:.0f} s", -100 * size,
                                kCreep_s);
}

}  // namespace

std::vector<UnnamedDirection> unnamed_directions(const LinearisedValve& fit) {
  struct Kind {
    const char* name;
    Change change;
    std::string (*words)(double size);
  };
  static constexpr Kind kKinds[] = {{"a delay that grows", make_later_and_later, growing_delay_words},
                                    {"following for seconds", make_follow_for_seconds, creep_words}};
  const double inflation = noise_inflation(fit.residual_alone());
  std::vector<Stack> effects;
  for (const Kind& kind : kKinds) effects.push_back(effect_of(kind.change, fit));
  std::vector<LinearisedValve::Signature> signatures = fit.signatures(std::move(effects));
  std::vector<UnnamedDirection> directions;
  for (std::size_t k = 0; k < signatures.size(); ++k) {
    const double information = fit.product(signatures[k], signatures[k]), error = fit.against_error(signatures[k]);
    UnnamedDirection direction{.name = kKinds[k].name,
                               .finding = {},
                               .signature = std::move(signatures[k]),
                               .evidence = std::numeric_limits<double>::quiet_NaN()};
    if (information > 0) {
      const double size = error / information;
      direction.finding = kKinds[k].words(size);
      direction.evidence = error * size / inflation;
      for (Eigen::VectorXd& column : direction.signature.column) column *= size;
      direction.signature.load *= size;
      direction.signature.absorbed *= size;
    }
    directions.push_back(std::move(direction));
  }
  return directions;
}

double direction_p_value(double evidence, const LeftoverOnGoodValves& good, int valves) {
  const double usual = std::expm1(good.mean);
  return square_p_value(evidence / (1 + usual), usual, std::exp(good.mean) * good.sd, valves);
}

}  // namespace valvetriage
