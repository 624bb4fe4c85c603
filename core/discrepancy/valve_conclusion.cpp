#include "core/discrepancy/valve_conclusion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>
#include <string_view>

#include "core/discrepancy/advise.h"
#include "core/discrepancy/evidence.h"
#include "core/discrepancy/heldout.h"
#include "core/discrepancy/leftover.h"
#include "core/discrepancy/own_parameters.h"
#include "core/discrepancy/recording_slip.h"
#include "core/discrepancy/settled.h"
#include "core/discrepancy/unnamed_account.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/residual/noise_floor.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
// An alternative below this probability is not worth a reader's time.
constexpr double kWorthNaming = 0.03;
// An extension that leaves more than this share of what was there does not explain it.
constexpr double kMostLeft = 0.25;
// What is left beside a name is something to be explained, however fast it is, where it is louder than noise and than
// any rest by a fifth in the rms. Jitter, lost samples and spikes of a stand stay below.
constexpr double kLoud = 1.2 * 1.2;
// A residual at rest this many deviations slower than white noise is not white.
constexpr double kWhiteAtRest = 5;
// A tone whose strength differs between recordings by half of it, in the root mean square, is none of the stand, and a
// drift whose rate differs by a tenth is not the same in all of them, as its law has it.
constexpr double kUnevenTone = 0.5, kUnevenDrift = 0.1;
// Of hunting in a recording: less is none.
constexpr double kHalfSeen = 0.5;
// A line this far above its neighbours, all lines of all recordings counted, is no chance of coloured noise.
constexpr double kCertainLine = 1e-6;
// However sure, a hundredth of what is left is no reason to doubt a valve: the hum of the mains under slow noise.
constexpr double kLeastOfALine = 0.01;
// A cause that the prior carries, a delay or a gain, neither helps nor harms held-out recordings: this much by chance.
constexpr double kMostHarm = 0.01;
// Noise variances by which held-out samples then have to be less foreseen than by the baseline: twenty to one.
constexpr double kMostSurprise = 6;
// Of a name whose extension leaves too much: as likely as not.
constexpr double kUnexplainedName = 0.5;
// Where nothing is named, what is left and the valve's own parameters share one risk of a false alarm (Bonferroni).
constexpr double kTestsOfNoName = 2;
constexpr int kRefitSteps = 12;

/// What a law does in one recording.
struct ShareIn {
  double energy = 0;  ///< of what it does, in noise variances
  double seen = 0;    ///< of it, by what the recording holds without it; 1 where it is all there
  /// The square of the deviation of that from 1, over its variance in white noise.
  double deviation() const { return energy * (1 - seen) * (1 - seen); }
};

std::vector<ShareIn> share_by_recording(const Explanation& explanation, const Explanation& others) {
  const Stack with = whitened_residual(explanation), alone = whitened_residual(others);
  std::vector<ShareIn> shares;
  for (std::size_t r = 0; r < with.size(); ++r) {
    const Eigen::VectorXd effect = alone[r] - with[r];
    const double energy = effect.squaredNorm();
    if (energy > 0) shares.push_back({energy, effect.dot(alone[r]) / energy});
  }
  return shares;
}

/// Whether what should be the same in every recording is not: how strong each recording has it, over all of them
/// together, and by more than noise.
///
/// uneven  root mean square of what they may differ by, as a share of it
bool is_uneven(std::span<const ShareIn> shares, double uneven, double inflation) {
  double energy = 0, deviation = 0;
  for (const ShareIn& share : shares) {
    energy += share.energy;
    deviation += share.deviation();
  }
  if (shares.empty()) return false;
  const double p = chi_squared_upper_tail(static_cast<double>(shares.size()), deviation / inflation);
  return deviation > uneven * uneven * energy && p < kFalseAlarm;
}

/// Whether hunting is not there in recordings that come to its level: they have less than half of it, by five standard
/// errors, and more is missing than a law, as an idealisation, errs by where the cycle dies out.
bool is_missing(std::span<const ShareIn> shares) {
  double energy = 0, missing = 0;
  for (const ShareIn& share : shares) {
    energy += share.energy;
    if (share.seen < kHalfSeen) missing += share.deviation();
  }
  return missing > std::max(kLeastEvidence, kIdealisation * energy);
}

FreeRunsOf runs_of(const Explanation& explanation) {
  FreeRunsOf runs;
  const ValveFitProblem& problem = *explanation.problem;
  for (std::size_t r = 0; r < problem.recordings(); ++r) runs.push_back(problem.simulate(explanation.v, r));
  return runs;
}

/// What the residual of an explanation depends on.
std::vector<Finding> dependences(const Explanation& explanation) {
  const ValveFitProblem& problem = *explanation.problem;
  std::vector<std::vector<double>> residuals = runs_of(explanation);
  std::vector<ResidualView> views;
  for (std::size_t r = 0; r < residuals.size(); ++r) {
    const std::vector<double>& measured = problem.recording(r).output.values;
    for (std::size_t i = 0; i < measured.size(); ++i) residuals[r][i] = measured[i] - residuals[r][i];
    views.push_back({&problem.recording(r), residuals[r], 1 / std::sqrt(problem.inverse_variance(r))});
  }
  return find_dependences(views);
}

