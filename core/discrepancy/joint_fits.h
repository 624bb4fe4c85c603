#pragma once

#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "core/discrepancy/valve_contest.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// The laws that a survey leaves in the race, each fitted together with the valve.
struct JointFits {
  std::vector<const Tested*> racing;
  std::vector<Explanation> fitted;     ///< in the order of `racing`
  double lowest = 0;                   ///< cost of the best of them, or of what they stand beside
  double inflation = 1;                ///< of the noise, by the best of them
  std::vector<std::string> borne_out;  ///< causes that recordings left out of the fit have confirmed
  std::vector<double> in_place_of;     ///< cost of the kin in whose place each was fitted last: not twice in the same
  std::deque<Tested> moved;            ///< those of `racing` that stand at the other of their law's two places

  /// Takes a fit into `lowest` and `inflation`.
  void compare(const Explanation& with);
  /// What a further fit beside `beside` is led to its end for.
  ToReach to_reach(const Explanation& beside) const;
  bool has(std::string_view cause) const;
};

inline constexpr int kJointSteps = 40;
/// A law this far behind the best in ln likelihood is out of the race.
inline constexpr double kInTheRace = 30;

/// A rival that removes less than this share of the cost that another one removes is nobody's rival, of whatever family
/// they are.
inline constexpr double kStillNear = 1 / 1.5;

/// The population's mean beside the laws already found, with the recordings' own states.
Eigen::VectorXd at_population_mean(const Explanation& explanation);

/// Fits those that enter. `bent`: the fit beside has bent towards a fault and is far from the valve under it, so that
/// they begin from where a good valve stands as well, and at the other of two places where they may act. So does one
/// that keeps little of what was forecast of it.
void fit_jointly(const std::vector<const Tested*>& entering, const Explanation& beside, bool bent, JointFits& joint);
/// Laws of memory once more, each in the place of the one that fits best so far: what one of them found out about the
/// valve under it holds for the others, and the way there is narrow.
void fit_in_place_of_kin(const Explanation& beside, JointFits& joint);
/// Laws that make the spool stick, where they are not in the race: what a bent fit forecasts of them is nothing,
/// whatever it promises.
void fit_what_sticks(const Survey& survey, const Explanation& beside, JointFits& joint);
/// Those in the race once more from what the spool's slips show: where they are large, a slip more or less hides in
/// free runs where the laws belong.
void fit_from_slips(const Explanation& beside, JointFits& joint);

/// Every law once more from the valve that the best fit so far has found under its law: the way there may be narrow for
/// the others, and a rival that has not been there is no worse for it.
void fit_in_place_of_leader(const Explanation& beside, JointFits& joint);

/// Leads those on that were given up for what the best fit removed, where they matter beside a winner that removes
/// `reduction`, less than that. Whether there were any.
bool lead_on(const Explanation& beside, double reduction, JointFits& joint);

/// What leaves least: the best joint fit, or what they all stand beside.
const Explanation& closest_of(const JointFits& joint, const Explanation& beside);

}  // namespace valvetriage
