#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/discrepancy/law_search.h"
#include "core/discrepancy/valve_diagnosis.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// One law of a survey with what its evidence means.
struct Tested {
  LawFit fit;
  std::vector<std::vector<double>> starts;  ///< of the search
  Evidence evidence;                        ///< verified reduction, no more than is consistent
  Evidence promise;                         ///< the same of the linear forecast
  double noise_reduction = 0;               ///< what noise alone would give after the search
  double p_value = 1;  ///< of the evidence or the size in a good valve; one law, not all of them together

  std::string cause() const { return std::string(fit.law.law->cause); }
  double size() const;
  bool is_of_memory() const { return fit.law.law->memory != nullptr; }
};

/// Every law beside an explanation, each fitted to what that leaves and the valve cannot absorb.
struct Survey {
  std::vector<Tested> tested;  ///< one per cause, strongest forecast first
  std::vector<Candidate> untestable;
};
Survey survey_laws(const LinearisedValve& fit, const ValveFitOptions& options);

/// A law among its rivals for one place in an explanation.
struct Ranked {
  std::string cause;
  double log_likelihood = 0;
  double borne_out = 0;  ///< the same as far as its distance from the winner's is borne out in more than one place
  double reduction = 0;  ///< of the cost
  Evidence evidence;     ///< no more of it than is consistent
  double p_value = 1;    ///< of its evidence and size in a good valve, one law alone; of what it accounts for, over the
                         ///< number of laws, where that tells the valve from good ones
  Stack residual;        ///< whitened, what is left beside it
  double penalty = 0;    ///< of the cost, what is not in the residual
  double left = 0;       ///< of the cost, above what noise alone makes; of joint fits
  double probability = 0;
  bool fitted_jointly = false;  ///< together with the valve
  bool sticks = false;          ///< makes the spool stick that moves freely without it
  bool stands_out = false;      ///< from what good valves show, all laws searched, or with what it accounts for
};

/// Whether two causes are of one family.
bool are_kin(const Ranked& a, const Ranked& b);

/// A cause beside given others: the best of its rivals with their probabilities.
struct Contest {
  std::optional<Explanation> best;  ///< empty: nothing stands out from good valves
  std::string cause;                ///< of the best
  double p_value = 1;               ///< of the best in a good valve, all laws searched
  std::vector<Ranked> ranked;       ///< by probability
  std::vector<Ranked> entries;      ///< the same before they are compared
  std::vector<Explanation> rivals;  ///< of the others, those that were fitted together with the valve
  Survey survey;
  double inflation = 1, samples = 0;  ///< of the comparison
  double p_value_beside = 1;          ///< in a good valve, of what is left without any of them and of what a fit may
                                      ///< have taken up
};

/// Surveys the laws beside an explanation and lets the best of them compete in joint fits. Laws of a family that is in
/// the explanation already take no part: two causes of one family explain each other's leftovers, not the valve.
///
/// least_gain  of the cost, below which the caller takes no winner: what cannot come near it is not fitted
Contest hold_contest(const Explanation& beside, const ValveDiagnosisOptions& options, double least_gain = 0);

/// The contest again where one of its laws turned out to fit better than its search had found: `better` is `beside`
/// with that law alone.
Contest held_again(const Contest& contest, const Explanation& beside, const Explanation& better,
                   const ValveDiagnosisOptions& options);

/// Gives a cause the share of the probability that a rival has which the data cannot tell from a winner.
void keep_as_rival(const std::string& cause, std::vector<Ranked>& ranked);

/// A cause that these tests may be too weak to see.
struct UnseenCause {
  std::string cause;
  double odds = 0;  ///< of its being there to its not being there
};
/// Of each cause of a survey: odds that the valve has it, at a size that these tests do not see, beside what the
/// contest was held beside. One fault says nothing of another: the odds of any before the tests are the same beside a
/// cause as beside none. The tests ask for more than even odds before they take a valve for faulty: what is short of
/// that is told as no more than even, all causes together.
///
/// least_gain  as in `hold_contest`: what lowers the cost by less tells of no cause
std::vector<UnseenCause> odds_of_being_too_small(const Contest& contest, double least_gain = 0);

/// What further recordings are expected to say of a winner, in noise variances.
struct FurtherRecordings {
  double left = 0;     ///< what it leaves there
  double removed = 0;  ///< what it removes there
};
/// Inflated noise variances by which a winner must still come to lead a rival before that is out: it is told apart, or
/// it is no longer near.
///
/// leaves_usual  whether the winner leaves nothing that good valves do not leave
double lead_still_asked_for(const Ranked& winner, const Ranked& rival, bool leaves_usual,
                            const FurtherRecordings& further, double inflation, const ValveDiagnosisOptions& options);

/// z of the contrast between a winner and a rival below which the one is not borne out against the other; none where it
/// need not be.
///
/// leaves_usual  as above
std::optional<double> least_contrast(const Ranked& winner, bool leaves_usual);

/// What the valve's own loops at v hold beyond good valves' mean of what a law of memory does too [A]; 0 for any other.
double own_excess(const Mechanism& law, const Eigen::VectorXd& v, const ValveFitOptions& options);

/// Whether a valve at v, explained by a law of memory, keeps the other of its own loops wider than good valves have it:
/// some memory of another kind is still in there, and its kind is not settled. False for any other law.
bool leaves_memory(const Mechanism& law, const Eigen::VectorXd& v, const ValveDiagnosisOptions& options);

/// What good valves show of a cause; null where the reference does not know.
const CauseOnGoodValves* on_good_valves(std::span<const CauseOnGoodValves> causes, std::string_view cause);

/// A healthy valve is called so 99 times in 100: half of that risk for names, half for the leftover and the
/// valve's own parameters.
inline constexpr double kFalseAlarm = 0.005;
/// Beside this p-value, `none` has odds of 1 to 19 at the least: −e p ln p (Sellke, Bayarri and Berger, American
/// Statistician 55 (2001) 62). No name is surer than that above it.
inline constexpr double kNamedFalseAlarm = 0.0033;

/// A law is an idealisation, and what it leaves out bends its size: beyond the errors of noise and of good valves'
/// spread 75 sizes of the first virtual stand lay 4 to 6 % off. An uncertainty of type B, GUM (2008) 4.3.
inline constexpr double kIdealisation = 0.05;

/// What one good valve in twenty leaves is unusual.
inline constexpr double kUsualLeftover = 0.05;

/// Noise variances by which two things must differ to be told apart: five standard errors. Eight good valves that show
/// nothing of a cause do not say how rarely a good valve does; a law is never the whole physics.
inline constexpr double kLeastEvidence = 25;

}  // namespace valvetriage
