#include "core/discrepancy/valve_diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <set>

#include "core/discrepancy/evidence.h"
#include "core/discrepancy/heldout.h"
#include "core/discrepancy/input_lines.h"
#include "core/discrepancy/valve_catalogue.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// A healthy valve is called so 99 times in 100: half of that risk for the laws together, half for the leftover.
constexpr double kFalseAlarm = 0.005;
constexpr int kSearchSteps = 5;
// A law is refined where its best start promises this much of the cost, and this share of the best law so far.
constexpr double kLeastPromise = 8;
constexpr double kLeastShare = 0.02;
// Five standard errors: eight good valves that show nothing of a cause do not say how rarely a good valve does.
constexpr double kLeastEvidence = 25;
// A size that one good valve in a hundred has by the spread of the others says nothing against a valve.
constexpr double kLikeGoodValves = 0.01;
// Joint fits of those that the survey leaves in the race: this far behind the best in ln likelihood, this many at most.
constexpr double kInTheRace = 30;
constexpr std::size_t kMostJointFits = 3;
constexpr std::size_t kGoodValveJointFits = 3;
constexpr int kJointSteps = 12;
// A residual this many times slower than white noise has bent the baseline.
constexpr double kBent = 6;
// A further cause explains at least this share of what is left above the noise (three in ten, lesson of the pairs).
constexpr double kShareOfASecond = 0.3;
constexpr std::size_t kMostCauses = 3;
constexpr double kSettled = 0.95;
// A rival that removes this share of what the winner removes is still one (a margin of 1.2, lesson of other machines).
constexpr double kMargin = 1 / 1.2;
constexpr double kRivalShare = 0.25;
// An alternative below this probability is not worth a reader's time.
constexpr double kWorthNaming = 0.03;

/// The size of an explanation's last law.
double size_in(const Explanation& explanation) {
  const std::size_t last = explanation.laws.size() - 1;
  const std::vector<double> parameters = explanation.problem->law_parameters(explanation.v, last, 0);
  const std::size_t at = explanation.laws[last].law.law->size_parameter;
  return at < parameters.size() ? parameters[at] : 1;
}

/// One law of a survey with what its evidence means.
struct Tested {
  LawFit fit;
  double evidence = 0;         ///< verified reduction, no more than is consistent
  double promise = 0;          ///< the same of the linear forecast
  double noise_reduction = 0;  ///< what noise alone would give after the search
  double p_value = 1;

  std::string cause() const { return std::string(fit.law.law->cause); }
  double size() const {
    const std::size_t at = fit.law.law->size_parameter;
    return at < fit.parameters.size() ? fit.parameters[at] : 1;
  }
};

/// A reduction of the cost as evidence: no more of it than what is left allows.
double evidence_of(double reduction, double consistent) {
  return std::max(0.0, std::min(reduction, consistent));
}

struct Survey {
  std::vector<Tested> tested;  ///< one per cause, strongest evidence first
  std::vector<Candidate> untestable;
};

/// Searching over s starting points costs 2 ln s of a likelihood ratio.
double noise_reduction(const LawVariant& variant, Index freedoms, std::size_t recordings, double samples) {
  double searched = static_cast<double>(std::max<std::size_t>(variant.starts.size(), 1));
  if (variant.law.recording) searched *= static_cast<double>(recordings);
  if (variant.law.law->cause == "periodic_disturbance") searched = samples / static_cast<double>(recordings);
  return static_cast<double>(freedoms) + 2 * std::log(searched);
}

double mean_evidence(std::span<const CauseOnGoodValves> causes, const std::string& cause) {
  for (const CauseOnGoodValves& good : causes) {
    if (good.cause == cause) return good.evidence_mean;
  }
  return 0;
}

