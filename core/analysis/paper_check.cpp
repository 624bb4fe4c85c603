#include "core/analysis/paper_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/analysis/frequency_analysis.h"
#include "core/analysis/paper_classification.h"
#include "core/analysis/paper_error_scaling.h"
#include "core/analysis/paper_frequency.h"
#include "core/analysis/paper_rls_bias.h"
#include "core/analysis/paper_stability.h"

namespace valvetriage {
namespace {

constexpr std::array<std::uint64_t, 2> kSeeds{1, 2};

PaperLine corner_form_line() {
  const CornerFormCheck check = check_corner_form();
  return {
      .where = "Eqs 2 to 5",
      .as_printed = "Factors (s - z_i) + 1; Lm G = sum t_i (x_i - 1/2 ln e^2x + e^2x_i); Eq 5: the asymptote's error.",
      .recomputed = fmt::format(
          "In corner form, s/(-z_i) + 1 and 1/2 ln(e^2x + e^2x_i), Eq 4 minus Eq 3 equals Eq 5 "
          "within {:.1e} and ln|G| itself within {:.1e}; largest at the corner: 1/2 ln 2 = {:.4f} "
          "neper = {:.2f} dB.",
          check.largest_deviation, check.response_deviation, check.largest_gap, decibels(check.largest_gap)),
      .does_not_hold =
          fmt::format("Eq 2 as printed shifts every root by 1; with the bracket of Eq 3 where it stands Eq 5 "
                      "is missed by {:.3g} neper. Gain, delay and phase are left out, roots are real.",
                      check.largest_deviation_as_printed),
      .figures = {{"corner_form_deviation", check.largest_deviation, "neper"},
                  {"response_deviation", check.response_deviation, "neper"},
                  {"as_printed_deviation", check.largest_deviation_as_printed, "neper"},
                  {"largest_asymptote_error", check.largest_gap, "neper"}}};
}

std::string_view name_of(RlsForm form) {
  if (form == RlsForm::kIncremental) return "incremental";
  return form == RlsForm::kExtended ? "extended" : "absolute";
}

std::string outcome_text(const std::vector<RlsOutcome>& outcomes, RlsForm form) {
  std::string gains, errors;
  for (const RlsOutcome& outcome : outcomes) {
    if (outcome.form != form) continue;
    gains += fmt::format("{}{:.0f}", gains.empty() ? "" : " and ", outcome.static_gain);
    errors += fmt::format("{}{:.1f}", errors.empty() ? "" : " and ", outcome.free_run_rmse);
  }
  return fmt::format("static gain {}, free-run rmse {} psi", gains, errors);
}

PaperLine rls_line(const RlsBiasScene& scene, const std::vector<RlsOutcome>& outcomes) {
  PaperLine line{
      .where = "Eqs 7 to 15",
      .as_printed =
          "Recursive least squares on increments with c1 = 0. \"K\" in Eqs 7, 9 and 10 is an ellipsis, \"1\" in "
          "Eq 15 the identity; Eq 12 mixes i and t.",
      .recomputed =
          fmt::format("A second-order valve of static gain {:.0f} psi/A at {:.0f} Hz, {:.0f} psi step, {} psi "
                      "white noise, seeds 1 and 2. As printed: {}. Extended by c1: {}. Absolute form: {}.",
                      scene.static_gain, scene.sample_rate_hz, 0.2 * scene.static_gain, scene.noise_psi,
                      outcome_text(outcomes, RlsForm::kIncremental), outcome_text(outcomes, RlsForm::kExtended),
                      outcome_text(outcomes, RlsForm::kAbsolute)),
      .does_not_hold =
          "Differencing makes white measurement noise a moving average with a unit root: the estimate is "
          "biased, and one noise coefficient does not mend it. Perhaps why Eqs 18 and 19 are what they "
          "are.",
      .figures = {{"true_static_gain", scene.static_gain, "psi/A"}}};
  for (const RlsOutcome& outcome : outcomes) {
    const std::string suffix = fmt::format("_{}_seed_{}", name_of(outcome.form), outcome.seed);
    line.figures.push_back({"static_gain" + suffix, outcome.static_gain, "psi/A"});
    line.figures.push_back({"free_run_rmse" + suffix, outcome.free_run_rmse, "psi"});
  }
  return line;
}

PaperLine simulated_data_line(const RlsBiasScene& scene) {
  constexpr double kSlowerBy = 1.4;
  const SimulatedDataReadings readings = compare_simulated_data_readings(scene, kSlowerBy, kSeeds[0]);
  return {.where = "X_S",
          .as_printed = "\"The simulated data was obtained through the procedure of Recursive Least Square method.\"",
          .recomputed = fmt::format("A valve {} times slower than a good one has Eq 20 = {:.2f} psi/s against its own "
                                    "model and {:.2f} psi/s against the good valve's.",
                                    kSlowerBy, readings.own_model, readings.good_model),
          .does_not_hold =
              "Two readings, and only the second one sees the fault: a model fitted to the returned valve "
              "takes its slowness along. Verdicts here use the good valves' model.",
          .figures = {{"error_eq20_own_model", readings.own_model, "psi/s"},
                      {"error_eq20_good_model", readings.good_model, "psi/s"}}};
}

PaperLine bode_models_line() {
  const double good = half_power_frequency(cancelled(kPaperEquation16));
  const double returned = half_power_frequency(cancelled(kPaperEquation17));
  const auto order = [](const PaperBodeModel& m) { return transfer_function_of(m, 0.5, 0.5).poles.size(); };
  return {
      .where = "Eqs 16, 17",
      .as_printed = "\"Of the ninth order\"; quadratics s^2/(8.5 s^2) + 2 zeta s/8.5 + 1, squared above and below.",
      .recomputed = fmt::format("With s^2/8.5^2 the denominators have order {} (good) and {} (returned). Corners: "
                                "zero {:.3f}; pole {:.3f} (good), {:.3f} (returned); 10. With the quadratics "
                                "cancelled the -3 dB points are {:.2f} and {:.2f}: \"returned decays first\" holds.",
                                order(kPaperEquation16), order(kPaperEquation17), kPaperEquation16.zero,
                                kPaperEquation16.pole, kPaperEquation17.pole, good, returned),
      .does_not_hold =
          "Not ninth order; s^2/(8.5 s^2) is the constant 1/8.5, a misprint; with one zeta the quadratics "
          "cancel; k_dc, zeta and the unit of frequency are not printed.",
      .figures = {{"order_good", static_cast<double>(order(kPaperEquation16))},
                  {"order_returned", static_cast<double>(order(kPaperEquation17))},
                  {"zero", kPaperEquation16.zero},
                  {"pole_good", kPaperEquation16.pole},
                  {"pole_returned", kPaperEquation17.pole},
                  {"half_power_good", good},
                  {"half_power_returned", returned}}};
}

PaperLine equation_18_line() {
  const PaperPoleCheck check = check_poles(paper_equation_18());
  const InstabilityProof proof = prove_unstable(paper_equation_18());
  return {
      .where = "Eq 18",
      .as_printed = "The good valve as a discrete transfer function of order 7.",
      .recomputed = fmt::format("Poles {:.4f} ± {:.4f}j, modulus {:.4f}; static gain {:.3f}/{:.3f} = {:.3f}. {}",
                                check.largest_pole.real(), check.largest_pole.imag(), check.largest_modulus,
                                check.numerator_sum, check.denominator_sum, check.static_gain,
                                proof.proven ? fmt::format("Unstable for every value that rounds to the printed "
                                                           "digits, the lone \"1\" read as 0.5 to 1.5: by Rouché and "
                                                           "Gauss-Lucas on {} pieces, smallest margin {:.3f}.",
                                                           proof.pieces, proof.smallest_margin)
                                             : "Not proved unstable for every value that rounds to its digits."),
      .does_not_hold =
          "It is unstable, so it is no model of a good valve; its steps grow without bound. No sampling "
          "time is printed, so no frequency in hertz can be claimed. `simulate` refuses it unless the "
          "horizon is finite.",
      .figures = {{"pole_re", check.largest_pole.real()},
                  {"pole_im", check.largest_pole.imag()},
                  {"largest_modulus", check.largest_modulus},
                  {"static_gain", check.static_gain},
                  {"denominator_sum", check.denominator_sum},
                  {"unstable_within_rounding", proof.proven ? 1.0 : 0.0},
                  {"rouche_margin", proof.smallest_margin}}};
}

PaperLine equation_19_line() {
  const PaperPoleCheck check = check_poles(paper_equation_19());
  const double smallest = smallest_root_product(paper_equation_19());
  return {.where = "Eq 19",
          .as_printed = "The returned valve as a discrete transfer function of order 7.",
          .recomputed = fmt::format(
              "Largest pole {:.4f}; product of the poles {:.3f}, at least {:.4f} for every value "
              "that rounds to the printed digits, so one lies outside the circle; denominator sum "
              "{:.3f}, static gain {:.4f}.",
              check.largest_pole.real(), check.pole_product, smallest, check.denominator_sum, check.static_gain),
          .does_not_hold = "It is unstable. Its static gain is negative: more current, less pressure.",
          .figures = {{"largest_pole", check.largest_modulus},
                      {"pole_product", check.pole_product},
                      {"smallest_pole_product", smallest},
                      {"denominator_sum", check.denominator_sum},
                      {"static_gain", check.static_gain}}};
}

PaperLine error_line() {
  const ErrorScaling scaling = measure_error_scaling();
  return {
      .where = "Eq 20",
      .as_printed = "Error = sqrt(sum (X_R - X_S)^2) / t; no rate, no duration, no unit.",
      .recomputed = fmt::format("Twice the rate: x {:.3f} for a residual that stays, x {:.3f} for one that dies out. "
                                "Twice the duration: x {:.3f} and x {:.3f}.",
                                scaling.stationary_by_rate, scaling.transient_by_rate, scaling.stationary_by_duration,
                                scaling.transient_by_duration),
      .does_not_hold =
          "It is no root mean square: it goes as sqrt(rate/duration) for what stays and as "
          "sqrt(rate)/duration for what dies out, so no factor converts it afterwards. It is recomputed "
          "here at the rule base's own rate and duration.",
      .figures = {{"stationary_by_rate", scaling.stationary_by_rate},
                  {"stationary_by_duration", scaling.stationary_by_duration},
                  {"transient_by_rate", scaling.transient_by_rate},
                  {"transient_by_duration", scaling.transient_by_duration}}};
}

std::size_t total(const SetCounts& counts, std::size_t set) {
  std::size_t sum = 0;
  for (const auto& verdict : counts) sum += verdict[set];
  return sum;
}

PaperLine membership_line(const LevelRules& low, const LevelRules& high) {
  const SetCounts at_low = count_largest_sets(low, true), at_high = count_largest_sets(high, false);
  const auto of = [](const SetCounts& counts, Verdict verdict, std::size_t set) {
    return counts[index_of(verdict)][set];
  };
  const auto strength = strengths_at_high(high, 1);
  const double severe_in_third = largest_error_in_set(low, Verdict::kSevere, 2);
  return {.where = "Eqs 21, 22",
          .as_printed = "Four sets on the error, two on the current; the rule table is not printed.",
          .recomputed = fmt::format(
              "High: the largest membership of {} of 40 errors is in the second set. Low: the second set "
              "holds {} of 20 good, the third {} of 10 malfunctioned and {} of 10 severe ({:.4f}). Strength "
              "of the second set at High: good {:.3f} to {:.3f}, malfunctioned {:.3f} to {:.3f}, severe "
              "{:.3f} to {:.3f}.",
              total(at_high, 1), of(at_low, Verdict::kGood, 1), of(at_low, Verdict::kMalfunctioned, 2),
              of(at_low, Verdict::kSevere, 2), severe_in_third, strength[0].smallest, strength[0].largest,
              strength[1].smallest, strength[1].largest, strength[2].smallest, strength[2].largest),
          .does_not_hold =
              "No rule table that decides by the strongest set can separate the High column. One that reads "
              "the strength of the second set could, but below 0.9 a smaller error then looks worse.",
          .figures = {{"high_in_second_set", static_cast<double>(total(at_high, 1))},
                      {"low_good_in_second_set", static_cast<double>(of(at_low, Verdict::kGood, 1))},
                      {"low_malfunctioned_in_third_set", static_cast<double>(of(at_low, Verdict::kMalfunctioned, 2))},
                      {"low_severe_in_third_set", static_cast<double>(of(at_low, Verdict::kSevere, 2))},
                      {"low_severe_error_in_third_set", severe_in_third},
                      {"second_set_good_smallest", strength[0].smallest},
                      {"second_set_malfunctioned_largest", strength[1].largest},
                      {"second_set_malfunctioned_smallest", strength[1].smallest},
                      {"second_set_severe_largest", strength[2].largest}}};
}

PaperLine crisp_line() {
  const CrispCheck check = check_crisp_ranges();
  return {
      .where = "Eq 23",
      .as_printed = "Crisp ranges after defuzzification: 1.065 and 1.535 at Low, 0.923 and 1.041 at High.",
      .recomputed = fmt::format("{} errors in {} on Table I; the largest good errors are {:.4f} (Low) and {:.4f} "
                                "(High).",
                                check.wrong, check.errors, check.largest_good_low, check.largest_good_high),
      .does_not_hold = fmt::format(
          "The ranges were set on the data they are judged on: they clear the worst good valve by {:.4f} and {:.4f}.",
          kPaperCrispLow.malfunctioned_from - check.largest_good_low,
          kPaperCrispHigh.malfunctioned_from - check.largest_good_high),
      .figures = {{"errors", static_cast<double>(check.errors)},
                  {"wrong", static_cast<double>(check.wrong)},
                  {"largest_good_low", check.largest_good_low},
                  {"largest_good_high", check.largest_good_high}}};
}

PaperLine table_line(const TableStatistics& statistics) {
  return {
      .where = "Table I",
      .as_printed = "Errors of 40 rows at two levels, \"80 sets of data\", from two returned and two good valves.",
      .recomputed = fmt::format("Ten rows of each type and condition; by Eq 23 {} of 10 returned of type 1 are Severe, "
                                "{} of 10 of type 2 Malfunctioned.",
                                statistics.returned_type_1_severe, statistics.returned_type_2_malfunctioned),
      .does_not_hold =
          "Ten rows look like repeats of one valve, four in all; type and severity cannot be told apart. "
          "Being right on it is reproduction, not evidence.",
      .figures = {{"returned_type_1_severe", static_cast<double>(statistics.returned_type_1_severe)},
                  {"returned_type_2_malfunctioned", static_cast<double>(statistics.returned_type_2_malfunctioned)}}};
}

PaperLine good_valves_line(const TableStatistics& statistics) {
  return {.where = "Table I, good valves",
          .as_printed = "Good valves err by about 1.0 at Low.",
          .recomputed =
              fmt::format("Type 1 {:.4f} with a spread of {:.1f} %, type 2 {:.4f} with {:.1f} %: {:.0f} % of the "
                          "mean error of a malfunctioned valve.",
                          statistics.good_mean_low[0], 100 * statistics.good_spread_low[0], statistics.good_mean_low[1],
                          100 * statistics.good_spread_low[1], 100 * statistics.good_over_malfunctioned_low),
          .does_not_hold =
              "An error that repeats within 1 to 2 % on good valves is the simulation's own, not the valves': "
              "most of what is fed to the classifier. Naming and removing it is what this product is for.",
          .figures = {{"good_mean_low_type_1", statistics.good_mean_low[0]},
                      {"good_mean_low_type_2", statistics.good_mean_low[1]},
                      {"good_spread_low_type_1", statistics.good_spread_low[0]},
                      {"good_spread_low_type_2", statistics.good_spread_low[1]},
                      {"good_over_malfunctioned_low", statistics.good_over_malfunctioned_low}}};
}

PaperLine figures_line() {
  return {.where = "Table II, Figures",
          .as_printed = "Memberships after defuzzification; measured and simulated responses.",
          .recomputed = "Nothing: neither the table nor the curves stand in the text.",
          .does_not_hold = "Cannot be reproduced and is not claimed."};
}

PaperLine result_line(const RuleBase& paper, const RuleBase& calibrated) {
  const TableScore printed = score_table(paper), set = score_table(calibrated);
  constexpr double kPublishedSoft = 4;
  const double published = 1 - kPublishedSoft / static_cast<double>(printed.sets);
  return {
      .where = "Result",
      .as_printed = "4 soft errors in 80 sets, \"close to 95 %\".",
      .recomputed = fmt::format("76/80 = {:.0f} %. Rule base `{}`: {} wrong and {} soft errors in {}; rule base `{}`: "
                                "{} wrong and {} soft in {}.",
                                100 * published, paper.name, printed.wrong, printed.soft, printed.sets, calibrated.name,
                                set.wrong, set.soft, set.sets),
      .does_not_hold =
          "The four soft errors cannot be traced without the rule table; on four valves no rate can be "
          "told from chance.",
      .figures = {{"published_accuracy", published},
                  {"paper_wrong", static_cast<double>(printed.wrong)},
                  {"paper_soft", static_cast<double>(printed.soft)},
                  {"calibrated_wrong", static_cast<double>(set.wrong)},
                  {"calibrated_soft", static_cast<double>(set.soft)}}};
}

// The same valve, other noise: how far the printed form's coefficients wander, and where from.
PaperLine pattern_line(const RlsBiasScene& scene, const std::vector<RlsOutcome>& outcomes) {
  double lowest = std::numeric_limits<double>::infinity(), highest = -std::numeric_limits<double>::infinity();
  for (const RlsOutcome& outcome : outcomes) {
    if (outcome.form != RlsForm::kIncremental) continue;
    lowest = std::min(lowest, outcome.a[1]);
    highest = std::max(highest, outcome.a[1]);
  }
  const double truth = true_coefficients(scene).a[1];
  return {
      .where = "Section 2.4.2",
      .as_printed = "The coefficients \"did not maintain a clear pattern\"; leakage and \"stickiness\" suspected.",
      .recomputed = fmt::format("One simulated valve without leakage or friction, the printed form of RLS, two noise "
                                "records: a1 = {:.3f} and {:.3f}, where {:.3f} is true.",
                                lowest, highest, truth),
      .does_not_hold =
          "Coefficients from that identifier say little about a valve, with or without leakage. Neither "
          "leakage nor stickiness was ever tested.",
      .figures = {{"a1_lowest", lowest}, {"a1_highest", highest}, {"a1_true", truth}}};
}

const LevelRules& level_named(const RuleBase& base, std::string_view name) {
  return *std::find_if(base.levels.begin(), base.levels.end(), [&](const LevelRules& l) { return l.name == name; });
}

}  // namespace

std::vector<PaperLine> check_paper(const RuleBase& paper, const RuleBase& calibrated) {
  const RlsBiasScene scene;
  const std::vector<RlsOutcome> outcomes = compare_rls_forms(scene, kSeeds);
  const TableStatistics statistics = table_statistics();
  return {corner_form_line(),
          rls_line(scene, outcomes),
          simulated_data_line(scene),
          bode_models_line(),
          equation_18_line(),
          equation_19_line(),
          pattern_line(scene, outcomes),
          error_line(),
          membership_line(level_named(paper, "low"), level_named(paper, "high")),
          crisp_line(),
          table_line(statistics),
          good_valves_line(statistics),
          figures_line(),
          result_line(paper, calibrated)};
}

}  // namespace valvetriage
