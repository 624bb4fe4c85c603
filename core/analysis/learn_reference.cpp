#include "core/analysis/learn_reference.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <boost/math/statistics/univariate_statistics.hpp>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "core/analysis/known_tests.h"
#include "core/analysis/part_to_fit.h"
#include "core/analysis/usual_mechanisms.h"
#include "core/analysis/valve_covariance.h"
#include "core/discrepancy/valve_diagnosis.h"
#include "core/identify/valve_fit.h"
#include "core/mechanisms/simulate_extended.h"
#include "core/residual/fit_figures.h"
#include "core/residual/noise_floor.h"
#include "core/residual/step_response.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kParameters = static_cast<Index>(kValveParameters.size());
constexpr double kOutlierSignificance = 1e-3;
// Default Eq 20 window: what every step of the population covers, but no more than a slow valve needs to settle.
constexpr double kLongestWindow_s = 2.0;
constexpr double kHighestWindowRate_hz = 200.0;

struct Member {
  const ValveRecordings* valve = nullptr;
  ValveFit fit;
  VectorXd vector;
  double distance = 0;
  bool used = true;
};

// Shares of the time of learning.
constexpr double kFitted = 0.1, kUsualLearned = 0.3, kFittedAgain = 0.4;
// Of both times, where it is learned twice.
constexpr double kLearned = 0.5;

void report_valve(const StageReport& report, std::string_view what, const ValveRecordings& valve, std::size_t before,
                  std::size_t valves) {
  report_stage(report, static_cast<double>(before) / static_cast<double>(valves),
               fmt::format("{} valve {} ({} of {})", what, valve.serial, before + 1, valves));
}

Result<ValveFit> fit_member(const ValveRecordings& valve, const ValveFitOptions& options) {
  auto fit = fit_valve(valve.recordings, options);
  if (!fit) {
    Error error = fit.error();
    error.message = fmt::format("valve '{}': {}", valve.serial, error.message);
    return tl::unexpected(error);
  }
  return fit;
}

std::vector<const Member*> used_members(const std::vector<Member>& members, const Member* without = nullptr) {
  std::vector<const Member*> used;
  for (const Member& member : members) {
    if (member.used && &member != without) used.push_back(&member);
  }
  return used;
}

std::vector<ValveRecordings> recordings_of(const std::vector<const Member*>& members) {
  std::vector<ValveRecordings> valves;
  for (const Member* member : members) valves.push_back(*member->valve);
  return valves;
}

VectorXd mean_of(const std::vector<const Member*>& members) {
  VectorXd mean = VectorXd::Zero(members.front()->vector.size());
  for (const Member* member : members) mean += member->vector;
  return mean / static_cast<double>(members.size());
}

/// Figures by which a valve is compared with the others: its parameters, ln rms, and the map at a handful of inputs.
struct OutlierFigures {
  VectorXd value;
  VectorXd error_variance;  ///< of each, by the fit's own account
};

OutlierFigures outlier_figures(const Member& member) {
  constexpr Index kMapFigures = 6;
  const Index knots = member.vector.size() - kParameters;
  OutlierFigures figures{VectorXd(kParameters + 1 + kMapFigures), VectorXd::Zero(kParameters + 1 + kMapFigures)};
  const auto take = [&](Index figure, Index entry) {
    figures.value(figure) = member.vector(entry);
    figures.error_variance(figure) = member.fit.covariance(entry, entry);
  };
  for (Index j = 0; j < kParameters; ++j) take(j, j);
  figures.value(kParameters) = std::log(std::max(member.fit.rmse, 1e-12));
  for (Index k = 0; k < kMapFigures; ++k) {
    take(kParameters + 1 + k, kParameters + k * (knots - 1) / (kMapFigures - 1));
  }
  return figures;
}

/// Where the sampling or the length of the recordings holds a parameter of most members, their spread is that of the
/// bound, not of valves. A loop or a delay at zero is none: that is where good ones are.
bool is_held(Index figure, const std::vector<const Member*>& members) {
  if (figure >= kParameters || !kValveParameters[static_cast<std::size_t>(figure)].logarithmic) return false;
  const auto held = std::count_if(members.begin(), members.end(), [figure](const Member* member) {
    return member->fit.at_bound[static_cast<std::size_t>(figure)];
  });
  return 2 * held > static_cast<std::ptrdiff_t>(members.size());
}

