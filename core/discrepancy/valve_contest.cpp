#include "core/discrepancy/valve_contest.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <span>
#include <utility>

#include "core/discrepancy/evidence.h"
#include "core/discrepancy/heldout.h"
#include "core/discrepancy/joint_fits.h"
#include "core/discrepancy/leftover.h"
#include "core/discrepancy/own_parameters.h"
#include "core/discrepancy/slip_search.h"
#include "core/discrepancy/valve_catalogue.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr int kSearchSteps = 5;
// A law is refined where its best start promises this much of the cost, and this share of the best law so far.
constexpr double kLeastPromise = 8;
constexpr double kLeastShare = 0.02;
// A size that one good valve in a hundred has by the spread of the others says nothing against a valve.
constexpr double kLikeGoodValves = 0.01;
// Joint fits of those that the survey leaves in the race: this many at most, none that promises less than this share of
// the best.
constexpr std::size_t kMostJointFits = 4;
// A joint fit may bring this many times what its forecast and its simulation say.
constexpr double kMostOff = 2;
// And beside those that promise most this many of those whose simulations are known to bring most.
constexpr std::size_t kSurestJointFits = 2;
constexpr double kLeastForecast = 0.05;
// Of what the best simulation brings: half-way to its own fit a law is seldom off by more than twice.
constexpr double kNearTheMost = 0.5;
// A search that noise alone gives this much takes more than fifty instants or tones.
constexpr double kLongSearch = 8;
// A residual this many times slower than white noise has bent the baseline.
constexpr double kBent = 6;
// So has a fit this many standard deviations of χ² farther from the population than a good valve is.
constexpr double kFarFromGoodValves = 4;
// A rival that removes this share of what the winner removes is still one (a margin of 1.2, lesson of other machines).
constexpr double kMargin = 1 / 1.2;
constexpr double kFamilyMargin = kStillNear;
// The same margins, of the rms of what is left.
constexpr double kClearlyMore = 1.2 * 1.2;
constexpr double kClearlyMoreInFamily = 1.5 * 1.5;
// What one good valve in a hundred has tells nothing between two causes, and what it has not is worth a fit.
constexpr double kRareInGoodValves = 0.01;
// What is left, where the valve's own parameters lie, and the laws are three tests of the same valve.
constexpr double kTestsOfAValve = 3;
constexpr double kRivalShare = 0.25;
// Of a returned valve nothing is known before its tests: as likely a fault as none.
constexpr double kOddsOfAFault = 1;
// Tells of nothing.
constexpr double kNoSign = 0.5;
constexpr double kRivalInGoodValves = 0.05;

std::string cause_of(const Explanation& explanation) {
  return std::string(explanation.laws.back().law.law->cause);
}

/// The size of an explanation's last law.
double size_in(const Explanation& explanation) {
  const std::vector<double> parameters = explanation.parameters_of_last();
  const std::size_t at = explanation.laws.back().law.law->size_parameter;
  return at < parameters.size() ? parameters[at] : 1;
}

Index slowest_of(const Explanation& explanation) {
  return slowest_rows(*explanation.problem, explanation.laws.back().law, explanation.parameters_of_last());
}

bool is_cut_off(const LawInFit& law, const std::vector<double>& parameters) {
  return law.law->is_cut_off && law.law->is_cut_off(parameters, law.lower, law.upper);
}

/// One that acts where the recordings do not show the whole of it may be another law's rival, but wins nothing: any
/// other variant is better.
bool is_better_variant(const Tested& a, const Tested& b) {
  const bool a_cut_off = a.fit.reduction > 0 && is_cut_off(a.fit.law, a.fit.parameters);
  const bool b_cut_off = b.fit.reduction > 0 && is_cut_off(b.fit.law, b.fit.parameters);
  return a_cut_off != b_cut_off ? b_cut_off : a.fit.reduction > b.fit.reduction;
}

/// What compares with good valves: a law of memory may stand in the place of the valve's own loops. Its size is then
/// that of both beyond a good valve's.
double with_own(const Mechanism& law, double size, const VectorXd& v, const ValveFitOptions& options) {
  return size + own_excess(law, v, options);
}

double size_beyond_good(const Tested& tested, const ValveFitOptions& options) {
  return with_own(*tested.fit.law.law, tested.size(), tested.fit.baseline, options);
}

/// What a law takes from white noise: the largest of as many draws of χ² as there are starting points, in the mean of
/// its limiting (Gumbel) distribution.
double noise_reduction(const LawVariant& variant, Index freedoms, const ValveFitProblem& problem, double samples) {
  const std::size_t recordings = problem.recordings(), channels = problem.recording(0).side.size();
  double searched = static_cast<double>(std::max<std::size_t>(variant.starts.size(), 1));
  if (variant.law.recording) searched *= static_cast<double>(recordings);
  if (variant.law.channel) searched *= static_cast<double>(channels);
  const std::string_view cause = variant.law.law->cause;
  const bool at_any_frequency = cause == "periodic_disturbance" || cause == "self_oscillation";
  if (at_any_frequency) searched = samples / static_cast<double>(recordings);
  const double of_largest =
      chi_squared_upper_quantile(static_cast<double>(freedoms), std::exp(-std::numbers::egamma) / searched);
  return std::max(static_cast<double>(freedoms), of_largest);
}

/// What the search over a law's starts gives beside what its parameters give.
double searched_reduction(const Tested& tested) {
  return std::max(0.0, tested.noise_reduction - static_cast<double>(tested.fit.freedoms));
}

/// Five standard errors, the search paid for.
bool is_beyond_noise(const Tested& tested, const Evidence& evidence) {
  return evidence.value - searched_reduction(tested) >= kLeastEvidence;
}

/// How far from no effect a size is. A limit, a level or a frequency has none at infinity: its inverse counts.
struct Size {
  double from_none = 0, sd = 0;
};