/// A tone that some recordings have and others have not is no law's, and still nothing that good valves show.
bool has_certain_line(const std::vector<Finding>& findings) {
  return std::any_of(findings.begin(), findings.end(), [](const Finding& finding) {
    return finding.what == "has a line" && finding.p_value < kCertainLine &&
           finding.share_of_structured_residual > kLeastOfALine;
  });
}

double family_probability(const std::vector<Ranked>& ranked, std::string_view family) {
  double sum = 0;
  for (const Ranked& r : ranked) {
    const Mechanism* mechanism = find_mechanism(r.cause);
    if (mechanism && mechanism->family == family) sum += r.probability;
  }
  return sum;
}

/// How far 95 of 100 good valves lie from their mean, of n that were measured: the excess over a good valve is known no
/// better than that.
double half_width95(const CauseOnGoodValves& good, int good_valves) {
  const int n = good.size_valves.value_or(good_valves);
  if (n < 2 || !(good.size_sd > 0)) return 0;
  return student_t_half_width95(n - 1) * good.size_sd * std::sqrt(1 + 1.0 / n);
}

/// How far from an estimate the data allow a parameter, all else held: at least `half_width`, and on to where the cost
/// has risen as at the end of a 95 % interval. The cost of an instant or of a slip is not round: its curvature at the
/// best place says little of the next one. Profile likelihood: Venzon and Moolgavkar, Applied Statistics 37 (1988) 87.
double profiled_width(const Explanation& explanation, Eigen::Index entry, double half_width, double allowed) {
  constexpr int kMostTrials = 12;
  constexpr double kFarther = 1.6;
  double reach = std::abs(half_width);
  for (int trial = 0; trial < kMostTrials; ++trial, reach *= kFarther) {
    Eigen::VectorXd there = explanation.v;
    there(entry) += std::copysign(reach, half_width);
    there = explanation.problem->clamped(std::move(there));
    const bool is_bound = std::abs(there(entry) - explanation.v(entry)) < 0.999 * reach;
    if (is_bound || explanation.problem->cost(there) - explanation.cost >= allowed) break;
  }
  return reach;
}

/// Where the readings of good valves begin differs by this much: what stands at a level of the reading is known no
/// better.
double zero_width95(const ValveDiagnosisOptions& options) {
  const CauseOnGoodValves* zero = on_good_valves(options.causes, "sensor_offset");
  return zero ? half_width95(*zero, options.good_valves) : 0;
}

/// What a conclusion is drawn from.
struct Grounds {
  const SearchedValve& searched;
  const ValveDiagnosisOptions& options;
  Model extended;              ///< of what was searched
  double inflation = 1;        ///< of the noise
  std::vector<double> errors;  ///< of every parameter of every law, in order

  const Explanation& explanation() const { return searched.explanation; }
  std::span<const double> errors_of(std::size_t l) const {
    std::size_t at = 0;
    for (std::size_t before = 0; before < l; ++before) at += parameters_of(before);
    return std::span(errors).subspan(at, parameters_of(l));
  }

 private:
  std::size_t parameters_of(std::size_t l) const { return explanation().laws[l].law.law->parameters.size(); }
};

/// Whether how fast a reading drifts follows the output: by the integral of the output, as far as nothing else that the
/// fit moves explains it, over five standard errors, and by more than a law, as an idealisation, errs. Creep in
/// proportion to the load, of gauge or valve, goes like that, and is no drift of the reading.
///
/// linear  of the explanation
/// others  the explanation without the drift
bool follows_load(const LinearisedValve& linear, const Explanation& others, double inflation) {
  const ValveFitProblem& problem = linear.problem();
  Stack load;
  double of_drift = 0, of_load = 0, of_both = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    std::vector<double> crept = linear.run(r).output;
    double integral = 0;
    for (std::size_t i = 0; i < crept.size(); ++i) {
      if (recording.is_valid(i)) integral += recording.output.values[i] * recording.sample_period_s;
      crept[i] += integral;
    }
    load.push_back(linear.whitened(r, crept));
    const Eigen::VectorXd drift = linear.whitened(r, others.problem->simulate(others.v, r));
    of_drift += drift.squaredNorm();
    of_load += load.back().squaredNorm();
    of_both += drift.dot(load.back());
  }
  const LinearisedValve::Signature beyond = linear.signature(std::move(load));
  const double information = linear.product(beyond, beyond), against_error = linear.against_error(beyond);
  if (!(information > 0) || !(of_drift > 0)) return false;
  const double rate = against_error / information;
  const double uneven = rate * rate * (of_load - of_both * of_both / of_drift);
  return against_error * rate > kLeastEvidence * inflation && uneven > kIdealisation * kIdealisation * of_drift;
}