/// Externally studentized distance of one member from the others: the largest over its figures. Estimates that agree
/// by chance, or at zero, are no closer than their own errors.
double studentized_distance(const Member& member, const std::vector<const Member*>& others) {
  const OutlierFigures own = outlier_figures(member);
  std::vector<OutlierFigures> theirs;
  for (const Member* other : others) theirs.push_back(outlier_figures(*other));
  const double n = static_cast<double>(others.size());
  double largest = 0;
  for (Index j = 0; j < own.value.size(); ++j) {
    if (is_held(j, others)) continue;
    double mean = 0, square = 0, error = own.error_variance(j);
    for (const OutlierFigures& other : theirs) mean += other.value(j) / n;
    for (const OutlierFigures& other : theirs) {
      square += std::pow(other.value(j) - mean, 2);
      error += other.error_variance(j) / (n * n);
    }
    const double sd = std::sqrt(std::max(square / (n - 1) * (1 + 1 / n), error));
    if (sd > 0) largest = std::max(largest, std::abs(own.value(j) - mean) / sd);
  }
  return largest;
}

/// Leaves out, one at a time, the valve that is least like the others, while it is beyond doubt.
void point_out_outliers(std::vector<Member>& members) {
  for (;;) {
    Member* worst = nullptr;
    for (Member& member : members) {
      if (!member.used) continue;
      const auto others = used_members(members, &member);
      if (others.size() < 2) return;
      member.distance = studentized_distance(member, others);
      if (!worst || member.distance > worst->distance) worst = &member;
    }
    const auto used = static_cast<double>(used_members(members).size());
    if (used <= kFewestReferenceValves) return;
    const double figures = static_cast<double>(outlier_figures(*worst).value.size());
    const double limit = student_t_upper_quantile(used - 2, kOutlierSignificance / (2 * used * figures));
    if (worst->distance <= limit) return;
    worst->used = false;
  }
}

/// The population's covariance, estimates' errors taken off; of the others where `left_out` members stand aside.
MatrixXd covariance_of(const std::vector<const Member*>& members, const ValveFitOptions& options, Index left_out = 0) {
  MatrixXd vectors(members.front()->vector.size(), static_cast<Index>(members.size()));
  MatrixXd errors = MatrixXd::Zero(vectors.rows(), vectors.rows());
  for (std::size_t i = 0; i < members.size(); ++i) {
    vectors.col(static_cast<Index>(i)) = members[i]->vector;
    errors += members[i]->fit.covariance / static_cast<double>(members.size());
  }
  return valve_covariance(vectors, errors, options.knots, options.usual.current_scale, left_out);
}

Model model_of(const VectorXd& vector, const ValveFitOptions& options) {
  std::vector<double> values(static_cast<std::size_t>(vector.size() - kParameters));
  VectorXd::Map(values.data(), std::ssize(values)) = vector.tail(std::ssize(values));
  const std::vector<double> weights(values.size(), 1.0);
  return to_model(to_parameters(vector.head(kParameters), options.reference_psi, options.usual),
                  {options.knots, monotone_regression(values, weights)}, options.usual);
}

Eq20Window default_window(const std::vector<const Member*>& members) {
  double rate = kHighestWindowRate_hz;
  double duration = kLongestWindow_s;
  for (const Member* member : members) {
    for (std::size_t r = 0; r < member->valve->recordings.size(); ++r) {
      const Recording& recording = member->valve->recordings[r];
      for (const StepWindow& step : rising_steps(recording, r)) {
        rate = std::min(rate, recording.sample_rate_hz());
        duration = std::min(duration, static_cast<double>(step.end - step.begin) * recording.sample_period_s);
      }
    }
  }
  return {rate, duration};
}

struct Running {
  int n = 0;
  double mean = 0, m2 = 0;
  void add(double x) {
    ++n;
    const double d = x - mean;
    mean += d / n;
    m2 += d * (x - mean);
  }
  double sd() const { return n > 1 ? std::sqrt(m2 / (n - 1)) : 0; }
};

struct LevelSums {
  double level_a = 0;
  Running error, settling, rise;
};

LevelSums& sums_at(std::vector<LevelSums>& all, double level, double current_scale) {
  for (LevelSums& sums : all) {
    if (is_same_level(sums.level_a, level, current_scale)) return sums;
  }
  all.push_back({.level_a = rounded_level(level, current_scale)});
  return all.back();
}