Size size_of(const Mechanism& law, double size, double sd) {
  if (std::isfinite(law.neutral)) return {size - law.neutral, sd};
  return {1 / size, sd / (size * size)};
}

/// The size of a law in a good valve where the recordings tell of it: none where its evidence is what noise gives, by
/// five standard errors where it could stand at any instant, tone or level.
double size_told(const Tested& tested, const Evidence& evidence, double size) {
  const double neutral = tested.fit.law.law->neutral;
  const bool is_short = std::isfinite(neutral) && searched_reduction(tested) < kLongSearch;
  const bool is_told = is_beyond_noise(tested, evidence) || (is_short && evidence.as_normal() > tested.noise_reduction);
  return is_told ? size : neutral;
}

/// How far good valves' sizes lie from none together, in their own scatter. What was searched for at many instants,
/// tones or levels shows the largest of many chances: its square is no normal deviate's.
double common_size(const Tested& tested, const CauseOnGoodValves* good) {
  const Mechanism& law = *tested.fit.law.law;
  const bool is_known = good && good->size_sd > 0 && std::isfinite(law.neutral);
  if (!is_known || searched_reduction(tested) >= kLongSearch) return std::numeric_limits<double>::infinity();
  return std::abs(good->size_mean - law.neutral) / good->size_sd;
}

/// Whether good valves' sizes say how rare a size is. Where good valves show none, their spread is not known: the
/// evidence alone tells. So it does for a change in one recording, whose size weighs by how long it lasts.
bool has_size_in_good_valves(const LawInFit& law, const CauseOnGoodValves* good) {
  return good && good->size_sd > 0 && (std::isfinite(law.law->neutral) || good->size_mean > 0) && !law.recording;
}

/// Probability that a good valve has as much of a law by its size, whose standard error is given, and how much of it
/// the prior tells.
double p_value_of_size(const Mechanism& law, double size, double error, double prior_share,
                       const CauseOnGoodValves& good, const ValveDiagnosisOptions& options) {
  const Size own = size_of(law, size, error);
  const Size usual = size_of(law, good.size_mean, good.size_sd);
  return size_p_value(own.from_none, usual.from_none, usual.sd, own.sd, prior_share,
                      good.size_valves.value_or(options.good_valves));
}

/// By the evidence or by the size, whichever tells more; two tests are paid for. What good valves show at this size as
/// well is no fault, however surely it is there.
double p_value_of(const Tested& tested, const Evidence& evidence, double size, const ValveDiagnosisOptions& options) {
  const CauseOnGoodValves* good = on_good_valves(options.causes, tested.cause());
  const GoodValveEvidence on_good{.mean = good ? good->evidence_mean : 0,
                                  .sd = good ? good->evidence_sd : 0,
                                  .valves = options.good_valves,
                                  .common_size = common_size(tested, good)};
  const double by_evidence = good_valve_p_value(evidence, tested.fit.freedoms, tested.noise_reduction, on_good);
  if (!has_size_in_good_valves(tested.fit.law, good)) return by_evidence;
  // Evidence is the square of size over error.
  const double beyond_search = evidence.value - searched_reduction(tested);
  if (!(beyond_search > 0)) return 1;
  const Mechanism& law = *tested.fit.law.law;
  const double from_none = std::isfinite(law.neutral) ? std::abs(size - law.neutral) : std::abs(size);
  const double by_size =
      p_value_of_size(law, size, from_none / std::sqrt(beyond_search), evidence.prior_share, *good, options);
  if (by_size > kLikeGoodValves) return 1;
  return std::min(1.0, 2 * std::min(by_evidence, by_size));
}

/// Takes over what a survey from another point found better: what it simulates, or where no simulation bears out either
/// forecast, what it forecasts. `offset` brings the other's verified reductions to this one's baseline: cost here less
/// there. What moves the valve from there to here is no evidence for a law.
void keep_better(Survey other, const LinearisedValve& here_fitted, double offset, Survey& survey) {
  for (Tested& there : other.tested) {
    LawFit& fit = there.fit;
    fit.verified = std::max(0.0, fit.verified + offset);
    if (!(fit.verified > 0)) fit.simulated.clear();
    if (!fit.simulated.empty()) {
      fit.consistent_verified = consistent_evidence(here_fitted.error(), fit.simulated, fit.verified,
                                                    slowest_rows(here_fitted.problem(), fit.law, fit.parameters));
    }
    there.evidence = there.fit.consistent_verified.at_most(there.fit.verified);
    const auto here = std::find_if(survey.tested.begin(), survey.tested.end(),
                                   [&](const Tested& t) { return t.cause() == there.cause(); });
    if (here == survey.tested.end()) {
      survey.tested.push_back(std::move(there));
    } else if (there.fit.verified > here->fit.verified ||
               (there.fit.verified == here->fit.verified && there.promise.value > here->promise.value)) {
      *here = std::move(there);
    }
  }
  // What one of the two points does not excite the other may.
  std::erase_if(survey.untestable, [&](const Candidate& untestable) {
    return std::any_of(survey.tested.begin(), survey.tested.end(),
                       [&](const Tested& t) { return t.cause() == untestable.cause; });
  });
}

/// Probability that a good valve leaves as much, or, where nothing is found yet and a fit may have taken a fault up in
/// them, has as unusual parameters of its own: the rarer of both.
double p_value_of_valve(const LinearisedValve& linear, bool may_be_taken_up, double inflation,
                        const ValveDiagnosisOptions& options) {
  const double of_leftover = leftover_of(linear, options).p_value;
  if (!may_be_taken_up) return of_leftover;
  return std::min(of_leftover, own_parameters_of(linear.at(), linear.errors(inflation), options).p_value);
}