/// Whether a law that should do the same everywhere does not.
bool comes_and_goes(const Grounds& grounds, const LinearisedValve& linear) {
  const Explanation& explanation = grounds.explanation();
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
    const std::string_view cause = explanation.laws[l].law.law->cause;
    // Of a single tone the baseline takes up nothing.
    const bool is_tone = cause == "periodic_disturbance" || cause == "self_oscillation";
    if (!is_tone && cause != "sensor_drift") continue;
    const bool is_single = is_tone && explanation.laws.size() == 1;
    const Explanation others = is_single ? grounds.searched.baseline.copy() : without(explanation, l, 0);
    const auto shares = share_by_recording(explanation, others);
    if (cause == "self_oscillation" && is_missing(shares)) return true;
    if (cause == "periodic_disturbance" && is_uneven(shares, kUnevenTone, 1)) return true;
    if (cause == "sensor_drift" && is_uneven(shares, kUnevenDrift, grounds.inflation)) return true;
    if (cause == "sensor_drift" && follows_load(linear, others, grounds.inflation)) return true;
  }
  return false;
}

/// Puts the 95 % interval of a fitted parameter around its estimate: from the profile of the cost, `between`, what its
/// reading as a property of this valve alone is uncertain by, and what its law leaves out.
void add_interval(const Grounds& grounds, std::size_t l, std::size_t parameter, double between,
                  ParameterEstimate& estimate) {
  const Explanation& explanation = grounds.explanation();
  const double law_uncertainty = explanation.laws[l].law.law->parameters[parameter].law_uncertainty;
  const Eigen::Index entry = explanation.problem->law_entry(l, parameter, 0);
  for (const int side : {-1, 1}) {
    double width = kTwoSided95 * estimate.std_error;
    if (width > 0) {
      width = profiled_width(explanation, entry, side * width, kTwoSided95 * kTwoSided95 * grounds.inflation);
    }
    // Of a law's own uncertainty: as many times more as less.
    const double by_law = estimate.value * std::expm1(side * kTwoSided95 * law_uncertainty);
    estimate.ci95[side < 0 ? 0 : 1] = estimate.value + side * std::hypot(width, between, by_law);
  }
}

/// The parameters of a cause. A size is what the valve has beyond good valves, as far as these tell: what its own loops
/// and the law's leftover on good valves have of it is taken off.
void add_parameters(const Grounds& grounds, std::size_t l, NamedCause& named) {
  const Explanation& explanation = grounds.explanation();
  const LawInFit& in_fit = explanation.laws[l].law;
  const Mechanism& law = *in_fit.law;
  const CauseOnGoodValves* good = on_good_valves(grounds.options.causes, law.cause);
  const int good_valves = grounds.options.good_valves;
  std::vector<double> values = explanation.problem->law_parameters(explanation.v, l, 0);
  // A force on the moving spool beyond breakaway acts as breakaway does.
  if (law.cause == "friction") values[1] = std::min(values[1], values[0]);
  const double own = own_excess(law, explanation.v, *explanation.options);
  for (std::size_t j = 0; j < law.parameters.size(); ++j) {
    // A lower level below every output is none.
    const bool may_be_none = std::isinf(law.parameters[j].otherwise);
    if (may_be_none && values[j] < explanation.v(ValveFitProblem::kParameters)) continue;
    const bool has_neutral = std::isfinite(law.neutral);
    const bool is_size = good && j == law.size_parameter;
    const bool is_excess = is_size && has_neutral;
    const bool is_level = j == law.size_parameter && !has_neutral && law.parameters[j].unit == "psi";
    const bool is_force = law.cause == "friction" && law.parameters[j].unit == "A";
    // A whole number is searched and not varied: no error comes with it.
    const bool is_varied = in_fit.step[j] > 0;
    const double counted_from = j == law.size_parameter ? law.written_from(grounds.extended.volume) : 0;
    const double usual = is_excess ? good->size_mean - law.neutral : 0;
    ParameterEstimate estimate{.value = counted_from + values[j] - usual,
                               .std_error = is_varied ? grounds.errors_of(l)[j] : 0,
                               .unit = std::string(law.parameters[j].unit)};
    if (j == law.size_parameter || is_force) estimate.value += own;
    double between = is_level ? zero_width95(grounds.options) : 0;
    if (is_excess) {
      const double beyond = estimate.value - counted_from - law.neutral;
      between = std::hypot(half_width95(*good, good_valves), kTwoSided95 * kIdealisation * beyond);
    } else if (is_force) {
      // The law idealises the force in motion as far as the one at rest.
      between = kTwoSided95 * kIdealisation * estimate.value;
    }
    const double of_fit = estimate.std_error;
    add_interval(grounds, l, j, between, estimate);
    // One uncertainty, whichever way it is read: the law's own and what the fit's slope does not see are in the
    // interval.
    const double of_interval = (estimate.ci95[1] - estimate.ci95[0]) / (2 * kTwoSided95);
    if (std::isfinite(of_interval)) estimate.std_error = of_interval;
    // No interval leaves what the law allows, told from where the estimate is.
    estimate.ci95[0] =
        std::max(estimate.ci95[0], std::min(estimate.value, estimate.value + in_fit.lower[j] - values[j]));
    estimate.ci95[1] =
        std::min(estimate.ci95[1], std::max(estimate.value, estimate.value + in_fit.upper[j] - values[j]));
    if (in_fit.channel && law.parameters[j].name == "channel") {
      estimate = {.text = grounds.explanation().problem->recording(0).side[*in_fit.channel].name,
                  .population_mean = kUnknown,
                  .population_sd = kUnknown};
      named.parameters.emplace_back("channel", estimate);
      continue;
    }
    estimate.population_mean = is_excess ? counted_from + law.neutral : is_size ? good->size_mean : kUnknown;
    estimate.population_sd = is_size ? good->size_sd : kUnknown;
    if (is_size) {
      const double spread = std::hypot(good->size_sd, of_fit);
      named.severity_in_population_sd = spread > 0 ? std::abs(estimate.value - estimate.population_mean) / spread : 0;
    }
    named.parameters.emplace_back(std::string(law.parameters[j].name), estimate);
  }
}