/// What each good valve leaves against the mean of the others, level by level.
Result<std::vector<LevelPopulation>> level_populations(const std::vector<Member>& members,
                                                       const ValveFitOptions& options, const Eq20Window& window) {
  std::vector<LevelSums> all;
  for (const Member* member : used_members(members)) {
    const Model others = model_of(mean_of(used_members(members, member)), options);
    for (std::size_t r = 0; r < member->valve->recordings.size(); ++r) {
      const Recording& recording = member->valve->recordings[r];
      const auto steps = rising_steps(recording, r);
      if (steps.empty()) continue;
      const auto simulated = simulate_extended(others, recording, InitialState{});
      if (!simulated) return tl::unexpected(simulated.error());
      const double noise = noise_floor(recording).rms;
      for (const StepWindow& step : steps) {
        LevelSums& sums = sums_at(all, step.level, options.usual.current_scale);
        if (const auto error = error_eq20(recording, *simulated, step, window)) sums.error.add(*error);
        if (const auto settling = settling_error(recording, *simulated, step, window)) sums.settling.add(*settling);
        if (const auto rise = measured_rise_time_s(recording, step, window, noise)) sums.rise.add(*rise);
      }
    }
  }
  std::vector<LevelPopulation> levels;
  for (const LevelSums& sums : all) {
    levels.push_back({sums.level_a, sums.error.mean, sums.error.sd(), sums.settling.mean, sums.settling.sd(),
                      sums.rise.mean, sums.rise.sd()});
  }
  std::sort(levels.begin(), levels.end(), [](const auto& a, const auto& b) { return a.level_a < b.level_a; });
  return levels;
}

/// What the engine sees in good valves, each against the population of the others: the scale of every later test.
Result<void> survey_members(const std::vector<Member>& members, ValveFitOptions options, const StageReport& report,
                            Reference& reference) {
  std::map<std::string, Running> evidence, size, leftover;
  const auto used = used_members(members);
  std::size_t surveyed = 0;
  for (const Member* member : used) {
    report_valve(report, "trying every cause on", *member->valve, surveyed++, used.size());
    const auto others = used_members(members, member);
    const VectorXd mean = mean_of(others);
    options.prior = population_prior(mean, covariance_of(others, options, 1), static_cast<double>(others.size()));
    options.start.reset();
    const auto fit = fit_valve(member->valve->recordings, options);
    if (!fit) return tl::unexpected(fit.error());
    const GoodValveSurvey seen = survey_good_valve(member->valve->recordings, *fit, options);
    for (const auto& cause : seen.causes) {
      evidence[cause.cause].add(cause.evidence);
      if (std::isfinite(cause.size)) size[cause.cause].add(cause.size);
    }
    for (const auto& [group, log_ratio] : seen.leftovers) leftover[group].add(log_ratio);
  }
  for (auto& [cause, values] : evidence) {
    // A cause that did not show in some valves had no evidence there.
    while (values.n < static_cast<int>(used.size())) values.add(0);
    // Nor any size, where none has a number.
    const double neutral = find_mechanism(cause)->neutral;
    while (std::isfinite(neutral) && size[cause].n < static_cast<int>(used.size())) size[cause].add(neutral);
    reference.causes.push_back({.cause = cause,
                                .evidence_mean = values.mean,
                                .evidence_sd = values.sd(),
                                .size_mean = size[cause].mean,
                                .size_sd = size[cause].sd(),
                                .size_valves = size[cause].n});
  }
  for (const auto& [group, values] : leftover) {
    reference.leftovers.push_back({group, values.mean, values.sd(), values.n});
  }
  return {};
}

std::vector<PopulationParameter> describe(const VectorXd& mean, const MatrixXd& covariance) {
  std::vector<PopulationParameter> parameters;
  for (Index j = 0; j < kParameters; ++j) {
    const ValveParameterInfo& info = kValveParameters[static_cast<std::size_t>(j)];
    parameters.push_back({std::string(info.name), std::string(info.unit), info.logarithmic ? "log" : "linear", mean(j),
                          std::sqrt(covariance(j, j))});
  }
  return parameters;
}

/// Facts about the recordings themselves: ranges, tests, sampling, noise.
void describe_recordings(const std::vector<const Member*>& members, Reference& reference) {
  std::vector<double> periods, noises;
  std::set<std::string> tests;
  InputSpan span;
  for (const Member* member : members) {
    span.widen(member->valve->recordings);
    for (const Recording& recording : member->valve->recordings) {
      periods.push_back(recording.sample_period_s);
      noises.push_back(noise_floor(recording).rms);
      tests.insert(to_string(recording.test));
    }
  }
  reference.input_min = span.low_a;
  reference.input_max = span.high_a;
  reference.sample_period_s = boost::math::statistics::median(periods);
  reference.noise_floor = boost::math::statistics::median(noises);
  reference.tests.assign(tests.begin(), tests.end());
}