/// Whether the valve without any law is no good valve, as surely as a name asks for.
bool is_unlike_good_valves(const Contest& contest) {
  return kTestsOfAValve * contest.p_value_beside <= kNamedFalseAlarm;
}

/// Whether a law may lower the cost by as much, by what is forecast or simulated, which are seldom off by more.
bool may_gain(const Tested& tested, double least_gain) {
  return kMostOff * std::max(tested.fit.reduction, tested.fit.verified) >= least_gain;
}

/// Those still in the race after a survey: rare in good valves by what is forecast, those that promise most, none that
/// promises far less than the best, and those that bring most in simulations, by what of it is the same everywhere and
/// by all of it: half-way to a fit nothing is the same everywhere. A forecast is linear: where the fit has bent towards
/// a fault, laws that promise ten times as much keep nothing of it.
std::vector<const Tested*> in_the_race(const Survey& survey, double least_gain, const ValveDiagnosisOptions& options) {
  const auto forecast = [](const Tested* tested) { return std::max(tested->evidence.value, tested->promise.value); };
  std::vector<const Tested*> possible;
  for (const Tested& tested : survey.tested) {
    if (!may_gain(tested, least_gain)) continue;
    if (p_value_of(tested, {forecast(&tested)}, size_beyond_good(tested, options.fit), options) <= kRareInGoodValves)
      possible.push_back(&tested);
  }
  std::stable_sort(possible.begin(), possible.end(),
                   [&](const Tested* a, const Tested* b) { return forecast(a) > forecast(b); });
  std::vector<const Tested*> racing = possible;
  if (racing.size() > kMostJointFits) racing.resize(kMostJointFits);
  while (!racing.empty() && forecast(racing.back()) < kLeastForecast * forecast(racing.front()) &&
         racing.back()->evidence.value < racing.front()->evidence.value - 2 * kInTheRace) {
    racing.pop_back();
  }
  const auto add_surest = [&](auto size, double least) {
    std::stable_sort(possible.begin(), possible.end(),
                     [&](const Tested* a, const Tested* b) { return size(*a) > size(*b); });
    for (const Tested* sure : std::span(possible).first(std::min(possible.size(), kSurestJointFits))) {
      const bool is_known = std::find(racing.begin(), racing.end(), sure) != racing.end();
      if (!is_known && size(*sure) >= least) racing.push_back(sure);
    }
  };
  const auto simulated = [](const Tested& tested) { return tested.fit.verified; };
  add_surest([](const Tested& tested) { return tested.evidence.value; }, kLeastEvidence);
  double most = kLeastEvidence;
  for (const Tested* tested : possible) most = std::max(most, simulated(*tested));
  add_surest(simulated, kNearTheMost * most);
  return racing;
}

/// What a cause is known to be confused with and what has not been in the race. A forecast is linear: where the fit has
/// bent towards a fault it may be a hundred times off, and a law that seemed to do nothing does most.
std::vector<const Tested*> late_entries(const std::string& cause, const Survey& survey, const JointFits& joint) {
  const auto confused_with = find_mechanism(cause)->confused_with;
  std::vector<const Tested*> late;
  for (const Tested& tested : survey.tested) {
    const bool is_rival =
        std::find(confused_with.begin(), confused_with.end(), tested.fit.law.law->cause) != confused_with.end();
    if (is_rival && !joint.has(tested.cause())) late.push_back(&tested);
  }
  return late;
}

/// ln likelihood of an explanation by a law, tempered. Each parameter pays the half logarithm of the samples that tell
/// of it (Schwarz, Ann. Stat. 6 (1978) 461): a recording's own those of that recording. Where a memory stood when a
/// recording began its first reversals wipe out, and no sample after them tells of it: it pays what noise gives a
/// parameter.
double log_likelihood(double cost, const LawFit& law, double inflation, double samples) {
  const auto half_log = [&](double count) { return 0.5 * std::log(std::max(count / inflation, 2.0)); };
  const auto shared = std::min(law.freedoms, static_cast<Index>(law.law.shared()));
  const auto own = static_cast<double>(law.freedoms - shared);
  const double recordings = own > 0 ? own / static_cast<double>(law.law.own()) : 1;
  const double paid_by_own = law.law.law->memory ? 0.5 : half_log(samples / recordings);
  return -0.5 * cost / inflation - static_cast<double>(shared) * half_log(samples) - own * paid_by_own;
}

double squares_of(const Stack& residual) {
  double squares = 0;
  for (const VectorXd& r : residual) squares += r.squaredNorm();
  return squares;
}

/// What more than one good valve in twenty shows as well does not tell this valve from them: it is nobody's rival. But
/// of one family laws are accounts of the same thing: where good valves show one of them, it may be that one still.
bool competes_with(const std::string& winner, const Ranked& r) {
  return r.cause == winner || r.p_value <= kRivalInGoodValves ||
         find_mechanism(r.cause)->family == find_mechanism(winner)->family;
}

/// Makes weights probabilities, the greatest first.
void share_out(std::vector<Ranked>& ranked) {
  double sum = 0;
  for (const Ranked& r : ranked) sum += r.probability;
  for (Ranked& r : ranked) r.probability /= sum;
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Ranked& a, const Ranked& b) { return a.probability > b.probability; });
}

/// Probabilities of the winner and its rivals. No rival leads: the winner is the best of those that stand out.
void normalise(const std::string& winner, std::vector<Ranked>& ranked) {
  const auto won = std::find_if(ranked.begin(), ranked.end(), [&](const Ranked& r) { return r.cause == winner; });
  const double best = won->borne_out;
  for (Ranked& r : ranked) {
    r.probability = competes_with(winner, r) ? std::exp(std::min(r.borne_out - best, 0.0)) : 0;
  }
  share_out(ranked);
}

