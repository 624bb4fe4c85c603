#include "server/report/sentence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace valvetriage::report {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

NamedCause sticking() {
  NamedCause cause{.cause = "friction", .family = "memory", .origin = "valve", .probability = 0.97};
  cause.parameters.emplace_back(
      "breakaway_A", ParameterEstimate{.value = 0.0183, .std_error = 0.0004, .ci95 = {0.0175, 0.0191}, .unit = "A"});
  return cause;
}

Analysis with(Conclusion conclusion, std::vector<NamedCause> causes = {}) {
  Analysis analysis;
  analysis.baseline.model.output_unit = "psi";
  analysis.discrepancy.emplace();
  analysis.discrepancy->conclusion = conclusion;
  analysis.discrepancy->causes = std::move(causes);
  analysis.discrepancy->gain = {.heldout = "each recording in turn",
                                .rmse_baseline = 2.4,
                                .rmse_extended = 0.4,
                                .rmse_black_box = kNone,
                                .noise_floor = 0.35};
  return analysis;
}

TEST(Sentence, OfANamedCauseSaysWhatIsWrongHowSurelyAndHowMuch) {
  const Summary summary = summarise(with(Conclusion::kNamed, {sticking()}));
  EXPECT_EQ(summary.discrepancy, "The simulation is wrong because it lacks friction.");
  EXPECT_EQ(summary.fault, "It is the valve's fault.");
  ASSERT_EQ(summary.causes.size(), 1u);
  EXPECT_EQ(summary.causes[0],
            "Friction: sticks until the force difference passes breakaway, then slips (stiction, Coulomb). Probability "
            "97 %. Breakaway 18.30 mA (95 %: 17.50 to 19.10 mA).");
  EXPECT_EQ(summary.gain,
            "On data it was not fitted to (each recording in turn), the simulation's error goes from 2.4 psi to 0.4 "
            "psi; noise alone is 0.35 psi.");
}

TEST(Sentence, OfAValveThatIsNotGoodDoesNotSayThatNothingIsWrong) {
  Analysis analysis = with(Conclusion::kNone);
  analysis.baseline.kind = BaselineKind::kReference;
  const std::string of_a_good_one = "The simulation leaves nothing that a good valve on this stand would not leave.";
  EXPECT_EQ(summarise(analysis).discrepancy, of_a_good_one);
  analysis.classification.verdict = "Good";
  EXPECT_EQ(summarise(analysis).discrepancy, of_a_good_one);
  analysis.classification.verdict = "Malfunctioned";
  const std::string sentence = summarise(analysis).discrepancy;
  EXPECT_TRUE(sentence.starts_with("No single fault stands out: ")) << sentence;
  EXPECT_NE(sentence.find("The verdict Malfunctioned rests on the steps"), std::string::npos) << sentence;
}

TEST(Sentence, OfWhatNoCauseExplainsSaysHowMuchIsLeftAboveTheNoise) {
  Analysis analysis = with(Conclusion::kNone);
  const auto told = [&](BaselineKind kind, double rmse) {
    analysis.baseline.kind = kind;
    analysis.simulation.rmse = analysis.discrepancy->gain.rmse_baseline = rmse;
    analysis.simulation.noise_floor = analysis.discrepancy->gain.noise_floor = 0.31;
    return summarise(analysis).discrepancy;
  };
  const auto tells_figures = [&](const std::string& sentence) {
    return sentence.find("1.99 psi where the noise is 0.31 psi") != std::string::npos;
  };
  for (const BaselineKind kind : {BaselineKind::kSelf, BaselineKind::kPaper}) {
    EXPECT_EQ(told(kind, 0.32),
              "A linear model of these recordings follows them down to the noise: nothing is left to explain.");
    EXPECT_TRUE(tells_figures(told(kind, 1.99))) << told(kind, 1.99);
    EXPECT_EQ(told(kind, kNone), "No known cause was found.");
  }
  EXPECT_EQ(told(BaselineKind::kReference, 0.32).find("where the noise is"), std::string::npos);
  EXPECT_TRUE(tells_figures(told(BaselineKind::kReference, 1.99))) << told(BaselineKind::kReference, 1.99);
  analysis.classification.verdict = "Severe";
  EXPECT_NE(told(BaselineKind::kReference, 0.32).find("down to the noise"), std::string::npos);
  EXPECT_TRUE(tells_figures(told(BaselineKind::kReference, 1.99))) << told(BaselineKind::kReference, 1.99);
}