/// Knots that cover every valve, and one pressure at which all time constants are quoted.
Result<ValveFitOptions> common_options(std::span<const ValveRecordings> valves) {
  ValveFitOptions options;
  InputSpan span;
  for (const ValveRecordings& valve : valves) {
    if (const auto own = map_knots(valve.recordings); !own) return tl::unexpected(own.error());
    span.widen(valve.recordings);
    options.reference_psi += reference_pressure(valve.recordings) / static_cast<double>(valves.size());
  }
  options.knots = *map_knots(span);
  options.usual.current_scale = span.current_scale();
  return options;
}

/// The middle one of what each parameter is in some fits.
ValveParameters middle_of(const std::vector<const Member*>& members, const ValveFitOptions& options) {
  VectorXd middle(kParameters);
  for (Index j = 0; j < kParameters; ++j) {
    std::vector<double> values;
    for (const Member* member : members) values.push_back(member->vector(j));
    middle(j) = boost::math::statistics::median(values);
  }
  return to_parameters(middle, options.reference_psi, options.usual);
}

/// A fit may be led astray by the start that all have in common. One that leaves more than the one that leaves least is
/// tried from where that ended, and from where an earlier fit of its valve did.
void try_other_starts(std::vector<Member>& members, ValveFitOptions options, std::span<const Member> before) {
  constexpr double kAsLittle = 1.02;  // of the rms
  const auto least = std::min_element(members.begin(), members.end(),
                                      [](const Member& a, const Member& b) { return a.fit.rmse < b.fit.rmse; });
  const double least_left = least->fit.rmse;
  const ValveParameters where = least->fit.parameters;
  for (std::size_t i = 0; i < members.size(); ++i) {
    Member& member = members[i];
    std::vector<ValveParameters> starts{where};
    if (!before.empty()) starts.push_back(before[i].fit.parameters);
    for (const ValveParameters& start : starts) {
      if (member.fit.rmse <= kAsLittle * least_left) break;
      options.start = start;
      auto other = fit_member(*member.valve, options);
      if (other && other->rmse < member.fit.rmse) member.fit = std::move(*other);
    }
  }
}

/// Every valve fitted, those that are unlike the others left out. `before` are earlier fits of the same valves.
Result<std::vector<Member>> fit_members(std::span<const ValveRecordings> valves, ValveFitOptions options,
                                        std::span<const Member> before, const StageReport& report) {
  std::vector<Member> members;
  for (const ValveRecordings& valve : valves) {
    report_valve(report, "fitting", valve, members.size(), valves.size());
    auto fit = fit_member(valve, options);
    if (!fit) return tl::unexpected(fit.error());
    if (!options.start) options.start = fit->parameters;
    members.push_back({.valve = &valve, .fit = std::move(*fit)});
  }
  try_other_starts(members, options, before);
  for (Member& member : members) {
    member.vector = member.fit.vector.head(kParameters + static_cast<Index>(member.fit.map.output.size()));
  }
  point_out_outliers(members);
  return members;
}

/// ln of the rms that each valve's own fit leaves.
Result<std::vector<double>> logs_left(std::span<const ValveRecordings> valves, const ValveFitOptions& options) {
  std::vector<double> logs;
  for (const ValveRecordings& valve : valves) {
    const auto fit = fit_member(valve, options);
    if (!fit) return tl::unexpected(fit.error());
    logs.push_back(std::log(std::max(fit->rmse, 1e-12)));
  }
  return logs;
}