/// The joint fit of a cause; null where there is none.
const Explanation* fit_of(std::string_view cause, std::span<const Explanation> fitted) {
  const auto found =
      std::find_if(fitted.begin(), fitted.end(), [&](const Explanation& fit) { return cause_of(fit) == cause; });
  return found == fitted.end() ? nullptr : &*found;
}

/// How much of the evidence between two causes good valves differ by, in noise variances: Student's t of their scatter.
double scatter_between(const Ranked& a, const Ranked& b, const ValveDiagnosisOptions& options) {
  double variance = 0;
  for (const Ranked* r : {&a, &b}) {
    if (const CauseOnGoodValves* good = on_good_valves(options.causes, r->cause))
      variance += std::pow(good->evidence_sd, 2);
  }
  if (!(variance > 0) || options.good_valves < 2) return 0;
  const double n = options.good_valves;
  return student_t_upper_quantile(n - 1, kRareInGoodValves) * std::sqrt(variance * (1 + 1 / n));
}

/// The share of what a winner removes that a rival removes which is near.
double margin(const Ranked& winner, const Ranked& rival) {
  return are_kin(winner, rival) ? kFamilyMargin : kMargin;
}

/// How many times the mean square that its winner leaves a rival must leave.
double clearly_more(const Ranked& winner, const Ranked& rival) {
  return are_kin(winner, rival) ? kClearlyMoreInFamily : kClearlyMore;
}

/// Free runs that stick are rough, and a fit of them that is worse may not have found its best. Only beside play that
/// is known: friction's search has begun where it is as smooth as play, from the valve that play has found.
bool is_never_out(const Ranked& rival, const Ranked& winner) {
  return rival.sticks && !winner.sticks && winner.cause != "backlash";
}

/// No friction at all is what a fit of friction can always reach: what fits worse has not found its best, and is no
/// reason to leave it out.
bool has_lost_its_way(const Ranked& rival, const Ranked& winner) {
  return rival.sticks && rival.fitted_jointly && !winner.sticks && rival.reduction < 0;
}

/// Whether an explanation leaves nothing that good valves do not leave.
bool leaves_the_usual(const LinearisedValve& linear, const ValveDiagnosisOptions& options) {
  return leftover_of(linear, options).p_value > kUsualLeftover;
}
bool leaves_the_usual(const Explanation& explanation, const ValveDiagnosisOptions& options) {
  return leaves_the_usual(LinearisedValve(*explanation.problem, explanation.v), options);
}

/// The fit of a contest's winner, looked at once and only where something turns on it.
class WinnersFit {
 public:
  WinnersFit(const Explanation* fit, const ValveDiagnosisOptions& options) : fit_(fit), options_(options) {}

  bool leaves_the_usual() {
    if (!is_looked_at_) usual_ = fit_ && valvetriage::leaves_the_usual(*fit_, options_);
    is_looked_at_ = true;
    return usual_;
  }
  bool leaves_memory() const {
    return fit_ && valvetriage::leaves_memory(*fit_->laws.back().law.law, fit_->v, options_);
  }

 private:
  const Explanation* fit_;
  const ValveDiagnosisOptions& options_;
  bool is_looked_at_ = false, usual_ = false;
};

/// By how much of 2 ln likelihood two causes must differ to be told apart: more than good valves differ by, and than a
/// rival may miss as the idealisation of what is there, where the winner removes `removed` of the cost. Beside one of
/// its family it may miss what one law in a hundred does: they differ in what is idealised first.
double least_lead(const Ranked& winner, const Ranked& rival, double removed, double inflation,
                  const ValveDiagnosisOptions& options) {
  const double missed = kIdealisation * (are_kin(winner, rival) ? normal_upper_quantile(kRareInGoodValves) : 1);
  const double idealised = missed * missed * std::max(0.0, removed) / inflation;
  return kLeastEvidence + scatter_between(winner, rival, options) + idealised;
}

/// Whether likelihood alone tells two causes apart.
bool is_told_apart(const Ranked& winner, const Ranked& rival, double inflation, const ValveDiagnosisOptions& options) {
  const double against = 2 * (winner.log_likelihood - rival.log_likelihood);
  return against >= least_lead(winner, rival, winner.reduction, inflation, options);
}

/// Brings the likelihoods together where they differ by what one place in the recordings says and another denies: in
/// white noise 2 z² of a contrast is the likelihood ratio itself, what a law gets wrong makes it less. Where the winner
/// gets nothing wrong and the other does, one place is enough.
void keep_consistent(const Ranked& winner, WinnersFit& fit, double inflation, std::vector<Ranked>& ranked,
                     const ValveDiagnosisOptions& options) {
  for (Ranked& r : ranked) {
    r.borne_out = r.log_likelihood;
    if (r.cause == winner.cause || r.p_value > kRivalInGoodValves) continue;
    const double z = contrast(winner.residual, r.residual).z;
    const double by_prior = 0.5 * (r.penalty - winner.penalty);
    const double allowed = std::max(0.0, std::copysign(2 * z * z, z) + by_prior);
    if (winner.log_likelihood - allowed <= r.log_likelihood) continue;
    if (is_told_apart(winner, r, inflation, options) && fit.leaves_the_usual()) continue;
    r.borne_out = winner.log_likelihood - allowed;
  }
}

/// What good valves show as well tells no valve from them; but where it does as much as the winner, the winner is not
/// told from what a good valve may have.
bool does_as_much(const Ranked& winner, const Ranked& rival) {
  return rival.fitted_jointly && rival.reduction >= winner.reduction;
}

/// Whether the winner makes the spool stick and a rival is as good by where it is better: free runs that stick can be
/// laid through much, and a slip that happens to fit tells nothing of the next (Vuong's test).
bool is_matched_by(const Ranked& winner, const Ranked& rival) {
  if (!winner.sticks || !rival.fitted_jointly) return false;
  const double z = contrast(winner.residual, rival.residual).z;
  return normal_upper_tail(z) > kFalseAlarm;
}

