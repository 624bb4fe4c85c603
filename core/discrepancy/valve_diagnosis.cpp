#include "core/discrepancy/valve_diagnosis.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/discrepancy/input_lines.h"
#include "core/discrepancy/instants.h"
#include "core/discrepancy/joint_fits.h"
#include "core/discrepancy/leftover.h"
#include "core/discrepancy/recording_slip.h"
#include "core/discrepancy/valve_conclusion.h"
#include "core/discrepancy/valve_contest.h"

namespace valvetriage {
namespace {

constexpr int kRefitSteps = 12;
// Shares of the time of a diagnosis.
constexpr double kFirstContest = 0.3, kFurtherContest = 0.1, kReconsidered = 0.65, kConcluded = 0.75;
// A further cause explains at least this share of what is left beyond what good valves leave (three in ten, lesson of
// the pairs).
constexpr double kShareOfASecond = 0.3;
constexpr int kMostCauses = 3;
// The first better baseline is found beside a poor one, and may itself be bettered.
constexpr int kMostBaselines = 2;
// And it explains more than the laws before it may leave of their own signature, as idealisations: three times as much
// of it where free runs stick, which miss the instants of slips.
constexpr double kIdealisationOfSlips = 3 * kIdealisation;

class Diagnosis {
 public:
  Diagnosis(std::span<const Recording> recordings, const ValveFit& baseline, const ValveDiagnosisOptions& options)
      : options_(options), baseline_(explain_nothing(recordings, options.fit, baseline)) {}

  ValveDiagnosis run() {
    if (auto slip = slip_of_gauge_or_unit(baseline_)) return conclude_at_once(baseline_, std::move(*slip));
    report_stage(options_.report, 0, "trying every known cause");
    first_ = hold_contest(baseline_, options_);
    for (int again = 0; again < kMostBaselines && take_better_baseline(); ++again) {
      first_ = hold_contest(baseline_, options_);
    }
    unseen_ = odds_of_being_too_small(first_);
    Explanation explanation = baseline_.copy();
    if (first_.best) {
      explanation = first_.best->copy();
      places_.push_back(first_place(explanation));
      while (explanation.laws.size() < static_cast<std::size_t>(kMostCauses)) {
        const double found = static_cast<double>(explanation.laws.size());
        report_stage(options_.report, kFirstContest + found * kFurtherContest,
                     fmt::format("looking for a further cause beside {}", causes_in(explanation)));
        if (!add_one(explanation)) break;
      }
      if (explanation.laws.size() > 1) {
        report_stage(options_.report, kReconsidered,
                     fmt::format("comparing {} with their rivals", causes_in(explanation)));
        reconsider(explanation);
      }
      while (explanation.laws.size() > 1 && (drop_one_without_size(explanation) || drop_one_of_memory(explanation))) {
      }
      if (explanation.laws.size() == 1) compare_alone(explanation);
      std::erase_if(unseen_, [&](const UnseenCause& unseen) { return has_family_of(explanation, unseen.cause); });
    }
    report_stage(options_.report, kConcluded, "measuring the gain on held-out recordings");
    return conclude({baseline_, explanation, places_, first_, unseen_}, options_);
  }

 private:
  /// A law that moves the valve to where it fits better without the law has found a lower valley of the baseline, and
  /// is credited with what is none of its own: the valve alone goes there. Whether there was one.
  bool take_better_baseline() {
    const Explanation* closest = nullptr;
    double lowest = baseline_.cost - kLeastEvidence;
    const auto look_at = [&](const Explanation& fit) {
      const double cost = without(fit, fit.laws.size() - 1, 0).cost;
      if (!(cost < lowest)) return;
      lowest = cost;
      closest = &fit;
    };
    if (first_.best) look_at(*first_.best);
    for (const Explanation& rival : first_.rivals) look_at(rival);
    if (!closest) return false;
    baseline_ = without(*closest, closest->laws.size() - 1, kJointSteps);
    return true;
  }

  /// The winner of a contest, and how it won.
  Explanation take(Contest& contest) {
    places_.push_back({std::move(contest.ranked), std::move(contest.rivals), contest.p_value});
    return std::move(*contest.best);
  }

  /// A further cause beside those found, where it explains enough of what is left.
  bool add_one(Explanation& explanation) {
    const double noise = noise_cost(explanation);
    // What good valves leave as well is none of this valve's faults.
    const double above_usual = std::max(0.0, explanation.cost - noise - usual_above_noise(noise, options_));
    const double left_of_laws = explanation.problem->sticks(explanation.v) ? kIdealisationOfSlips : kIdealisation;
    const double of_laws = left_of_laws * left_of_laws * (baseline_.cost - explanation.cost);
    const double least_gain = std::max(kShareOfASecond * above_usual, of_laws);
    Contest next = hold_contest(explanation, options_, least_gain);
    if (!next.best || explanation.cost - next.best->cost < least_gain) {
      unseen_ = odds_of_being_too_small(next, least_gain);
      return false;
    }
    explanation = take(next);
    unseen_.clear();
    return true;
  }