/// How these valves' simulation is put together, by what leaves more of none of them and less in the mean:
/// - whether their commands are held between samples: a stand that holds and a simulation that goes straight differ by
///   half a sample on every ramp and by nothing on steps, which no delay follows;
/// - whether their second-order dynamics stand ahead of the map or behind it: an overshoot behind the map is as large
///   in shares of every step, one ahead of it goes with the map's slope.
Result<UsualMechanisms> arrangement(std::span<const ValveRecordings> valves, ValveFitOptions options) {
  constexpr std::size_t kAsked = 2;
  const double closer = std::log(1.005);
  constexpr double kPromptInSamples = 8;
  const auto asked = valves.first(std::min(kAsked, valves.size()));
  auto left = logs_left(asked, options);
  if (!left) return tl::unexpected(left.error());
  const auto choose = [&](const UsualMechanisms& other) {
    const UsualMechanisms before = std::exchange(options.usual, other);
    auto there = logs_left(asked, options);
    bool is_closer = there.has_value();
    double gained = 0;
    for (std::size_t i = 0; is_closer && i < asked.size(); ++i) {
      const double gain = (*left)[i] - (*there)[i];
      gained += gain / static_cast<double>(asked.size());
      is_closer = gain >= 0;
    }
    is_closer = is_closer && gained > closer;
    if (is_closer) {
      left = std::move(there);
    } else {
      options.usual = before;
    }
  };
  UsualMechanisms other = options.usual;
  if (std::any_of(asked.begin(), asked.end(), [](const auto& valve) { return holds_and_moves(valve.recordings); })) {
    other.input_between = InputBetween::kHeld;
    choose(other);
  }
  other = options.usual;
  other.prompt_spool_rad_s = kPromptInSamples / valves.front().recordings.front().sample_period_s;
  choose(other);
  return options.usual;
}

Result<Reference> learn_with(const std::vector<Member>& members, const std::string& valve_type,
                             const ValveFitOptions& options, const StageReport& report) {
  const auto used = used_members(members);
  const VectorXd mean = mean_of(used);
  const MatrixXd covariance = covariance_of(used, options);

  Reference reference;
  reference.valve_type = valve_type;
  reference.valves = static_cast<int>(used.size());
  for (const Member& member : members) {
    reference.members.push_back({member.valve->serial, static_cast<int>(member.valve->recordings.size()),
                                 member.fit.rmse, member.distance, member.used});
  }
  reference.model = model_of(mean, options);
  reference.parameters = describe(mean, covariance);
  for (Index k = kParameters; k < mean.size(); ++k) reference.map_sd.push_back(std::sqrt(covariance(k, k)));
  reference.covariance.assign(covariance.data(), covariance.data() + covariance.size());
  reference.prior_degrees_of_freedom = static_cast<double>(used.size() - 1);
  describe_recordings(used, reference);
  reference.window = default_window(used);
  auto levels = level_populations(members, options, reference.window);
  if (!levels) return tl::unexpected(levels.error());
  reference.levels = std::move(*levels);
  if (const auto surveyed = survey_members(members, options, report, reference); !surveyed) {
    return tl::unexpected(surveyed.error());
  }
  return reference;
}

/// Whether two valves have a recording in common, sample for sample.
bool share_a_recording(const ValveRecordings& a, const ValveRecordings& b) {
  const auto is_in_b = [&](const Recording& recording) {
    return std::ranges::any_of(b.recordings,
                               [&](const Recording& other) { return other.output.values == recording.output.values; });
  };
  return std::ranges::any_of(a.recordings, is_in_b);
}

/// A valve that counts as several makes good valves look more alike than they are, and the next good one is thrown out.
Result<void> check_distinct(std::span<const ValveRecordings> valves) {
  for (std::size_t i = 0; i < valves.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (valves[i].serial != valves[j].serial || !share_a_recording(valves[i], valves[j])) continue;
      return fail("repeated_valve",
                  fmt::format("valve {} is there more than once, with the same recording: a copy is no further good "
                              "valve",
                              valves[i].serial));
    }
  }
  return {};
}

/// A reference, and what the fits it was learned of leave.
struct Learned {
  Reference reference;
  std::vector<Member> members;
};

Result<Learned> learn_from(std::span<const ValveRecordings> valves, const std::string& valve_type,
                           const StageReport& report) {
  auto options = common_options(valves);
  if (!options) return tl::unexpected(options.error());

  const auto arranged = arrangement(valves, *options);
  if (!arranged) return tl::unexpected(arranged.error());
  options->usual = *arranged;

  // What they have in common is learned from those that are alike.
  const auto first = fit_members(valves, *options, {}, report_part(report, 0, kFitted));
  if (!first) return tl::unexpected(first.error());
  const auto alike = used_members(*first);
  // Behind the map a mode and a volume change places without a bend between them: the first valve's place may be a
  // dent.
  const bool has_mode = options->usual.prompt_spool_rad_s > 0;
  options->start = has_mode ? middle_of(alike, *options) : alike.front()->fit.parameters;
  report_stage(report, kFitted, "learning what they have in common");
  const auto usual = learn_usual_mechanisms(recordings_of(alike), *options);
  if (!usual) return tl::unexpected(usual.error());
  options->usual = *usual;
  auto members = fit_members(valves, *options, *first, report_part(report, kUsualLearned, kFittedAgain));
  if (!members) return tl::unexpected(members.error());
  auto reference = learn_with(*members, valve_type, *options, report_part(report, kFittedAgain, 1));
  if (!reference) return tl::unexpected(reference.error());
  return Learned{std::move(*reference), std::move(*members)};
}