/// A fitted law is never the whole physics: where a rival removes nearly as much of the cost, or ranks above,
/// likelihood alone does not settle the name, and such rivals keep a share of the probability. What the law gets wrong
/// shows in what it leaves: a rival is out where the evidence against it is beyond what good valves differ by and borne
/// out, and it leaves clearly more than the winner or the winner leaves nothing unusual. Laws of one family look alike
/// and differ in what a baseline without a good valve's own friction gets wrong first: between them it takes more, and
/// nothing is settled while a part of what they are about is left in the valve.
void keep_margins(Contest& contest, WinnersFit& fit, const ValveDiagnosisOptions& options) {
  std::vector<Ranked>& ranked = contest.ranked;
  const Ranked won =
      *std::find_if(ranked.begin(), ranked.end(), [&](const Ranked& r) { return r.cause == contest.cause; });
  const bool is_family_open = fit.leaves_memory();
  const auto is_out = [&](const Ranked& r) {
    if (is_never_out(r, won) || !is_told_apart(won, r, contest.inflation, options)) return false;
    if (2 * (won.borne_out - r.borne_out) < kLeastEvidence) return false;
    const bool leaves_more = won.left + won.reduction - r.reduction > clearly_more(won, r) * won.left;
    return leaves_more || fit.leaves_the_usual();
  };
  for (Ranked& r : ranked) {
    const bool is_kin = are_kin(won, r);
    const bool is_near = r.reduction >= margin(won, r) * won.reduction;
    const bool is_open =
        is_kin && ((is_family_open && r.fitted_jointly) || has_lost_its_way(r, won) || is_matched_by(won, r));
    const bool competes = competes_with(won.cause, r) || does_as_much(won, r);
    if (r.cause != won.cause && competes && (is_open || (is_near && !is_out(r)))) {
      r.probability = std::max(r.probability, kRivalShare);
    }
  }
  share_out(ranked);
}

/// ln likelihood of a law that lowers the cost by `reduction`. What a good valve's cost falls by as well says nothing
/// for it: its mean is taken off before laws are compared.
double rank_of(const Tested& tested, double reduction, std::span<const CauseOnGoodValves> causes, double inflation,
               double samples) {
  const CauseOnGoodValves* good = on_good_valves(causes, tested.cause());
  const double excess = reduction / inflation - (good ? good->evidence_mean : 0);
  return log_likelihood(-excess * inflation, tested.fit, inflation, samples);
}

/// Probability that a good valve has as much of the law that came last, by its size and the error of the whole fit. 0
/// where good valves' sizes do not tell, and where free runs stick: their slopes say nothing of an error, and
/// recordings left out of the fit must bear the law out.
double p_value_of_fitted_size(const Explanation& fitted, double size, double prior_share, const Explanation& beside,
                              double inflation, const ValveDiagnosisOptions& options) {
  const LawInFit& law = fitted.laws.back().law;
  const CauseOnGoodValves* good = on_good_valves(options.causes, law.law->cause);
  if (!has_size_in_good_valves(law, good) || makes_stick(law, beside)) return 0;
  const std::vector<double> errors = fitted.standard_errors(inflation);
  const double error = errors[errors.size() - law.law->parameters.size() + law.law->size_parameter];
  return p_value_of_size(*law.law, size, error, prior_share, *good, options);
}

/// A law fitted together with the valve, before it is compared. `error` is what the valve alone leaves at the rows.
Ranked ranked_fit(const Tested& tested, const Explanation& beside, const Stack& error, const Explanation& fitted,
                  const Contest& contest, double laws, const ValveDiagnosisOptions& options) {
  Ranked r{.cause = tested.cause(), .fitted_jointly = true, .sticks = makes_stick(tested.fit.law, beside)};
  r.reduction = beside.cost - fitted.cost;
  r.left = fitted.cost - noise_cost(fitted);
  r.residual = whitened_residual(fitted);
  r.evidence = consistent_evidence(error, r.residual, r.reduction, slowest_of(fitted)).at_most(r.reduction);
  r.log_likelihood = rank_of(tested, r.reduction, options.causes, contest.inflation, contest.samples);
  r.penalty = fitted.cost - squares_of(r.residual);
  const double size = with_own(*tested.fit.law.law, size_in(fitted), fitted.v, options.fit);
  r.p_value = p_value_of(tested, r.evidence, size, options);
  const bool is_there = !is_cut_off(fitted.laws.back().law, fitted.parameters_of_last());
  if (!is_there || !is_beyond_noise(tested, r.evidence)) return r;
  // The evidence takes what the law gets wrong for noise that averages out; the error that goes with the size does not.
  // Both must tell the valve from good ones.
  if (r.p_value <= kRareInGoodValves) {
    r.p_value = std::max(
        r.p_value, p_value_of_fitted_size(fitted, size, r.evidence.prior_share, beside, contest.inflation, options));
  }
  r.stands_out = laws * r.p_value <= kNamedFalseAlarm;
  if (!r.stands_out && is_unlike_good_valves(contest) && r.p_value <= kRareInGoodValves &&
      p_value_of_valve(LinearisedValve(*fitted.problem, fitted.v), beside.laws.empty(), contest.inflation, options) >
          kRareInGoodValves) {
    // No good valve is like this one, and with the law it is like them: that something is wrong need not be shown once
    // more by the law alone, only that good valves do not show as much of it.
    r.stands_out = true;
    r.p_value = std::min(r.p_value, kTestsOfAValve * contest.p_value_beside / laws);
  }
  return r;
}