TEST(Sentence, OfACauseInAGoodValveSaysWhyTheVerdictStands) {
  Analysis analysis = with(Conclusion::kNamed, {sticking()});
  analysis.classification.verdict = "Severe";
  EXPECT_EQ(summarise(analysis).fault, "It is the valve's fault.");
  for (const Conclusion conclusion : {Conclusion::kNamed, Conclusion::kAmbiguous, Conclusion::kUnexplained}) {
    analysis.discrepancy->conclusion = conclusion;
    analysis.classification.verdict = "Good";
    const std::string sentence = summarise(analysis).fault;
    EXPECT_NE(sentence.find("The verdict Good stands beside it"), std::string::npos) << sentence;
  }
}

TEST(Sentence, OfAnAmbiguousResultSaysWhatToTestNextOrThatNoTestWouldSettleIt) {
  Analysis analysis = with(Conclusion::kAmbiguous, {sticking()});
  EXPECT_EQ(summarise(analysis).next_test, "No test that is known here is expected to settle it.");
  analysis.discrepancy->next_test = NextTest{.test = "triangle in 3 s", .expected_probability = 0.8};
  EXPECT_EQ(summarise(analysis).next_test,
            "Next test: triangle in 3 s. It is expected to settle the cause with a probability of 80 %.");
  analysis.discrepancy->next_test->expected_probability = 0.02;
  EXPECT_EQ(summarise(analysis).next_test,
            "Next test: triangle in 3 s. It is not expected to settle the cause, but to leave fewer rivals.");
  EXPECT_EQ(summarise(with(Conclusion::kNamed, {sticking()})).next_test, "");
}

TEST(Sentence, TellsTheUnitOfAParameterOnceBehindItsNumber) {
  NamedCause cause = sticking();
  cause.parameters.emplace_back("growth_per_A", ParameterEstimate{.value = 0.5, .ci95 = {0.4, 0.6}, .unit = "1/A"});
  const std::string sentence = summarise(with(Conclusion::kNamed, {cause})).causes.at(0);
  EXPECT_NE(sentence.find("; growth 0.5 1/A (95 %: 0.4 to 0.6 1/A)."), std::string::npos) << sentence;
}

TEST(Sentence, LeavesOutWhereALoopHappenedToBegin) {
  NamedCause loop{.cause = "hysteresis", .family = "memory", .origin = "valve", .probability = 0.99};
  for (const char* name : {"width_A", "memory"}) {
    loop.parameters.emplace_back(name, ParameterEstimate{.value = 0.5, .ci95 = {0.4, 0.6}});
  }
  const std::string sentence = summarise(with(Conclusion::kNamed, {loop})).causes.at(0);
  EXPECT_NE(sentence.find("Width 0.5 (95 %: 0.4 to 0.6)."), std::string::npos) << sentence;
  EXPECT_EQ(sentence.find("memory 0.5"), std::string::npos) << sentence;
}

TEST(Sentence, WritesNumbersOfATableWithTheirZerosAndWithoutPowersOfTen) {
  EXPECT_EQ(figure(4.1), "4.10");
  EXPECT_EQ(figure(27), "27.0");
  EXPECT_EQ(figure(118), "118");
  EXPECT_EQ(figure(9.999), "10.0");
  EXPECT_EQ(figure(999.7), "1000");
  EXPECT_EQ(figure(-12345.6), "-12346");
  EXPECT_EQ(figure(0.00052), "0.000520");
  EXPECT_EQ(figure(0), "0");
  EXPECT_EQ(figure(2.5e-7), "2.50e-07");
  EXPECT_EQ(figure(kNone), "–");
  EXPECT_EQ(quantity(1234.4, "psi"), "1234 psi");
}

TEST(Sentence, OfAnAbruptChangeNamesTheRecordingItIsIn) {
  NamedCause change{.cause = "intermittent", .family = "slow", .origin = "either", .probability = 0.99};
  change.parameters.emplace_back("recording", ParameterEstimate{.value = 1, .ci95 = {1, 1}});
  Analysis analysis = with(Conclusion::kNamed, {change});
  analysis.recordings = {{.name = "step.csv"}, {.name = "triangle.csv"}};
  const Summary summary = summarise(analysis);
  EXPECT_EQ(summary.discrepancy, "The simulation is wrong because it lacks an abrupt change of gain.");
  EXPECT_NE(summary.causes[0].find("In triangle.csv."), std::string::npos) << summary.causes[0];
}