/// Odds that a good valve shows as much by chance, to those of a fault, which are even before: the least that any fault
/// whose p-values are the smaller the likelier leaves for chance, −e p ln p. Sellke, Bayarri and Berger, The American
/// Statistician 55 (2001) 62.
double odds_of_chance(const WonPlace& place) {
  const double p = place.p_value;
  if (!(p > 0)) return 0;
  return p < 1 / std::numbers::e ? -std::numbers::e * p * std::log(p) : 1;
}

NamedCause named_cause(const Grounds& grounds, std::size_t l, bool explained) {
  const Mechanism& law = *grounds.explanation().laws[l].law.law;
  const WonPlace& place = grounds.searched.places[l];
  NamedCause named{
      .cause = std::string(law.cause), .family = std::string(law.family), .origin = std::string(law.origin)};
  named.p_value = place.p_value;
  const double is_there = 1 / (1 + odds_of_chance(place));
  named.family_probability = is_there * family_probability(place.ranked, law.family);
  for (const Ranked& r : place.ranked) {
    if (r.cause == named.cause) {
      named.probability = is_there * r.probability;
      named.evidence.push_back(fmt::format(
          "with it the squared error is less by {:.0f} noise variances, {:.0f} of them borne out wherever it "
          "acts; a good valve shows as much with a probability of {:.2g}",
          r.reduction, r.evidence.value, place.p_value));
    } else if (r.probability >= kWorthNaming) {
      named.alternatives.push_back(r.cause);
    }
  }
  if (!explained) {
    named.probability = std::min(named.probability, kUnexplainedName);
    named.family_probability = std::min(named.family_probability, kUnexplainedName);
  }
  if (explained && named.probability < kSettledProbability && named.alternatives.empty()) {
    const auto next =
        std::find_if(place.ranked.begin(), place.ranked.end(), [&](const Ranked& r) { return r.cause != named.cause; });
    if (next != place.ranked.end()) named.alternatives.push_back(next->cause);
  }
  add_parameters(grounds, l, named);
  return named;
}

/// The largest size of a law beside the explanation that the data do not exclude, good valves' own spread included.
std::map<std::string, double> limit_of(const Grounds& grounds, const LinearisedValve& linear, const Tested& tested) {
  const Explanation& explanation = grounds.explanation();
  const Mechanism& law = *tested.fit.law.law;
  const bool is_in = std::any_of(explanation.laws.begin(), explanation.laws.end(),
                                 [&](const LawFit& other) { return other.law.law->family == law.family; });
  if (is_in || law.size_parameter >= law.parameters.size()) return {};
  const CauseOnGoodValves* good = on_good_valves(grounds.options.causes, law.cause);
  const auto limit =
      upper_limit95(linear, *explanation.options, tested.fit, grounds.inflation, good ? good->size_sd : 0);
  if (!limit) return {};
  const double from = law.written_from(grounds.extended.volume);
  return {{std::string(law.parameters[law.size_parameter].name), from + *limit}};
}

/// The place whose winner has rivals, for the test that would settle it; the least settled first.
std::optional<std::size_t> open_place(const std::vector<NamedCause>& causes) {
  std::optional<std::size_t> open;
  for (std::size_t l = 0; l < causes.size(); ++l) {
    if (!causes[l].alternatives.empty() && (!open || causes[l].probability < causes[*open].probability)) open = l;
  }
  return open;
}

/// Of all recordings, where they have it.
double mean_of_channel(const ValveFitProblem& problem, std::string_view name) {
  double sum = 0, samples = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    for (const Channel& channel : problem.recording(r).side) {
      if (channel.name != name) continue;
      sum = std::accumulate(channel.values.begin(), channel.values.end(), sum);
      samples += static_cast<double>(channel.values.size());
    }
  }
  return samples > 0 ? sum / samples : 0;
}

Alternative alternative(const Explanation& explanation, std::string cause, double probability, double inflation) {
  // A test to come has no side channels yet: they stay at what they were in the mean.
  const auto usual = [&](std::string_view channel) { return mean_of_channel(*explanation.problem, channel); };
  Alternative made{.cause = std::move(cause),
                   .probability = probability,
                   .model = with_channels_at(usual, explanation.model()),
                   .moved = explanation.moved_models(inflation)};
  for (Model& moved : made.moved) moved = with_channels_at(usual, std::move(moved));
  return made;
}