/// Who wins among the entries, and with which probabilities; nobody where none stands out.
void settle(Contest& contest, std::span<const Explanation> fitted, double laws, const ValveDiagnosisOptions& options) {
  contest.cause.clear();
  const Ranked* best = nullptr;
  for (const Ranked& r : contest.entries) {
    if (r.stands_out && (!best || r.log_likelihood > best->log_likelihood)) best = &r;
  }
  contest.ranked = contest.entries;
  if (!best) return;
  contest.cause = best->cause;
  contest.p_value = std::min(1.0, laws * best->p_value);
  WinnersFit fit(fit_of(contest.cause, fitted), options);
  keep_consistent(*best, fit, contest.inflation, contest.ranked, options);
  normalise(contest.cause, contest.ranked);
  keep_margins(contest, fit, options);
}

/// The laws of a survey as entries of the contest: with their joint fits, or with what the survey says of them.
void enter(Contest& contest, const JointFits& joint, const LinearisedValve& linear, const Explanation& beside,
           const ValveDiagnosisOptions& options) {
  const double laws = static_cast<double>(contest.survey.tested.size());
  contest.inflation = joint.inflation;
  contest.entries.clear();
  for (std::size_t i = 0; i < joint.racing.size(); ++i) {
    contest.entries.push_back(
        ranked_fit(*joint.racing[i], beside, linear.error(), joint.fitted[i], contest, laws, options));
  }
  for (const Tested& tested : contest.survey.tested) {
    if (joint.has(tested.cause())) continue;
    Ranked r{.cause = tested.cause(), .reduction = tested.fit.verified, .evidence = tested.evidence};
    r.sticks = makes_stick(tested.fit.law, beside);
    r.log_likelihood = rank_of(tested, tested.fit.verified, options.causes, contest.inflation, contest.samples);
    r.p_value = tested.p_value;
    const bool is_simulated = !tested.fit.simulated.empty();
    r.residual = is_simulated ? tested.fit.simulated : tested.fit.residual;
    r.penalty = beside.problem->penalty(is_simulated ? tested.fit.simulated_at : tested.fit.baseline);
    contest.entries.push_back(std::move(r));
  }
}

/// Enters the joint fits and settles, those that matter beside the winner led to their ends. Free runs that stick can
/// be laid through any noise, a slip sooner or later: what makes the spool stick wins only if recordings that were left
/// out of its fit bear it out.
void settle_borne_out(Contest& contest, JointFits& joint, const LinearisedValve& linear, const Explanation& beside,
                      const ValveDiagnosisOptions& options) {
  const auto laws = static_cast<double>(contest.survey.tested.size());
  std::vector<std::string> denied;
  const auto settle_again = [&] {
    for (Ranked& entry : contest.entries) {
      entry.stands_out &= std::find(denied.begin(), denied.end(), entry.cause) == denied.end();
    }
    settle(contest, joint.fitted, laws, options);
  };
  enter(contest, joint, linear, beside, options);
  for (settle_again();; settle_again()) {
    const Explanation* winner = fit_of(contest.cause, joint.fitted);
    if (lead_on(beside, winner ? beside.cost - winner->cost : 0, joint)) {
      enter(contest, joint, linear, beside, options);
      continue;
    }
    if (contest.cause.empty()) return;
    const auto won = std::find_if(joint.racing.begin(), joint.racing.end(),
                                  [&](const Tested* tested) { return tested->cause() == contest.cause; });
    if (won == joint.racing.end() || !makes_stick((*won)->fit.law, beside)) return;
    if (std::find(joint.borne_out.begin(), joint.borne_out.end(), contest.cause) != joint.borne_out.end()) return;
    if (is_borne_out(beside, joint.fitted[static_cast<std::size_t>(won - joint.racing.begin())])) {
      joint.borne_out.push_back(contest.cause);
      return;
    }
    denied.push_back(contest.cause);
  }
}

/// Hands the joint fits over to the winner and its rivals.
void award(Contest& contest, std::vector<Explanation> fitted) {
  for (Explanation& fit : fitted) {
    if (cause_of(fit) == contest.cause) {
      contest.best = std::move(fit);
    } else {
      contest.rivals.push_back(std::move(fit));
    }
  }
}

/// Whether what is left is far slower than noise, by its inflation, and than what good valves leave: some fault is
/// still in it. `left` is an explanation or its linearisation.
template <typename Left>
bool hides_a_fault(double inflation, const Left& left, const ValveDiagnosisOptions& options) {
  return inflation > kBent && (options.leftovers.empty() || !leaves_the_usual(left, options));
}

/// Whether the fit has bent towards a fault: what it leaves shows one, or it had to go where good valves are not.
bool is_bent(double inflation, const LinearisedValve& linear, const Explanation& beside,
             const ValveDiagnosisOptions& options) {
  const double freedoms = static_cast<double>(beside.problem->baseline_size());
  return beside.problem->penalty(beside.v) > freedoms + kFarFromGoodValves * std::sqrt(2 * freedoms) ||
         hides_a_fault(inflation, linear, options);
}

/// Whether the best joint fit is of a law of memory, or of one that is confused with such: a long lag ahead of the map
/// stands in for what holds the spool back. What is left by one says nothing of another: the valley of friction is
/// narrow, and what stands in for it leaves little.
bool may_be_memory(const Explanation& closest, const Explanation& beside) {
  if (&closest == &beside) return false;
  const Mechanism& law = *closest.laws.back().law.law;
  return law.family == "memory" ||
         std::any_of(law.confused_with.begin(), law.confused_with.end(),
                     [](std::string_view cause) { return find_mechanism(cause)->family == "memory"; });
}

/// The survey from where the fit stands and, where that has bent, from where a good valve stands as well.
Survey survey_all(const LinearisedValve& linear, const Explanation& beside, bool bent,
                  const ValveDiagnosisOptions& options) {
  Survey survey = survey_laws(linear, *beside.options);
  if (bent) {
    const LinearisedValve mean(*beside.problem, at_population_mean(beside));
    keep_better(survey_laws(mean, *beside.options), linear, beside.cost - mean.cost(), survey);
  }
  for (Tested& tested : survey.tested) {
    tested.p_value = p_value_of(tested, tested.evidence, size_beyond_good(tested, options.fit), options);
  }
  return survey;
}

}  // namespace

