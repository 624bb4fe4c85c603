#include "core/analysis/outside_reference.h"

#include <gtest/gtest.h>

namespace valvetriage {
namespace {

Recording with_inputs(std::vector<double> inputs) {
  Recording recording;
  recording.input.values = std::move(inputs);
  recording.output.values.assign(recording.input.values.size(), 0.0);
  recording.time_s.assign(recording.input.values.size(), 0.0);
  return recording;
}

const Reference kReference{.input_min = 1.0, .input_max = 2.0};

TEST(OutsideReference, BeginsBeyondTheReachOfTheEndKnots) {
  EXPECT_FALSE(outside_reference(kReference, 2.0125));
  EXPECT_TRUE(outside_reference(kReference, 2.02));
  EXPECT_FALSE(outside_reference(kReference, 0.99));
  EXPECT_TRUE(outside_reference(kReference, 0.9));
}

TEST(OutsideReference, BeginsSoonerOnValvesOfSmallCurrents) {
  Reference small{.input_min = 0.1, .input_max = 0.2};
  small.model.loop = MagneticLoop{.reach = 0.1};
  EXPECT_FALSE(outside_reference(small, 0.2012));
  EXPECT_TRUE(outside_reference(small, 0.202));
}

TEST(OutsideReferencePlaces, AreStretchesThatNoiseDoesNotCutToPieces) {
  std::vector<double> inputs(100, 1.5);
  for (std::size_t i = 20; i < 40; ++i) inputs[i] = i == 30 ? 2.0 : 2.1;
  inputs[90] = 0.5;
  const auto places = outside_reference_places(with_inputs(inputs), kReference);
  ASSERT_EQ(places.size(), 2u);
  EXPECT_EQ(places[0].code, "outside_reference");
  EXPECT_EQ(places[0].begin, 20u);
  EXPECT_EQ(places[0].end, 40u);
  EXPECT_EQ(places[1].begin, 90u);
  EXPECT_EQ(places[1].end, 91u);
}

}  // namespace
}  // namespace valvetriage