/// The causes of a place, as they were fitted together with the valve.
std::vector<Alternative> alternatives_at(const Grounds& grounds, std::size_t open, const NamedCause& named) {
  const WonPlace& place = grounds.searched.places[open];
  const Explanation& explanation = grounds.explanation();
  const double inflation = grounds.inflation;
  std::vector<Alternative> alternatives;
  alternatives.push_back(alternative(explanation, named.cause, named.probability, inflation));
  std::optional<Explanation> others;
  for (const Ranked& r : place.ranked) {
    const auto& listed = named.alternatives;
    if (std::find(listed.begin(), listed.end(), r.cause) == listed.end()) continue;
    const double probability = std::max(r.probability, kWorthNaming);
    const auto fitted = std::find_if(place.rivals.begin(), place.rivals.end(), [&](const Explanation& rival) {
      return rival.laws.back().law.law->cause == r.cause && rival.laws.size() == explanation.laws.size();
    });
    if (fitted != place.rivals.end()) {
      alternatives.push_back(alternative(*fitted, r.cause, probability, inflation));
      continue;
    }
    const std::vector<Tested>& surveyed = grounds.searched.first.survey.tested;
    const auto tested =
        std::find_if(surveyed.begin(), surveyed.end(), [&](const Tested& t) { return t.cause() == r.cause; });
    // A search beside the baseline alone knows nothing of further laws.
    if (tested == surveyed.end() || explanation.laws.size() > 1) continue;
    if (!others) others = without(explanation, open, 0);
    alternatives.push_back(alternative(extend(*others, tested->fit, kRefitSteps, {.lead = explanation.cost}), r.cause,
                                       probability, inflation));
  }
  return alternatives;
}

const Ranked* entry_of(const std::string& cause, std::span<const Ranked> ranked) {
  const auto found = std::find_if(ranked.begin(), ranked.end(), [&](const Ranked& r) { return r.cause == cause; });
  return found == ranked.end() ? nullptr : &*found;
}

/// What the recordings say between a winner and a rival.
struct ToldApart {
  Contrast contrast;
  double noise_along = 1;
};

/// Looked at once for each pair, whatever the number of tests.
class PairsToldApart {
 public:
  const ToldApart& of(const Ranked& winner, const Ranked& rival) {
    const auto [told, is_new] = told_.try_emplace({&winner, &rival});
    if (is_new) {
      told->second = {.contrast = contrast(winner.residual, rival.residual),
                      .noise_along = noise_along(winner.residual, rival.residual)};
    }
    return told->second;
  }

 private:
  std::map<std::pair<const Ranked*, const Ranked*>, ToldApart> told_;
};

std::optional<NextTest> next_test(const Grounds& grounds, const std::vector<NamedCause>& causes, bool leaves_usual) {
  const auto open = open_place(causes);
  if (!open) return std::nullopt;
  const Explanation& explanation = grounds.explanation();
  const ValveFitProblem& problem = *explanation.problem;
  // What good valves have been put through, to the next knot, this one can be as well.
  const std::vector<double>& knots = grounds.options.fit.knots;
  AdviceOptions advice{.input_low = knots.front(), .input_high = knots.back()};
  double variance = 0, samples = 0, period_s = std::numeric_limits<double>::infinity();
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    const auto n = static_cast<double>(recording.valid_samples());
    variance += n / problem.inverse_variance(r);
    samples += n;
    period_s = std::min(period_s, recording.sample_period_s);
  }
  advice.noise_rms = std::sqrt(variance / samples);
  // What the best explanation leaves above the noise is the same in every sample of its place.
  advice.bias_rms = advice.noise_rms * std::sqrt(std::max(0.0, explanation.cost - noise_cost(explanation)) / samples);
  advice.sample_rate_hz = 1 / period_s;
  const std::vector<Ranked>& ranked = grounds.searched.places[*open].ranked;
  const double left_per_sample = std::pow(advice.bias_rms / advice.noise_rms, 2);
  advice.nothing = alternative(without(explanation, *open, kRefitSteps), "none", 0, grounds.inflation);
  PairsToldApart told_apart;
  const bool is_family_open = leaves_memory(*explanation.laws[*open].law.law, explanation.v, grounds.options);
  advice.settling = [&](const Alternative& true_one, const Alternative& rival, const PlayedTest& test) -> Settling {
    const Ranked *winner = entry_of(true_one.cause, ranked), *other = entry_of(rival.cause, ranked);
    if (!winner || !other) return {0.5 * kLeastEvidence};
    if (is_family_open && true_one.cause == causes[*open].cause && are_kin(*winner, *other))
      return {std::numeric_limits<double>::infinity()};
    const auto n = static_cast<double>(test.samples);
    // Where laws leave structure more samples leave more of it.
    const FurtherRecordings further{left_per_sample * n, test.removed};
    double lead = lead_still_asked_for(*winner, *other, leaves_usual, further, grounds.inflation, grounds.options);
    const ToldApart& told = told_apart.of(*winner, *other);
    if (const auto least_z = least_contrast(*winner, leaves_usual)) {
      lead = std::max(lead, gain_to_be_borne_out(told.contrast, *least_z, test.distance, n, told.noise_along));
    }
    return {0.5 * lead, told.noise_along};
  };
  return advise_next_test(alternatives_at(grounds, *open, causes[*open]), advice);
}