Survey survey_laws(const LinearisedValve& fit, const ValveFitOptions& options, const std::set<std::string>& without) {
  ValveCatalogue catalogue = valve_catalogue(fit, options);
  Survey survey;
  survey.untestable = std::move(catalogue.untestable);
  for (const LawVariant& variant : catalogue.variants) {
    const std::string cause(variant.law.law->cause);
    if (without.contains(cause)) continue;
    double best = 0;
    for (const Tested& tested : survey.tested) best = std::max(best, tested.fit.reduction);
    const double worthwhile = std::max(kLeastPromise, kLeastShare * best);
    auto found = search_law(fit, options, variant.law, variant.starts, kSearchSteps, worthwhile);
    if (!found) continue;
    Tested tested{.noise_reduction =
                      noise_reduction(variant, found->freedoms, fit.problem().recordings(), fit.samples())};
    tested.fit = std::move(*found);
    const auto known = std::find_if(survey.tested.begin(), survey.tested.end(),
                                    [&](const Tested& other) { return other.cause() == cause; });
    if (known == survey.tested.end()) {
      survey.tested.push_back(std::move(tested));
    } else if (tested.fit.reduction > known->fit.reduction) {
      *known = std::move(tested);
    }
  }
  std::stable_sort(survey.tested.begin(), survey.tested.end(),
                   [](const Tested& a, const Tested& b) { return a.fit.reduction > b.fit.reduction; });
  for (Tested& tested : survey.tested) {
    tested.evidence = evidence_of(tested.fit.verified, tested.fit.consistent_verified);
    tested.promise = evidence_of(tested.fit.reduction, tested.fit.consistent_reduction);
  }
  return survey;
}

const CauseOnGoodValves* on_good_valves(std::span<const CauseOnGoodValves> causes, std::string_view cause) {
  for (const CauseOnGoodValves& good : causes) {
    if (good.cause == cause) return &good;
  }
  return nullptr;
}

/// By the evidence or by the size, whichever tells more; two tests are paid for. What good valves show at this size as
/// well is no fault, however surely it is there.
double p_value_of(const Tested& tested, double evidence, double size, const ValveDiagnosisOptions& options) {
  const CauseOnGoodValves* good = on_good_valves(options.causes, tested.cause());
  const double by_evidence = good_valve_p_value(evidence, tested.fit.freedoms, tested.noise_reduction,
                                                good ? good->evidence_mean : 0, options.good_valves);
  const double neutral = tested.fit.law.law->neutral;
  if (!good || !std::isfinite(neutral)) return by_evidence;
  const double searched = std::max(0.0, tested.noise_reduction - static_cast<double>(tested.fit.freedoms));
  const double by_size =
      size_p_value(size - neutral, good->size_mean - neutral, good->size_sd, evidence - searched, options.good_valves);
  if (by_size > kLikeGoodValves) return 1;
  return std::min(1.0, 2 * std::min(by_evidence, by_size));
}

/// The population's mean beside the laws already found, with the recordings' own states.
VectorXd at_population_mean(const Explanation& explanation) {
  VectorXd v = explanation.v;
  if (explanation.options->prior) v.head(explanation.problem->baseline_size()) = explanation.options->prior->mean;
  return explanation.problem->clamped(v);
}

/// Takes over what a survey from another point found better. `offset` brings its verified reductions to this one's
/// baseline: cost here less cost there.
void keep_better(Survey other, double offset, Survey& survey) {
  for (Tested& there : other.tested) {
    there.fit.verified = std::max(0.0, there.fit.verified + offset);
    there.evidence = there.promise = evidence_of(there.fit.verified, there.fit.consistent_verified);
    const auto here = std::find_if(survey.tested.begin(), survey.tested.end(),
                                   [&](const Tested& t) { return t.cause() == there.cause(); });
    if (here == survey.tested.end()) {
      survey.tested.push_back(std::move(there));
    } else if (there.fit.verified > here->fit.verified) {
      *here = std::move(there);
    }
  }
}

/// Those still in the race after a survey: near the best in likelihood, and perhaps beyond what a good valve shows.
std::vector<const Tested*> in_the_race(const Survey& survey, const ValveDiagnosisOptions& options) {
  const double laws = static_cast<double>(survey.tested.size());
  std::vector<const Tested*> racing;
  for (const Tested& tested : survey.tested) {
    if (p_value_of(tested, std::max(tested.evidence, tested.promise), tested.size(), options) * laws <= kFalseAlarm) {
      racing.push_back(&tested);
    }
  }
  const auto forecast = [](const Tested* tested) { return std::max(tested->evidence, tested->promise); };
  std::stable_sort(racing.begin(), racing.end(),
                   [&](const Tested* a, const Tested* b) { return forecast(a) > forecast(b); });
  if (racing.size() > kMostJointFits) racing.resize(kMostJointFits);
  while (!racing.empty() && forecast(racing.back()) < forecast(racing.front()) - 2 * kInTheRace &&
         racing.back()->evidence < racing.front()->evidence - 2 * kInTheRace) {
    racing.pop_back();
  }
  return racing;
}