bool are_kin(const Ranked& a, const Ranked& b) {
  return find_mechanism(a.cause)->family == find_mechanism(b.cause)->family;
}

double Tested::size() const {
  const std::size_t at = fit.law.law->size_parameter;
  return at < fit.parameters.size() ? fit.parameters[at] : 1;
}

double own_excess(const Mechanism& law, const VectorXd& v, const ValveFitOptions& options) {
  if (!options.prior || !law.memory) return 0;
  const double wide = v(ValveFitProblem::kLoop) - options.prior->mean(ValveFitProblem::kLoop);
  const double narrow = v(ValveFitProblem::kNarrowLoop) - options.prior->mean(ValveFitProblem::kNarrowLoop);
  std::vector<double> parameters(law.parameters.size(), 1.0);
  law.memory->take_over(law.memory->has_corners ? narrow : wide + narrow, parameters);
  return parameters[law.size_parameter];
}

double lead_still_asked_for(const Ranked& winner, const Ranked& rival, bool leaves_usual,
                            const FurtherRecordings& further, double inflation, const ValveDiagnosisOptions& options) {
  const double removed = winner.reduction + further.removed;
  const double near = (1 - margin(winner, rival)) * removed;
  const double until_far = (near - (winner.reduction - rival.reduction)) / inflation;
  if (is_never_out(rival, winner)) return until_far;
  double told_apart = least_lead(winner, rival, removed, inflation, options);
  if (!leaves_usual) {
    const double left = (winner.left + further.left) / inflation;
    told_apart = std::max(told_apart, (clearly_more(winner, rival) - 1) * left);
  }
  return std::min(told_apart - (winner.reduction - rival.reduction) / inflation, until_far);
}

std::optional<double> least_contrast(const Ranked& winner, bool leaves_usual) {
  if (winner.sticks) return normal_upper_quantile(kFalseAlarm);
  if (leaves_usual) return std::nullopt;
  return 0.5 * std::sqrt(kLeastEvidence);
}

bool leaves_memory(const Mechanism& law, const VectorXd& v, const ValveDiagnosisOptions& options) {
  if (!law.memory || !options.fit.prior || options.good_valves < 2) return false;
  const Index other = law.memory->has_corners ? ValveFitProblem::kLoop : ValveFitProblem::kNarrowLoop;
  const ValvePrior& good = *options.fit.prior;
  const double excess = (v(other) - good.mean(other)) / std::sqrt(good.covariance(other, other));
  return student_t_upper_tail(options.good_valves - 1, excess) < kNamedFalseAlarm;
}

const CauseOnGoodValves* on_good_valves(std::span<const CauseOnGoodValves> causes, std::string_view cause) {
  const auto known = std::find_if(causes.begin(), causes.end(), [&](const auto& good) { return good.cause == cause; });
  return known == causes.end() ? nullptr : &*known;
}

void keep_as_rival(const std::string& cause, std::vector<Ranked>& ranked) {
  auto rival = std::find_if(ranked.begin(), ranked.end(), [&](const Ranked& r) { return r.cause == cause; });
  if (rival == ranked.end()) rival = ranked.insert(ranked.end(), Ranked{.cause = cause});
  rival->probability = std::max(rival->probability, kRivalShare);
  share_out(ranked);
}

std::vector<UnseenCause> odds_of_being_too_small(const Contest& contest, double least_gain) {
  const std::vector<Tested>& tested = contest.survey.tested;
  const double share = 1.0 / static_cast<double>(tested.size());
  std::vector<UnseenCause> unseen;
  double of_any = 0;
  for (const Tested& law : tested) {
    // The p-value of the fit together with the valve where there is one; the survey's is a forecast.
    const auto entry = std::find_if(contest.entries.begin(), contest.entries.end(),
                                    [&](const Ranked& r) { return r.fitted_jointly && r.cause == law.cause(); });
    const bool is_fitted = entry != contest.entries.end();
    const double p_value = is_fitted ? entry->p_value : law.p_value;
    const bool tells = (is_fitted ? entry->reduction : law.fit.verified) >= least_gain;
    unseen.push_back({law.cause(), kOddsOfAFault * share * odds_at_unknown_size(tells ? p_value : kNoSign)});
    of_any += unseen.back().odds;
  }
  for (UnseenCause& one : unseen) one.odds /= std::max(of_any, 1.0);
  return unseen;
}

Survey survey_laws(const LinearisedValve& fit, const ValveFitOptions& options) {
  std::set<std::string_view> taken;
  for (const LawInFit& law : options.laws) taken.insert(law.law->family);
  ValveCatalogue catalogue = valve_catalogue(fit, options);
  Survey survey;
  survey.untestable = std::move(catalogue.untestable);
  for (const LawVariant& variant : catalogue.variants) {
    if (taken.contains(variant.law.law->family)) continue;
    double best = 0;
    for (const Tested& tested : survey.tested) best = std::max(best, tested.fit.reduction);
    const double worthwhile = std::max(kLeastPromise, kLeastShare * best);
    auto found = search_law(fit, options, variant.law, variant.starts, kSearchSteps, worthwhile);
    if (!found) continue;
    Tested tested{.starts = variant.starts,
                  .noise_reduction = noise_reduction(variant, found->freedoms, fit.problem(), fit.samples())};
    tested.fit = std::move(*found);
    const auto known = std::find_if(survey.tested.begin(), survey.tested.end(),
                                    [&](const Tested& other) { return other.cause() == tested.cause(); });
    if (known == survey.tested.end()) {
      survey.tested.push_back(std::move(tested));
    } else if (is_better_variant(tested, *known)) {
      *known = std::move(tested);
    }
  }
  std::stable_sort(survey.tested.begin(), survey.tested.end(),
                   [](const Tested& a, const Tested& b) { return a.fit.reduction > b.fit.reduction; });
  for (Tested& tested : survey.tested) {
    tested.evidence = tested.fit.consistent_verified.at_most(tested.fit.verified);
    tested.promise = tested.fit.consistent_reduction.at_most(tested.fit.reduction);
  }
  return survey;
}