/// With the map that its model has: one that rises, where the fit's has a dip that noise made.
Explanation as_shown(const Explanation& explanation) {
  Explanation shown = explanation.copy();
  const ValveFitProblem& problem = *shown.problem;
  shown.v.segment(ValveFitProblem::kParameters, problem.knots()) = problem.rising_map(shown.v);
  return shown;
}

/// Free runs of the explanation without each of its laws in turn, nothing else moved.
std::vector<FreeRunsOf> runs_without(const Explanation& explanation) {
  std::vector<FreeRunsOf> runs;
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) runs.push_back(runs_of(without(explanation, l, 0)));
  return runs;
}

/// Of several laws, the others fitted again without each; none of one law, which leaves the baseline.
std::vector<Explanation> without_each(const Explanation& explanation) {
  std::vector<Explanation> others;
  if (explanation.laws.size() < 2) return others;
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) others.push_back(without(explanation, l, kRefitSteps));
  return others;
}

/// Held-out error with and without each cause.
void measure_each(const SearchedValve& searched, std::span<const Explanation> others, Discrepancy& discrepancy) {
  for (std::size_t l = 0; l < discrepancy.causes.size(); ++l) {
    NamedCause& cause = discrepancy.causes[l];
    cause.rmse_after = discrepancy.gain.rmse_extended;
    cause.rmse_before = discrepancy.gain.rmse_baseline;
    if (!others.empty()) cause.rmse_before = held_out_rmse(searched.baseline, others[l], searched.explanation);
  }
}

/// Several causes together, the named ones first; where one has rivals, with each of them in its place.
std::vector<Candidate> together_of(const std::vector<WonPlace>& places, const Discrepancy& discrepancy) {
  std::vector<Candidate> together{{.cause = "", .probability = 1}};
  for (std::size_t l = 0; l < discrepancy.causes.size(); ++l) {
    const NamedCause& named = discrepancy.causes[l];
    std::vector<std::pair<std::string, double>> here{{named.cause, 1}};
    for (const Ranked& r : places[l].ranked) {
      const auto& rivals = named.alternatives;
      if (r.cause == named.cause) here.front().second = r.probability;
      if (std::find(rivals.begin(), rivals.end(), r.cause) != rivals.end()) here.emplace_back(r.cause, r.probability);
    }
    double sum = 0;
    for (const auto& [cause, probability] : here) sum += probability;
    std::vector<Candidate> wider;
    for (const Candidate& before : together) {
      for (const auto& [cause, probability] : here) {
        wider.push_back({.cause = before.cause + (before.cause.empty() ? "" : "+") + cause,
                         .probability = before.probability * (sum > 0 ? probability / sum : 0),
                         .rmse_heldout = kUnknown,
                         .reason = "in the place of what is named"});
      }
    }
    together = std::move(wider);
  }
  together.front().rmse_heldout = discrepancy.gain.rmse_extended;
  together.front().reason = "each needed beside the others";
  return together;
}

/// What is there where one of several causes is chance: the others.
std::vector<Candidate> without_one(const std::vector<WonPlace>& places, const Discrepancy& discrepancy) {
  double odds = 1;
  for (const WonPlace& place : places) odds += odds_of_chance(place);
  std::vector<Candidate> fewer;
  for (std::size_t l = 0; l < discrepancy.causes.size(); ++l) {
    std::string others;
    for (std::size_t other = 0; other < discrepancy.causes.size(); ++other) {
      if (other != l) others += (others.empty() ? "" : "+") + discrepancy.causes[other].cause;
    }
    fewer.push_back({.cause = std::move(others),
                     .probability = odds_of_chance(places[l]) / odds,
                     .rmse_heldout = kUnknown,
                     .reason = "without " + discrepancy.causes[l].cause});
  }
  return fewer;
}