/// ln likelihood of an explanation, tempered; each parameter pays the half logarithm of the samples that count.
double log_likelihood(double cost, Index freedoms, double inflation, double samples) {
  return -0.5 * cost / inflation - 0.5 * static_cast<double>(freedoms) * std::log(std::max(samples / inflation, 2.0));
}

struct Ranked {
  std::string cause;
  double log_likelihood = 0;
  double reduction = 0;  ///< of the cost
  Stack residual;        ///< whitened, what is left beside it
  double penalty = 0;    ///< of the cost, what is not in the residual
  double probability = 0;
};

double squares_of(const Stack& residual) {
  double squares = 0;
  for (const VectorXd& r : residual) squares += r.squaredNorm();
  return squares;
}

/// Brings the likelihoods together where they differ by what one place in the recordings says and another denies: in
/// white noise 2 z² of a contrast is the likelihood ratio itself, anything else makes it less.
void keep_consistent(const Ranked& winner, double weight, std::vector<Ranked>& ranked) {
  for (Ranked& r : ranked) {
    if (r.cause == winner.cause) continue;
    const double z = contrast(winner.residual, r.residual).z;
    const double by_prior = 0.5 * (r.penalty - winner.penalty);
    const double allowed = std::max(0.0, std::copysign(2 * weight * z * z, z) + by_prior);
    r.log_likelihood = std::max(r.log_likelihood, winner.log_likelihood - allowed);
  }
}

void normalise(std::vector<Ranked>& ranked) {
  double best = -std::numeric_limits<double>::infinity();
  for (const Ranked& r : ranked) best = std::max(best, r.log_likelihood);
  double sum = 0;
  for (Ranked& r : ranked) sum += r.probability = std::exp(r.log_likelihood - best);
  for (Ranked& r : ranked) r.probability /= sum;
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Ranked& a, const Ranked& b) { return a.probability > b.probability; });
}

/// A fitted law is never the whole physics: where a rival removes nearly as much of the cost, or ranks above,
/// likelihood alone does not settle the name. Such rivals keep a share of the probability.
void keep_margins(const std::string& winner, std::vector<Ranked>& ranked) {
  const auto won = std::find_if(ranked.begin(), ranked.end(), [&](const Ranked& r) { return r.cause == winner; });
  const double enough = kMargin * won->reduction;
  double sum = 0;
  for (Ranked& r : ranked) {
    if (r.cause != winner && r.reduction >= enough) r.probability = std::max(r.probability, kRivalShare);
    sum += r.probability;
  }
  for (Ranked& r : ranked) r.probability /= sum;
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Ranked& a, const Ranked& b) { return a.probability > b.probability; });
}

/// A cause beside given others: the best of its rivals with their probabilities.
struct Contest {
  std::optional<Explanation> best;
  std::string cause;
  std::vector<Ranked> ranked;
  Survey survey;
  double p_value = 1;
};

class Diagnosis {
 public:
  Diagnosis(std::span<const Recording> recordings, const ValveFit& baseline, const ValveDiagnosisOptions& options)
      : recordings_(recordings), options_(options), baseline_(explain_nothing(recordings, options.fit, baseline)) {}

  ValveDiagnosis run() {
    Contest first = contest(baseline_);
    first_survey_ = std::move(first.survey);
    Explanation explanation = baseline_.copy();
    if (first.best) {
      explanation = std::move(*first.best);
      settle(first);
      while (explanation.laws.size() < kMostCauses && add_one(explanation)) {
      }
      if (explanation.laws.size() > 1) reconsider(explanation);
    }
    return conclude(explanation);
  }

 private:
  struct Entry {
    std::vector<Ranked> ranked;
    double p_value = 1;
  };