TEST(Sentence, OfAnAmbiguousResultNamesAllRivalsAndWhoseFaultEachWouldBe) {
  NamedCause cause = sticking();
  cause.alternatives = {"backlash", "dead_band"};
  const Summary summary = summarise(with(Conclusion::kAmbiguous, {cause}));
  EXPECT_NE(summary.discrepancy.find("do not settle what"), std::string::npos);
  EXPECT_NE(summary.causes[0].find("The recordings do not tell it from backlash or dead band."), std::string::npos);
  EXPECT_EQ(summary.fault, "Each cause that is left would be the valve's fault.");
  cause.alternatives = {"sensor_offset"};
  EXPECT_EQ(summarise(with(Conclusion::kAmbiguous, {cause})).fault,
            "Whether it is the valve's fault or the stand's is not settled either.");
  cause.alternatives = {};
  EXPECT_EQ(summarise(with(Conclusion::kAmbiguous, {cause})).fault, "");
}

TEST(Sentence, OfAnUnexplainedResultSaysThatItIsNotKnown) {
  const Summary summary = summarise(with(Conclusion::kUnexplained));
  EXPECT_NE(summary.discrepancy.find("It is not known what"), std::string::npos);
  EXPECT_EQ(summary.fault + summary.gain, "");
  EXPECT_EQ(summary.discrepancy.find("What comes closest"), std::string::npos);
  const std::string with_a_cause = summarise(with(Conclusion::kUnexplained, {sticking()})).discrepancy;
  EXPECT_NE(with_a_cause.find("What comes closest is listed, and is not the answer."), std::string::npos)
      << with_a_cause;
}

TEST(Sentence, OfAFaultThatTheFitTakesUpSaysWhichParameterIsOdd) {
  Analysis analysis = with(Conclusion::kUnexplained);
  analysis.discrepancy->findings.push_back(
      {.what = "delay_s above good valves' by 17 of their standard deviations", .where = std::string(kOwnParameters)});
  const Summary summary = summarise(analysis);
  EXPECT_NE(summary.discrepancy.find("no good valve has: delay_s above good valves' by 17"), std::string::npos)
      << summary.discrepancy;
  EXPECT_NE(summary.discrepancy.find("do not read a cause into this"), std::string::npos);
}

TEST(Sentence, OfANameThatABetterAccountTookTellsTheAccount) {
  Analysis analysis = with(Conclusion::kUnexplained, {sticking()});
  analysis.discrepancy->findings.push_back({.what = "air in the fluid above good valves' explains more than friction",
                                            .where = std::string(kOwnParameters)});
  EXPECT_EQ(summarise(analysis).discrepancy,
            "Something is wrong that no known cause explains: air in the fluid above good valves' explains more than "
            "friction. It is not known why; do not read a cause into this result. What comes closest is listed, and is "
            "not the answer.");
}

TEST(Sentence, OfAChangeThatHasNoNameTellsWhatIsSeenOfIt) {
  Analysis analysis = with(Conclusion::kUnexplained);
  analysis.discrepancy->findings.push_back(
      {.what = "0.2 % of the output follows some 5 s late", .where = std::string(kUnnamedChange)});
  EXPECT_EQ(summarise(analysis).discrepancy,
            "Something is wrong that no known cause explains: 0.2 % of the output follows some 5 s late. It is not "
            "known why; do not read a cause into this result.");
}

TEST(Sentence, OfRecordingsThatNoValveMakesSaysWhatToCheck) {
  Analysis analysis = with(Conclusion::kUnexplained);
  analysis.discrepancy->findings.push_back(
      {.what = "pressure falls: check its sign", .where = std::string(kStaticMap)});
  const Summary summary = summarise(analysis);
  EXPECT_NE(summary.discrepancy.find("pressure falls: check its sign."), std::string::npos) << summary.discrepancy;
  EXPECT_EQ(summary.discrepancy.find("It is not known what"), std::string::npos);
}

TEST(Sentence, TellsTheStandsFaultFromTheValves) {
  NamedCause offset{.cause = "sensor_offset", .family = "slow", .origin = "stand", .probability = 0.99};
  EXPECT_EQ(summarise(with(Conclusion::kNamed, {offset})).fault, "It is the stand's fault, not the valve's.");
  EXPECT_EQ(summarise(with(Conclusion::kNamed, {offset, sticking()})).fault,
            "Partly it is the valve's fault, partly the stand's.");
  NamedCause delay{.cause = "transport_delay", .family = "timing", .origin = "either", .probability = 0.99};
  EXPECT_EQ(summarise(with(Conclusion::kNamed, {delay})).fault, "It can be the valve's fault or the stand's.");
}