std::vector<Candidate> candidates_of(const Grounds& grounds, const Discrepancy& discrepancy, const Leftover& leftover,
                                     const LinearisedValve& linear, bool is_taken_up,
                                     std::span<const Finding> unnamed) {
  const SearchedValve& searched = grounds.searched;
  const bool is_none = discrepancy.conclusion == Conclusion::kNone;
  const bool is_unknown = discrepancy.conclusion == Conclusion::kUnexplained;
  const std::size_t laws = searched.explanation.laws.size();
  const std::vector<Ranked> unranked;
  const auto& ranked = laws == 0 ? searched.first.ranked : laws == 1 ? searched.places.front().ranked : unranked;
  // How much of the doubt is whose: a fault too small for these tests is still one, alone or beside another.
  const bool is_alone = laws == 1 && !is_unknown;
  const auto odds_of = [&](const std::string& cause) {
    const auto found = std::find_if(searched.unseen.begin(), searched.unseen.end(),
                                    [&](const UnseenCause& unseen) { return unseen.cause == cause; });
    return found == searched.unseen.end() ? 0 : found->odds;
  };
  double odds_of_any = 0;
  for (const UnseenCause& unseen : searched.unseen) odds_of_any += unseen.odds;
  const double chance = is_alone ? odds_of_chance(searched.places.front()) : 0;
  const double nothing_unseen = 1 / (1 + chance) / (1 + odds_of_any);
  std::vector<Candidate> candidates;
  candidates.push_back({.cause = "none",
                        .probability = is_none ? nothing_unseen : chance / (1 + chance),
                        .rmse_heldout = discrepancy.gain.rmse_baseline,
                        .reason = is_none    ? "nothing beyond what good valves leave"
                                  : is_alone ? "a good valve leaves as much by chance only"
                                             : "the simulation leaves more than any good valve would"});
  for (const Tested& tested : searched.first.survey.tested) {
    Candidate candidate{.cause = tested.cause(), .rmse_heldout = kUnknown};
    if (is_none) candidate.probability = odds_of(candidate.cause) * nothing_unseen;
    candidate.reason = fmt::format("evidence {:.1f} of {:.1f} promised, noise alone {:.1f}, in a good valve p {:.2g}",
                                   tested.evidence.value, tested.promise.value, tested.noise_reduction, tested.p_value);
    if (laws == 1 && candidate.cause == discrepancy.causes.front().cause) {
      candidate.rmse_heldout = discrepancy.gain.rmse_extended;
    }
    for (const Ranked& r : ranked) {
      if (r.cause != candidate.cause) continue;
      if (is_alone) candidate.probability = r.probability * nothing_unseen;
      if (r.fitted_jointly) {
        candidate.reason += fmt::format("; {:.1f} of {:.1f} fitted together with the valve, p {:.2g}", r.evidence.value,
                                        r.reduction, r.p_value);
      }
    }
    // Around a fit that has taken a fault up nothing says how large it may be.
    if (!is_taken_up) candidate.upper_limit95 = limit_of(grounds, linear, tested);
    candidates.push_back(std::move(candidate));
  }
  if (is_alone) {
    for (const UnseenCause& unseen : searched.unseen) {
      candidates.push_back({.cause = discrepancy.causes.front().cause + "+" + unseen.cause,
                            .probability = unseen.odds * nothing_unseen,
                            .rmse_heldout = kUnknown,
                            .reason = "a second fault too small for these tests"});
    }
  }
  if (laws > 1) {
    const std::vector<Candidate> fewer = without_one(searched.places, discrepancy);
    double fewer_than_all = 0;
    for (const Candidate& candidate : fewer) fewer_than_all += candidate.probability;
    std::vector<Candidate> several = together_of(searched.places, discrepancy);
    for (Candidate& together : several) together.probability *= 1 - fewer_than_all;
    for (const Candidate& candidate : fewer) {
      const auto known = std::find_if(candidates.begin(), candidates.end(),
                                      [&](const Candidate& c) { return c.cause == candidate.cause; });
      if (known == candidates.end()) {
        several.push_back(candidate);
      } else if (!is_unknown) {
        known->probability += candidate.probability;
      }
    }
    for (Candidate& candidate : several) {
      if (is_unknown) candidate.probability = 0;
      candidates.push_back(std::move(candidate));
    }
  }
  candidates.push_back({.cause = "unknown",
                        .probability = is_unknown ? 1.0 : 0.0,
                        .rmse_heldout = discrepancy.gain.rmse_black_box,
                        .reason = is_taken_up ? "the valve's own parameters are no good valve's"
                                  : unnamed.empty()
                                      ? fmt::format("what is left has p {:.2g} in a good valve", leftover.p_value)
                                      : unnamed.front().what});
  for (const Candidate& candidate : searched.first.survey.untestable) candidates.push_back(candidate);
  return candidates;
}

/// Whether recordings that the causes were not fitted to bear them out: they close a part of what the baseline leaves
/// there, or it leaves nothing, for a cause that the prior carries is one that the baseline takes up.
bool is_borne_out(const DiscrepancyGain& gain) {
  const double noise = gain.noise_floor * gain.noise_floor;
  const double there = gain.rmse_baseline * gain.rmse_baseline - noise;
  const double left = gain.rmse_extended * gain.rmse_extended - noise;
  return there < (kLoud - 1) * noise || left < (1 - kMostLeft) * there;
}

/// Whether what is left of the valve is what good valves leave, or little of what was there, and no sign speaks against
/// the causes.
bool is_explained(const Grounds& grounds, const LinearisedValve& linear, const Leftover& leftover,
                  const std::vector<Finding>& findings, const MeasuredGain& heldout) {
  const Explanation& explanation = grounds.explanation();
  const Explanation& baseline = grounds.searched.baseline;
  // A disturbance acts at rest as well: what it leaves there that is no white noise is not explained by it.
  const bool is_disturbed = std::any_of(explanation.laws.begin(), explanation.laws.end(),
                                        [](const LawFit& law) { return law.law.law->family == "disturbance"; });
  if (is_disturbed && leftover.at_rest_deviations > kWhiteAtRest) return false;
  if (comes_and_goes(grounds, linear)) return false;
  // What makes samples that it was not fitted to worse is not what happened, however well it fits the others; unless
  // the others tell too little of it to say.
  const bool is_unforeseen = heldout.surprise > kMostSurprise * grounds.inflation;
  if (heldout.gain.reduction < -kMostHarm && is_unforeseen) return false;

  const double noise = noise_cost(explanation);
  const bool is_loud = explanation.cost > kLoud * std::max(noise, leftover.at_rest * linear.samples());
  const double tests = explanation.laws.empty() ? kTestsOfNoName : 1;
  const bool is_left = tests * leftover.p_value < kFalseAlarm || leftover.slow_at_rest > kMostSlowNoise ||
                       (explanation.laws.empty() ? has_certain_line(findings) : is_loud);
  const double there = baseline.cost - noise_cost(baseline);
  const double remains = std::max(0.0, explanation.cost - noise);
  return !is_left || (!explanation.laws.empty() && remains < kMostLeft * there && is_borne_out(heldout.gain));
}