  /// Fits every law beside an explanation and lets the best of them compete in joint fits.
  Contest contest(const Explanation& beside) {
    Contest contest;
    // Two causes of one family explain each other's leftovers, not the valve.
    std::set<std::string> without;
    for (const LawFit& law : beside.laws) {
      for (const Mechanism* other : all_mechanisms()) {
        if (other->family == law.law.law->family) without.insert(std::string(other->cause));
      }
    }
    const LinearisedValve linear(*beside.problem, beside.v);
    contest.survey = survey_laws(linear, *beside.options, without);
    if (noise_inflation(linear.error()) > kBent) {
      // The baseline has bent towards the fault: look from where a good valve stands as well.
      const LinearisedValve mean(*beside.problem, at_population_mean(beside));
      keep_better(survey_laws(mean, *beside.options, without), beside.cost - mean.cost(), contest.survey);
    }
    for (Tested& tested : contest.survey.tested)
      tested.p_value = p_value_of(tested, tested.evidence, tested.size(), options_);
    const auto racing = in_the_race(contest.survey, options_);
    if (racing.empty()) return contest;
    const double laws = static_cast<double>(contest.survey.tested.size());

    std::vector<Explanation> fitted;
    double lowest = beside.cost;
    double inflation = 1;
    for (const Tested* tested : racing) {
      fitted.push_back(extend(recordings_, beside, tested->fit, kJointSteps, lowest - kInTheRace * inflation));
      if (fitted.back().cost >= lowest) continue;
      lowest = fitted.back().cost;
      inflation = noise_inflation(whitened_residual(fitted.back()));
    }
    // Evidence a good valve has as well is no evidence: its mean is taken off before laws are compared.
    const auto rank = [&](const Tested& tested, double evidence) {
      const double excess = evidence - mean_evidence(options_.causes, tested.cause());
      return log_likelihood(-excess * inflation, tested.fit.freedoms, inflation, linear.samples());
    };
    std::optional<std::size_t> best;
    double best_rank = 0;
    for (std::size_t i = 0; i < fitted.size(); ++i) {
      const double reduction = beside.cost - fitted[i].cost;
      Stack left = residual_at_rows(fitted[i]);
      const double evidence =
          evidence_of(reduction, consistent_evidence(linear.error(), left, reduction, linear.weight()));
      contest.ranked.push_back({racing[i]->cause(), rank(*racing[i], evidence), reduction, std::move(left)});
      contest.ranked.back().penalty = fitted[i].cost - linear.weight() * squares_of(contest.ranked.back().residual);
      const double p = std::min(1.0, laws * p_value_of(*racing[i], evidence, size_in(fitted[i]), options_));
      const double searched = racing[i]->noise_reduction - static_cast<double>(racing[i]->fit.freedoms);
      if (evidence - std::max(0.0, searched) < kLeastEvidence) continue;
      if (p > kFalseAlarm || (best && contest.ranked.back().log_likelihood <= best_rank)) continue;
      best = i;
      best_rank = contest.ranked.back().log_likelihood;
      contest.p_value = p;
    }
    if (!best) return contest;
    for (const Tested& tested : contest.survey.tested) {
      const bool refitted = std::any_of(contest.ranked.begin(), contest.ranked.end(),
                                        [&](const Ranked& r) { return r.cause == tested.cause(); });
      if (!refitted) {
        contest.ranked.push_back(
            {tested.cause(), rank(tested, tested.evidence), tested.fit.verified, tested.fit.residual});
        contest.ranked.back().penalty =
            linear.cost() - tested.fit.reduction - linear.weight() * squares_of(tested.fit.residual);
      }
    }
    keep_consistent(Ranked(contest.ranked[*best]), linear.weight(), contest.ranked);
    normalise(contest.ranked);
    // What good valves show as well explains more: the law that stands out from them is noise of a search.
    if (contest.ranked.front().cause != racing[*best]->cause()) return contest;
    keep_margins(racing[*best]->cause(), contest.ranked);
    contest.cause = racing[*best]->cause();
    contest.best = std::move(fitted[*best]);
    return contest;
  }

  void settle(const Contest& contest) { entries_.push_back({contest.ranked, contest.p_value}); }