  /// Each cause of several must still be needed beside the others, and is compared with its rivals there.
  void reconsider(Explanation& explanation) {
    int replaced = 0;
    // The last one was found beside the others as they are: only where those have changed is it asked again.
    bool is_last_known = true;
    for (std::size_t i = 0; i < explanation.laws.size() && explanation.laws.size() > 1;) {
      if (is_last_known && i + 1 == explanation.laws.size()) return;
      const auto place = places_.begin() + static_cast<std::ptrdiff_t>(i);
      Explanation others = without(explanation, i, kRefitSteps);
      Contest again = hold_contest(others, options_);
      if (!again.best || again.best->cost > others.cost) {
        explanation = std::move(others);
        places_.erase(place);
        if (explanation.laws.size() == 1) places_.front() = first_place(explanation);
        i = 0;
        is_last_known = false;
        continue;
      }
      const bool is_same = again.cause == explanation.laws[i].law.law->cause;
      // The same cause elsewhere must be worth telling from where it was.
      const bool is_better = again.best->cost < explanation.cost - (is_same ? kLeastEvidence : 0);
      if (!is_same && !is_better) {
        // It won against a worse fit of the cause that stands here: a rival, no more.
        keep_as_rival(again.cause, place->ranked);
        ++i;
        continue;
      }
      *place = {std::move(again.ranked), std::move(again.rivals), again.p_value};
      if (is_better) {
        // Another cause does better in its place, or the same one elsewhere: it comes last, and the ones before it are
        // seen with it.
        explanation = std::move(*again.best);
        std::rotate(place, place + 1, places_.end());
        is_last_known = is_same;
        if (++replaced > kMostCauses) return;
        continue;
      }
      ++i;
    }
  }

  /// Beside the others a cause may have come to stand where it does nothing, or where a bound ends what it does: one
  /// whose size may as well be none is none.
  bool drop_one_without_size(Explanation& explanation) {
    const std::vector<double> errors = explanation.standard_errors(noise_inflation(whitened_residual(explanation)));
    std::size_t at = 0;
    for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
      const Mechanism& law = *explanation.laws[l].law.law;
      const std::size_t size = at + law.size_parameter;
      at += law.parameters.size();
      // A memory's size is that of the valve's own loops as well.
      if (law.size_parameter >= law.parameters.size() || law.memory || !std::isfinite(law.neutral)) continue;
      const double from_none =
          explanation.problem->law_parameters(explanation.v, l, 0)[law.size_parameter] - law.neutral;
      // An error that is no number tells nothing against a law.
      if (!(std::abs(from_none) < kTwoSided95 * errors[size])) continue;
      drop(explanation, l);
      return true;
    }
    return false;
  }

  /// A change of gain that may begin with one of few moves of the input, beside a memory, stands for what is still
  /// wrong with that memory.
  bool drop_one_of_memory(Explanation& explanation) {
    const auto is_memory = [](const LawFit& fit) { return fit.law.law->family == "memory"; };
    if (std::none_of(explanation.laws.begin(), explanation.laws.end(), is_memory)) return false;
    const double inflation = noise_inflation(whitened_residual(explanation));
    for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
      const bool is_instant = explanation.laws[l].law.law->cause == "intermittent";
      if (!is_instant || !may_begin_with_input(explanation, l, inflation)) continue;
      drop(explanation, l);
      return true;
    }
    return false;
  }

  void drop(Explanation& explanation, std::size_t law) {
    explanation = without(explanation, law, kRefitSteps);
    places_.erase(places_.begin() + static_cast<std::ptrdiff_t>(law));
    if (explanation.laws.size() == 1) places_.front() = first_place(explanation);
  }

  /// The one that is left of several is not the one that won alone: the two are compared as they fit now.
  void compare_alone(Explanation& explanation) {
    if (explanation.laws.front().law.law->cause == first_.cause) return;
    Contest again = held_again(first_, baseline_, explanation, options_);
    if (!again.best) return;
    explanation = again.best->copy();
    first_ = std::move(again);
    places_.front() = first_place(explanation);
  }

  static std::string causes_in(const Explanation& explanation) {
    std::string causes;
    for (const LawFit& fit : explanation.laws) {
      causes += fmt::format("{}{}", causes.empty() ? "" : " and ", fit.law.law->cause);
    }
    std::replace(causes.begin(), causes.end(), '_', ' ');
    return causes;
  }

  static bool has_family_of(const Explanation& explanation, const std::string& cause) {
    return std::any_of(explanation.laws.begin(), explanation.laws.end(),
                       [&](const LawFit& fit) { return fit.law.law->family == find_mechanism(cause)->family; });
  }

  /// How a cause did beside the baseline alone: nothing for it where another one won.
  WonPlace first_place(const Explanation& explanation) const {
    const bool is_same = first_.best && first_.cause == explanation.laws.front().law.law->cause;
    WonPlace place{.ranked = first_.ranked, .rivals = {}, .p_value = is_same ? first_.p_value : 1};
    for (const Explanation& rival : first_.rivals) place.rivals.push_back(rival.copy());
    return place;
  }

  const ValveDiagnosisOptions& options_;
  Explanation baseline_;
  Contest first_;                    ///< beside the baseline
  std::vector<WonPlace> places_;     ///< one per law of the explanation
  std::vector<UnseenCause> unseen_;  ///< beside what was found
};

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

}  // namespace valvetriage