TEST(Sentence, OfAVerdictSaysWhatToDoAndWhatTheStandIsToBlameFor) {
  Analysis analysis = with(Conclusion::kNone);
  analysis.classification.verdict = "Malfunctioned";
  analysis.classification.explanation = "at 1.4 A";
  analysis.classification.action = "retest";
  analysis.classification.without_stand_causes = "Good";
  EXPECT_EQ(summarise(analysis).verdict,
            "Malfunctioned: at 1.4 A. Without what is the stand's fault it would be Good. Test the valve again.");
}

TEST(Sentence, SaysWhatTheRecordingsExclude) {
  Analysis analysis = with(Conclusion::kNone);
  analysis.discrepancy->candidates = {{.cause = "friction",
                                       .status = CandidateStatus::kTested,
                                       .reason = "",
                                       .upper_limit95 = {{"breakaway_A", 0.006}}}};
  EXPECT_EQ(summarise(analysis).upper_limits,
            std::vector<std::string>{"Friction with breakaway above 6 mA is excluded"});
}

TEST(Sentence, SaysOnWhichSideOfALimitASizeIsExcluded) {
  Analysis analysis = with(Conclusion::kNone);
  Candidate gain{.cause = "gain_loss"}, level{.cause = "saturation"};
  gain.upper_limit95["ratio"] = 0.97;
  level.upper_limit95["level_psi"] = 200;
  analysis.discrepancy->candidates = {gain, level};
  EXPECT_EQ(summarise(analysis).upper_limits,
            (std::vector<std::string>{"Gain loss with ratio below 0.97 is excluded",
                                      "Saturation with level below 200 psi is excluded"}));
}

TEST(Quantity, UsesTheUnitAPersonWould) {
  EXPECT_EQ(quantity(0.0183, "A"), "18.3 mA");
  EXPECT_EQ(quantity(1.8, "A"), "1.8 A");
  EXPECT_EQ(quantity(0, "s"), "0 s");
  EXPECT_EQ(quantity(0.0125, "psi"), "0.0125 psi");
  EXPECT_EQ(quantity(-2.5, ""), "-2.5");
  EXPECT_EQ(quantity(kNone, "psi"), "unknown");
}

TEST(Estimate, SaysAsMuchAsTwoDigitsOfItsErrorTellInOneUnit) {
  // A place is known a thousand times better than its size: three digits would hide it.
  const EstimateWords centre =
      estimate_words({.value = 1.634712, .std_error = 0.000526, .ci95 = {1.63366, 1.63576}, .unit = "A"});
  EXPECT_EQ(centre.value, "1.63471 A");
  EXPECT_EQ(centre.error, "0.00053 A");
  EXPECT_EQ(centre.interval, "1.63366 to 1.63576 A");
  const EstimateWords width =
      estimate_words({.value = 0.0957, .std_error = 0.0049, .ci95 = {0.0859, 0.1055}, .unit = "A"});
  EXPECT_EQ(width.value, "95.7 mA");
  EXPECT_EQ(width.interval, "85.9 to 105.5 mA");
  const EstimateWords none = estimate_words({.value = 0, .std_error = 0.0004, .ci95 = {-0.0008, 0.0008}, .unit = "A"});
  EXPECT_EQ(none.value, "0.00 mA");
  EXPECT_EQ(none.interval, "-0.80 to 0.80 mA");
  EXPECT_EQ(estimate_words({.value = 120.4, .std_error = 0, .ci95 = {120.4, kNone}, .unit = "psi"}).interval, "");
  EXPECT_EQ(estimate_words({.value = 120.4, .std_error = 0, .unit = "psi"}).value, "120 psi");
  EXPECT_EQ(estimate_words({.value = 6.84e-8, .std_error = 1e-9, .unit = "1/psi2"}).value, "6.84e-08 1/psi2");
  EXPECT_EQ(with_deviation(0, 0.000244, "A"), "0.00 ± 0.24 mA");
  EXPECT_EQ(with_deviation(-1e-5, 0.000244, "A"), "-0.01 ± 0.24 mA");
  EXPECT_EQ(with_deviation(-1e-7, 0.000244, "A"), "0.00 ± 0.24 mA");
}

TEST(Percent, NeverClaimsCertainty) {
  EXPECT_EQ(percent(1), "over 99 %");
  EXPECT_EQ(percent(0), "under 1 %");
  EXPECT_EQ(percent(0.5), "50 %");
}

}  // namespace
}  // namespace valvetriage::report