  /// A further cause beside those found, where it explains enough of what is left.
  bool add_one(Explanation& explanation) {
    Contest next = contest(explanation);
    if (!next.best) return false;
    const double gained = explanation.cost - next.best->cost;
    const double above_floor = explanation.cost - noise_cost(explanation);
    if (gained < kShareOfASecond * above_floor) return false;
    explanation = std::move(*next.best);
    settle(next);
    return true;
  }

  /// Each cause of several must still be needed beside the others, and is compared with its rivals there.
  void reconsider(Explanation& explanation) {
    for (std::size_t i = 0; i < explanation.laws.size() && explanation.laws.size() > 1;) {
      Explanation others = without(recordings_, explanation, i, kJointSteps);
      Contest again = contest(others);
      const std::string_view cause = explanation.laws[i].law.law->cause;
      if (!again.best || again.best->cost > others.cost) {
        explanation = std::move(others);
        entries_.erase(entries_.begin() + static_cast<std::ptrdiff_t>(i));
        if (explanation.laws.size() == 1) entries_.front() = alone(explanation);
        i = 0;
        continue;
      }
      entries_[i] = {again.ranked, again.p_value};
      if (again.cause != cause && again.best->cost < explanation.cost) {
        // Another cause does better in its place: it comes last, and the ones before it are seen with it.
        explanation = std::move(*again.best);
        std::rotate(entries_.begin() + static_cast<std::ptrdiff_t>(i),
                    entries_.begin() + static_cast<std::ptrdiff_t>(i) + 1, entries_.end());
        if (++replaced_ > kMostCauses) return;
        continue;
      }
      ++i;
    }
  }

  /// The contest of a cause that is left alone.
  Entry alone(const Explanation& explanation) {
    const Contest again = contest(baseline_);
    Entry entry{again.ranked, again.p_value};
    const bool same = again.best && again.cause == explanation.laws.front().law.law->cause;
    if (!same) entry.p_value = 1;
    return entry;
  }

  /// What the noise alone costs in this session: its samples, and the penalty at the population's edge.
  double noise_cost(const Explanation& explanation) const {
    double samples = 0;
    for (std::size_t r = 0; r < recordings_.size(); ++r) samples += static_cast<double>(recordings_[r].samples());
    return std::min(samples, explanation.cost);
  }

  /// Probability of a leftover like this in a good valve, over all groups.
  double leftover_p_value(const Explanation& explanation, std::vector<Finding>& findings) const {
    const LinearisedValve linear(*explanation.problem, explanation.v);
    double smallest = 1;
    int groups = 0;
    for (const LeftoverGroup& group : leftover_groups(linear, 2 * options_.fit.reference_psi)) {
      const auto good = std::find_if(options_.leftovers.begin(), options_.leftovers.end(),
                                     [&](const LeftoverOnGoodValves& g) { return g.group == group.group; });
      if (!std::isfinite(group.log_ratio) || good == options_.leftovers.end() || options_.good_valves < 2) continue;
      ++groups;
      // ln of a mean of n squares scatters by √(2/n) in itself.
      const double own = std::sqrt(2.0 / group.blocks);
      const double sd = std::sqrt((good->sd * good->sd + own * own) * (1 + 1.0 / options_.good_valves));
      const double t = (group.log_ratio - good->mean) / sd;
      const boost::math::students_t student(options_.good_valves - 1 + 0.5 * group.blocks * 0.1);
      const double p = boost::math::cdf(boost::math::complement(student, t));
      if (p < 0.01) {
        findings.push_back({.what = "more slow residual than any good valve leaves",
                            .where = group.group,
                            .statistic = t,
                            .p_value = p,
                            .share_of_structured_residual = std::numeric_limits<double>::quiet_NaN()});
      }
      smallest = std::min(smallest, p);
    }
    return groups > 0 ? std::min(1.0, smallest * groups) : 1;
  }

  ValveDiagnosis conclude(const Explanation& explanation);

  std::span<const Recording> recordings_;
  const ValveDiagnosisOptions& options_;
  Explanation baseline_;
  Survey first_survey_;
  std::vector<Entry> entries_;  ///< one per law of the explanation
  std::size_t replaced_ = 0;
};