/// Whether a valve of which no cause is known leaves far more than noise and than good valves; and says so.
bool leaves_far_more_than_noise(const Explanation& explanation, double samples, const ValveDiagnosisOptions& options,
                                Leftover& leftover) {
  if (!explanation.laws.empty()) return false;
  std::optional<Finding> far = far_above_noise(explanation, samples, options);
  if (!far || kTestsOfNoName * far->p_value >= kFalseAlarm) return false;
  leftover.findings.push_back(std::move(*far));
  return true;
}

/// Better accounts than the laws', of what no cause stands for.
std::vector<Finding> unnamed_accounts(const Grounds& grounds, const LinearisedValve& linear,
                                      std::span<const Explanation> others) {
  const Explanation& explanation = grounds.explanation();
  std::vector<Finding> accounts;
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
    const Explanation& without_it = others.empty() ? grounds.searched.baseline : others[l];
    if (auto better = unnamed_account(explanation, linear, l, without_it, grounds.inflation)) {
      accounts.push_back(std::move(*better));
    }
  }
  return accounts;
}

ValveDiagnosis conclude_search(const SearchedValve& searched, const ValveDiagnosisOptions& options) {
  const Explanation& explanation = searched.explanation;
  const double inflation = noise_inflation(whitened_residual(explanation));
  const Grounds grounds{.searched = searched,
                        .options = options,
                        .extended = explanation.model(),
                        .inflation = inflation,
                        .errors = explanation.standard_errors(inflation)};
  const LinearisedValve linear(*explanation.problem, explanation.v);
  Leftover leftover = leftover_of(linear, options);
  std::vector<Finding> findings = dependences(searched.baseline);

  ValveDiagnosis diagnosis;
  Discrepancy& discrepancy = diagnosis.discrepancy;
  const MeasuredGain heldout = measure_gain(searched.baseline, explanation);
  discrepancy.gain = heldout.gain;
  // A fault that the fit has taken up leaves nothing: the valve is odd where its residual is not.
  const OwnParameters own =
      explanation.laws.empty() ? own_parameters_of(explanation.v, linear.errors(inflation), options) : OwnParameters{};
  const bool is_taken_up = kTestsOfNoName * own.p_value < kFalseAlarm;
  const std::vector<Explanation> others = without_each(explanation);
  const std::vector<Finding> unnamed = unnamed_accounts(grounds, linear, others);
  const bool leaves_much = leaves_far_more_than_noise(explanation, linear.samples(), options, leftover);
  const bool explained =
      !is_taken_up && !leaves_much && unnamed.empty() && is_explained(grounds, linear, leftover, findings, heldout);
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
    discrepancy.causes.push_back(named_cause(grounds, l, explained));
  }
  if (!explained) {
    discrepancy.conclusion = Conclusion::kUnexplained;
  } else if (explanation.laws.empty()) {
    discrepancy.conclusion = Conclusion::kNone;
  } else {
    discrepancy.conclusion = open_place(discrepancy.causes) ? Conclusion::kAmbiguous : Conclusion::kNamed;
  }

  discrepancy.findings = std::move(findings);
  discrepancy.findings.insert(discrepancy.findings.end(), leftover.findings.begin(), leftover.findings.end());
  discrepancy.findings.insert(discrepancy.findings.end(), own.findings.begin(), own.findings.end());
  discrepancy.findings.insert(discrepancy.findings.end(), unnamed.begin(), unnamed.end());
  measure_each(searched, others, discrepancy);
  discrepancy.candidates = candidates_of(grounds, discrepancy, leftover, linear, is_taken_up, unnamed);
  // No test tells apart causes of which none is the answer.
  if (explained) {
    discrepancy.next_test = next_test(grounds, discrepancy.causes, leftover.p_value > kUsualLeftover);
  }

  diagnosis.extended_model = grounds.extended;
  const Explanation shown = as_shown(explanation);
  diagnosis.extended = runs_of(shown);
  diagnosis.without_cause = runs_without(shown);
  return diagnosis;
}

ValveDiagnosis with_baseline(ValveDiagnosis diagnosis, const Explanation& baseline) {
  diagnosis.baseline_model = baseline.model();
  diagnosis.baseline = runs_of(as_shown(baseline));
  return diagnosis;
}

}  // namespace

ValveDiagnosis conclude(const SearchedValve& searched, const ValveDiagnosisOptions& options) {
  if (auto slip = slip_of_sign(searched.explanation)) return conclude_at_once(searched.baseline, std::move(*slip));
  return with_baseline(conclude_search(searched, options), searched.baseline);
}

ValveDiagnosis conclude_at_once(const Explanation& baseline, Finding slip) {
  return with_baseline(conclude_slip(baseline, std::move(slip)), baseline);
}

}  // namespace valvetriage