std::vector<FollowedValve> followed(const std::vector<const Member*>& members) {
  std::vector<FollowedValve> valves;
  for (const Member* member : members) valves.push_back({member->valve->recordings, member->fit.simulated});
  return valves;
}

/// Each valve's recordings of the tests that all were put through, with what the others' simulations leave in common
/// taken off; none unless that leaves less of them, by kWorthTakingOff of the noise's power.
std::vector<ValveRecordings> without_what_others_leave(const std::vector<const Member*>& members,
                                                       const CommonResiduals& common) {
  constexpr double kWorthTakingOff = 0.05;
  std::vector<ValveRecordings> cleaned;
  double gained = 0, noise = 0;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const ValveRecordings& valve = *members[m]->valve;
    const std::vector<KnownTest> tests = common.of_others(m);
    cleaned.push_back({valve.serial, {}});
    for (std::size_t r = 0; r < valve.recordings.size(); ++r) {
      const Recording& before = valve.recordings[r];
      const std::vector<double> left = left_in_common(before, tests);
      if (left.empty()) continue;
      Recording& after = cleaned.back().recordings.emplace_back(before);
      take_off(left, after);
      const auto square_left_by = [&](const Recording& recording) {
        return std::pow(fit_figures(recording.output.values, members[m]->fit.simulated[r], recording.valid).rmse, 2);
      };
      const auto samples = static_cast<double>(before.valid_samples());
      gained += samples * (square_left_by(before) - square_left_by(after));
      noise += samples * std::pow(noise_floor(before).rms, 2);
    }
    if (cleaned.back().recordings.empty()) return {};
  }
  return gained > kWorthTakingOff * noise ? cleaned : std::vector<ValveRecordings>{};
}

/// What good valves are like beyond what their simulations leave in common; none where that is little, where the rest
/// tells no population, and of fewer than kFewestInCommon. What two or three leave alike by chance passes for common,
/// and how far the next valve is from it they cannot tell: of 43 faults in a valve that fills through a restrictor two
/// were named wrong with three good valves.
std::optional<OnKnownTests> learn_beyond(const std::vector<const Member*>& members, const std::string& valve_type,
                                         const StageReport& report) {
  constexpr std::size_t kFewestInCommon = 5;
  if (members.size() < kFewestInCommon) return std::nullopt;
  const CommonResiduals common(followed(members));
  const std::vector<ValveRecordings> cleaned = without_what_others_leave(members, common);
  if (cleaned.empty()) return std::nullopt;
  auto learned = learn_from(cleaned, valve_type, report);
  if (!learned) return std::nullopt;
  return OnKnownTests{common.of_all(), std::move(learned->reference)};
}

}  // namespace

Result<Reference> learn_reference(std::span<const ValveRecordings> given, const std::string& valve_type,
                                  const StageReport& report) {
  std::vector<ValveRecordings> valves;
  for (const ValveRecordings& valve : given) {
    valves.push_back({valve.serial, part_to_fit(valve.recordings, 0).recordings});
  }
  if (valves.size() < static_cast<std::size_t>(kFewestReferenceValves)) {
    return fail("too_few_valves",
                fmt::format("a reference needs at least {} good valves, here {} {}", kFewestReferenceValves,
                            valves.size() == 1 ? "is" : "are", valves.size()));
  }
  if (auto checked = check_distinct(valves); !checked) return tl::unexpected(checked.error());
  auto learned = learn_from(valves, valve_type, report_part(report, 0, kLearned));
  if (!learned) return tl::unexpected(learned.error());
  auto beyond = learn_beyond(used_members(learned->members), valve_type, report_part(report, kLearned, 1));
  if (beyond) learned->reference.on_known_tests.push_back(std::move(*beyond));
  return std::move(learned->reference);
}

}  // namespace valvetriage