double family_probability(const std::vector<Ranked>& ranked, std::string_view family) {
  double sum = 0;
  for (const Ranked& r : ranked) {
    const Mechanism* mechanism = find_mechanism(r.cause);
    if (mechanism && mechanism->family == family) sum += r.probability;
  }
  return sum;
}

ValveDiagnosis Diagnosis::conclude(const Explanation& explanation) {
  ValveDiagnosis diagnosis;
  Discrepancy& discrepancy = diagnosis.discrepancy;
  diagnosis.extended_model = explanation.model();
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    diagnosis.extended.push_back(explanation.problem->simulate(explanation.v, r));
  }
  const double inflation = noise_inflation(whitened_residual(explanation));
  const double leftover_p = leftover_p_value(explanation, discrepancy.findings);
  const bool left = leftover_p < kFalseAlarm;
  // What is left of what was there: an extension that closes less than three quarters does not explain.
  const double there = baseline_.cost - noise_cost(baseline_);
  const double remains = std::max(0.0, explanation.cost - noise_cost(explanation));
  const bool explained = !explanation.laws.empty() && (!left || remains < 0.25 * there);

  if (explanation.laws.empty()) {
    discrepancy.conclusion = left ? Conclusion::kUnexplained : Conclusion::kNone;
  } else if (!explained) {
    discrepancy.conclusion = Conclusion::kUnexplained;
  } else {
    discrepancy.conclusion = Conclusion::kNamed;
  }

  std::vector<double> errors = explanation.standard_errors(inflation);
  std::size_t error_at = 0;
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
    const Mechanism& law = *explanation.laws[l].law.law;
    const std::vector<Ranked>& ranked = entries_[l].ranked;
    NamedCause named{
        .cause = std::string(law.cause), .family = std::string(law.family), .origin = std::string(law.origin)};
    for (const Ranked& r : ranked) {
      if (r.cause == named.cause)
        named.probability = r.probability;
      else if (r.probability >= kWorthNaming)
        named.alternatives.push_back(r.cause);
    }
    named.family_probability = family_probability(ranked, law.family);
    if (!explained) named.probability = std::min(named.probability, 0.5);
    if (named.probability < kSettled && named.alternatives.empty()) {
      for (const Ranked& r : ranked) {
        if (r.cause != named.cause) {
          named.alternatives.push_back(r.cause);
          break;
        }
      }
    }
    if (!named.alternatives.empty() && discrepancy.conclusion == Conclusion::kNamed) {
      discrepancy.conclusion = Conclusion::kAmbiguous;
    }
    const CauseOnGoodValves* good = on_good_valves(options_.causes, law.cause);
    const std::vector<double> values = explanation.problem->law_parameters(explanation.v, l, 0);
    for (std::size_t j = 0; j < law.parameters.size(); ++j) {
      ParameterEstimate estimate{.value = values[j], .unit = std::string(law.parameters[j].unit)};
      estimate.std_error = errors[error_at + j];
      estimate.ci95 = {estimate.value - 1.96 * estimate.std_error, estimate.value + 1.96 * estimate.std_error};
      const bool is_size = j == law.size_parameter;
      estimate.population_mean = is_size && good ? good->size_mean : std::numeric_limits<double>::quiet_NaN();
      estimate.population_sd = is_size && good ? good->size_sd : std::numeric_limits<double>::quiet_NaN();
      if (is_size && good) {
        const double spread = std::hypot(good->size_sd, estimate.std_error);
        named.severity_in_population_sd = spread > 0 ? std::abs(estimate.value - good->size_mean) / spread : 0;
      }
      named.parameters.emplace_back(std::string(law.parameters[j].name), estimate);
    }
    error_at += law.parameters.size();
    named.p_value = entries_[l].p_value;
    discrepancy.causes.push_back(std::move(named));
  }

  // Candidates: the first contest's ranking, none and unknown.
  const double none = discrepancy.conclusion == Conclusion::kNone ? 1.0 : 0.0;
  const double unknown = discrepancy.conclusion == Conclusion::kUnexplained ? 1.0 : 0.0;
  discrepancy.candidates.push_back({.cause = "none",
                                    .probability = none,
                                    .rmse_heldout = std::nan(""),
                                    .reason = "nothing beyond what good valves leave"});
  for (const Tested& tested : first_survey_.tested) {
    Candidate candidate{.cause = tested.cause(), .rmse_heldout = std::nan("")};
    if (none == 0 && unknown == 0 && entries_.size() == 1) {
      for (const Ranked& r : entries_.front().ranked) {
        if (r.cause == candidate.cause) candidate.probability = r.probability;
      }
    }
    candidate.reason = fmt::format("evidence {:.1f}, noise alone {:.1f}, p {:.2g}", tested.evidence,
                                   tested.noise_reduction, tested.p_value);
    discrepancy.candidates.push_back(std::move(candidate));
  }
  if (entries_.size() > 1 && unknown == 0) {
    std::string name;
    double probability = 1;
    for (std::size_t l = 0; l < entries_.size(); ++l) {
      name += (l ? "+" : "") + discrepancy.causes[l].cause;
      probability *= discrepancy.causes[l].probability;
    }
    discrepancy.candidates.push_back({.cause = name, .probability = 1, .rmse_heldout = std::nan("")});
  }
  discrepancy.candidates.push_back(
      {.cause = "unknown",
       .probability = unknown,
       .rmse_heldout = std::nan(""),
       .reason = fmt::format("leftover p {:.2g}, inflation {:.2f}", leftover_p, inflation)});
  for (Candidate& candidate : first_survey_.untestable) discrepancy.candidates.push_back(candidate);
  discrepancy.gain = measure_gain(baseline_, explanation);
  return diagnosis;
}

}  // namespace

