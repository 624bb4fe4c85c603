#include "core/identify/response_order.h"

#include <gtest/gtest.h>

#include "core/identify/identification.h"
#include "tests/unit/identify/responses.h"

namespace valvetriage {
namespace {

using test::plant_s;
using test::response_of;

TEST(ResponseOrder, IsThatOfThePlant) {
  const auto plant = plant_s(470, {2.4}, {{25, 0.3}}, {10}, 0.003);
  const auto choice = choose_response_order(response_of(plant, 0.2, 80, 100, 0.01, 1), {}).value();
  EXPECT_EQ(choice.model.transfer_function.poles.size(), 3u) << choice.reason;
  EXPECT_EQ(choice.model.transfer_function.zeros.size(), 1u);
  ASSERT_EQ(choice.tried.size(), 9u);
  EXPECT_GT(choice.tried[1].rmse_heldout, 2 * choice.tried[2].rmse_heldout);
  EXPECT_TRUE(choice.notes.empty());
}

TEST(ResponseOrder, AskedForIsTakenAndTheNoteSaysThatLessWouldDo) {
  const auto plant = plant_s(470, {2.4}, {{25, 0.3}}, {10}, 0.003);
  const auto choice = choose_response_order(response_of(plant, 0.2, 80, 100, 0.01, 2), {.order = 7}).value();
  EXPECT_EQ(choice.model.transfer_function.poles.size(), 7u);
  ASSERT_FALSE(choice.notes.empty());
  EXPECT_NE(choice.notes[0].find("do not support order 7"), std::string::npos) << choice.notes[0];
}

TEST(ResponseOrder, OfALagIsOneWhateverTheNoise) {
  // Higher orders find noise to sit on, at 46 points of some seeds even a held-out one.
  for (const std::uint32_t seed : {1u, 2u, 8u}) {
    const auto response = response_of(plant_s(470, {2.4}, {}, {}, 0.005), 0.2, 17, 46, 0.005, seed);
    const auto choice = choose_response_order(response, {}).value();
    EXPECT_EQ(choice.model.transfer_function.poles.size(), 1u) << "seed " << seed << ": " << choice.reason;
  }
}

TEST(ResponseOrder, OfFewPointsIsRefused) {
  const auto response = response_of(plant_s(1, {3}, {}), 0.2, 50, 8, 0.01, 1);
  EXPECT_EQ(choose_response_order(response, {.order = 9}).error().code, "too_few_points");
}

TEST(ResponseOrder, OfRealCornersIsFoundFromTheGainAlone) {
  const auto plant = plant_s(1, {0.5, 12}, {}, {3});
  const auto choice = choose_response_order(response_of(plant, 0.05, 100, 90, 0.005, 1),
                                            {.kind = ResponseModelKind::kAsymptotic, .largest_order = 4})
                          .value();
  EXPECT_EQ(choice.model.transfer_function.poles.size(), 2u) << choice.reason;
  EXPECT_EQ(choice.model.transfer_function.zeros.size(), 1u);
}

TEST(Identify, ByResponseRunsFreelyAsWellAsTheNoiseAllows) {
  const auto plant = plant_s(470, {2.4}, {{25, 0.75}}, {}, 0.004);
  const auto recording = test::recording_of(plant, test::swept_sine(2400, 200, 0.5, 40, 0.1), 200, 0.35);
  const Recording* const one[] = {&recording};
  const auto found = identify(one, {.method = IdentificationMethod::kRational, .order = 4}).value();
  ASSERT_TRUE(found.run);
  EXPECT_LT(found.run->rmse, 0.37);
  EXPECT_TRUE(found.stable);
  EXPECT_EQ(found.transfer_function.domain, Domain::kS);
  EXPECT_NEAR(found.static_gain, 470, 5);
  const auto paper = identify(one, {.method = IdentificationMethod::kAsymptotic, .order = 3}).value();
  ASSERT_TRUE(paper.frequency && paper.frequency->model.steps);
  EXPECT_LT(paper.frequency->model.steps->v, paper.frequency->model.steps->v_start);
}

}  // namespace
}  // namespace valvetriage