Contest hold_contest(const Explanation& beside, const ValveDiagnosisOptions& options, double least_gain) {
  Contest contest;
  const LinearisedValve linear(*beside.problem, beside.v);
  const double inflation = noise_inflation(linear.error());
  const bool bent = is_bent(inflation, linear, beside, options);
  contest.survey = survey_all(linear, beside, bent, options);
  contest.samples = linear.samples();
  contest.p_value_beside = p_value_of_valve(linear, beside.laws.empty(), inflation, options);

  JointFits joint{.lowest = beside.cost};
  fit_jointly(in_the_race(contest.survey, least_gain, options), beside, bent, joint);
  if (joint.racing.empty()) return contest;
  if (bent) {
    const std::string leading(joint.racing.front()->cause());
    fit_jointly(late_entries(leading, contest.survey, joint), beside, bent, joint);
    fit_in_place_of_kin(beside, joint);
    const auto leaves_a_fault = [&] {
      const double left = joint.lowest < beside.cost ? joint.inflation : inflation;
      return hides_a_fault(left, closest_of(joint, beside), options);
    };
    if (may_be_memory(closest_of(joint, beside), beside) || leaves_a_fault()) {
      fit_what_sticks(contest.survey, beside, joint);
      if (leaves_a_fault()) fit_from_slips(beside, joint);
      fit_in_place_of_kin(beside, joint);
    }
    fit_in_place_of_leader(beside, joint);
  }
  settle_borne_out(contest, joint, linear, beside, options);
  if (!contest.cause.empty()) {
    const auto late = late_entries(contest.cause, contest.survey, joint);
    if (!late.empty()) {
      fit_jointly(late, beside, true, joint);
      const bool is_news =
          std::any_of(late.begin(), late.end(), [](const Tested* tested) { return tested->is_of_memory(); });
      if (is_news) fit_in_place_of_kin(beside, joint);
      settle_borne_out(contest, joint, linear, beside, options);
    }
  }
  award(contest, std::move(joint.fitted));
  return contest;
}

Contest held_again(const Contest& contest, const Explanation& beside, const Explanation& better,
                   const ValveDiagnosisOptions& options) {
  Contest again;
  again.entries = contest.entries;
  again.survey = contest.survey;
  again.inflation = contest.inflation;
  again.samples = contest.samples;
  again.p_value_beside = contest.p_value_beside;
  const std::string cause = cause_of(better);
  const auto tested = std::find_if(again.survey.tested.begin(), again.survey.tested.end(),
                                   [&](const Tested& t) { return t.cause() == cause; });
  const double laws = static_cast<double>(again.survey.tested.size());
  if (tested != again.survey.tested.end()) {
    std::erase_if(again.entries, [&](const Ranked& r) { return r.cause == cause; });
    again.entries.push_back(ranked_fit(*tested, beside, whitened_residual(beside), better, again, laws, options));
  }
  std::vector<Explanation> fitted;
  fitted.push_back(better.copy());
  if (contest.best && contest.cause != cause) fitted.push_back(contest.best->copy());
  for (const Explanation& rival : contest.rivals) {
    if (cause_of(rival) != cause) fitted.push_back(rival.copy());
  }
  settle(again, fitted, laws, options);
  award(again, std::move(fitted));
  return again;
}

GoodValveSurvey survey_good_valve(std::span<const Recording> recordings, const ValveFit& fit,
                                  const ValveFitOptions& options) {
  const Explanation nothing = explain_nothing(recordings, options, fit);
  const LinearisedValve linear(*nothing.problem, nothing.v);
  const Survey survey = survey_laws(linear, *nothing.options);
  GoodValveSurvey seen;
  for (const Tested& tested : survey.tested) {
    const Mechanism& law = *tested.fit.law.law;
    Evidence evidence = tested.evidence;
    double size = tested.size();
    VectorXd valve = tested.fit.baseline;
    // A forecast that the simulation bears out needs no fit of everything together; every other one gets it, as a
    // returned valve's may: a law that good valves owe to the simplicity of the model, a dead band at a knee that is
    // sharper than the map's knots, shows itself in no other way. So does a law of memory: the valve's own loop can
    // take its place, which no forecast sees.
    const bool is_open = tested.promise.value > kLeastEvidence && tested.evidence.value < 0.5 * tested.promise.value;
    if (is_open || law.family == "memory") {
      JointFits joint{.lowest = nothing.cost};
      fit_jointly({&tested}, nothing, false, joint);
      const Explanation fitted = led_on(std::move(joint.fitted.front()), kJointSteps, {.lead = nothing.cost});
      const Stack left = whitened_residual(fitted);
      const double reduction = std::max(0.0, nothing.cost - fitted.cost);
      const Evidence found =
          consistent_evidence(linear.error(), left, reduction, slowest_of(fitted)).at_most(reduction);
      if (found.value > evidence.value) {
        evidence = found;
        size = size_in(fitted);
        valve = fitted.v;
      }
    }
    if (const double told = size_told(tested, evidence, size); told == size) {
      size = with_own(law, size, valve, options);
    } else {
      size = with_own(law, told, nothing.v, options);
    }
    seen.causes.push_back({tested.cause(), evidence.value, size});
  }
  seen.leftovers = leftovers_of_good_valve(linear, nothing);
  return seen;
}

}  // namespace valvetriage