ValveDiagnosis diagnose_valve(std::span<const Recording> recordings, const ValveFit& baseline,
                              const ValveDiagnosisOptions& options) {
  const Explanation nothing = explain_nothing(recordings, options.fit, baseline);
  const CleanInputs clean = without_aliased_lines({*nothing.problem, nothing.v}, options.fit);
  if (clean.recordings.empty()) return Diagnosis(recordings, baseline, options).run();
  ValveFit refitted = baseline;
  const ValveFitProblem problem(clean.recordings, options.fit);
  refitted.vector = descend(problem, baseline.vector, options.fit.most_iterations).v;
  ValveDiagnosis diagnosis = Diagnosis(clean.recordings, refitted, options).run();
  auto& findings = diagnosis.discrepancy.findings;
  findings.insert(findings.begin(), clean.findings.begin(), clean.findings.end());
  return diagnosis;
}

GoodValveSurvey survey_good_valve(std::span<const Recording> recordings, const ValveFit& fit,
                                  const ValveFitOptions& options) {
  const Explanation nothing = explain_nothing(recordings, options, fit);
  const LinearisedValve linear(*nothing.problem, nothing.v);
  Survey survey = survey_laws(linear, *nothing.options, {});
  // As a diagnosis does it: those that promise most are fitted together with the valve.
  const auto forecast = [](const Tested& tested) { return std::max(tested.evidence, tested.promise); };
  std::stable_sort(survey.tested.begin(), survey.tested.end(),
                   [&](const Tested& a, const Tested& b) { return forecast(a) > forecast(b); });
  GoodValveSurvey seen;
  for (std::size_t i = 0; i < survey.tested.size(); ++i) {
    const Tested& tested = survey.tested[i];
    double evidence = tested.evidence, size = tested.size();
    // A forecast that the simulation bears out needs no fit of everything together.
    if (i < kGoodValveJointFits && forecast(tested) > kLeastEvidence && tested.evidence < 0.5 * tested.promise) {
      const Explanation fitted = extend(recordings, nothing, tested.fit, kJointSteps, nothing.cost);
      const Stack left = residual_at_rows(fitted);
      const double reduction = std::max(0.0, nothing.cost - fitted.cost);
      const double found =
          evidence_of(reduction, consistent_evidence(linear.error(), left, reduction, linear.weight()));
      if (found > evidence) {
        evidence = found;
        size = size_in(fitted);
      }
    }
    seen.causes.push_back({tested.cause(), evidence, size});
  }
  for (const LeftoverGroup& group : leftover_groups(linear, 2 * options.reference_psi)) {
    if (std::isfinite(group.log_ratio)) seen.leftovers.emplace_back(group.group, group.log_ratio);
  }
  return seen;
}

}  // namespace valvetriage
