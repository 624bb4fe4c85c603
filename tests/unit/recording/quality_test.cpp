#include "core/recording/quality.h"

#include <gtest/gtest.h>

#include "tests/unit/recording/signals.h"

namespace valvetriage {
namespace {

TEST(Quality, NamesAConverterWithCoarseStepsAndTheirSize) {
  RawRecording raw = recorded(triangle_of(4000, 4000), 1);
  for (double& value : raw.output.values) value = 2.5 * std::round(value / 2.5);
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "quantised");
  ASSERT_NE(item, nullptr);
  EXPECT_NE(item->detail.find("steps of 2.5 psi"), std::string::npos) << item->detail;
  EXPECT_GT(item->count, 3900u);
  EXPECT_EQ(recording.quality.size(), 1u);
}

TEST(Quality, DoesNotCallAConverterCoarseThatIsFinerThanTheNoise) {
  RawRecording raw = recorded(triangle_of(4000, 4000), 1);
  for (double& value : raw.output.values) value = 0.25 * std::round(value / 0.25);
  EXPECT_TRUE(prepared(raw).quality.empty());
}

TEST(Quality, NamesCoarseStepsInPartOfTheRange) {
  RawRecording raw = recorded(triangle_of(8000, 8000), 2);
  for (double& value : raw.output.values) value = value > 120 ? 5 * std::round(value / 5) : value;
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "quantised");
  ASSERT_NE(item, nullptr);
  EXPECT_NE(item->detail.find("from 120 to 180 psi"), std::string::npos) << item->detail;
}

TEST(Quality, NamesALevelHeldOnVisitsAndRemovesNothing) {
  RawRecording raw = recorded(triangle_of(4000, 2000), 3);
  for (double& value : raw.output.values) value = std::min(value, 150.0);
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "clipped");
  ASSERT_NE(item, nullptr);
  EXPECT_NE(item->detail.find("exactly 150 psi on"), std::string::npos) << item->detail;
  EXPECT_TRUE(recording.valid.empty());
  EXPECT_EQ(recording.output.values, raw.output.values);
}

TEST(Quality, NamesAFrozenSensor) {
  RawRecording raw = recorded(steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400), 4);
  std::fill_n(raw.output.values.begin() + 500, 60, raw.output.values[500]);
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "stuck");
  ASSERT_NE(item, nullptr);
  EXPECT_EQ(item->count, 60u);
  EXPECT_NE(item->detail.find("the first after 2.5 s"), std::string::npos) << item->detail;
}

TEST(Quality, NamesAnOutputThatHasOneValueThroughout) {
  RawRecording raw = recorded(steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400), 4);
  std::ranges::fill(raw.output.values, 3.0);
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "stuck");
  ASSERT_NE(item, nullptr);
  EXPECT_EQ(item->count, recording.samples());
  EXPECT_NE(item->detail.find("exactly 3 psi throughout"), std::string::npos) << item->detail;
  EXPECT_TRUE(recording.valid.empty()) << "a valve that does not move looks the same: nothing is left out";
  const std::vector<QualityPlace> places = quality_places(recording);
  ASSERT_EQ(places.size(), 1u);
  EXPECT_EQ(places[0].end, recording.samples());
}

TEST(Quality, LeavesOutSingleOutliersButNoStepEdge) {
  RawRecording raw = recorded(steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400), 5);
  raw.output.values[333] += 40;
  raw.output.values[900] -= 40;
  raw.output.values[901] -= 35;
  const Recording recording = prepared(raw);
  const QualityItem* item = find_quality(recording, "outliers");
  ASSERT_NE(item, nullptr);
  EXPECT_EQ(item->count, 3u);
  for (const std::size_t i : {333u, 900u, 901u}) EXPECT_FALSE(recording.is_valid(i));
  EXPECT_TRUE(recording.is_valid(334));
  EXPECT_NEAR(recording.output.values[333], raw.output.values[332], 5 * 0.35);
}

TEST(Quality, DoesNotTakeTheEdgesOfAPromptOutputForOutliers) {
  const Signal u = steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 100);
  Signal y = u;
  for (double& value : y) value *= 100;
  add_noise(y, 0.35, 6);
  EXPECT_EQ(find_quality(prepared(raw_of(u, y)), "outliers"), nullptr);
}

/// A valve held at 120 psi by a PI controller against a wandering load.
RawRecording regulated(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Signal u, y;
  double pressure = 120, load = 0, integral = 1.6;
  for (int i = 0; i < 4000; ++i) {
    load = 0.995 * load + 0.4 * normal(random);
    const double measured = pressure + load + 0.35 * normal(random);
    integral -= 0.0005 * (measured - 120);
    u.push_back(integral - 0.003 * (measured - 120));
    y.push_back(measured);
    pressure += (150 * (u.back() - 0.8) - pressure) * 0.08;
  }
  return raw_of(std::move(u), std::move(y));
}

TEST(Quality, TellsAControllerFromAPlant) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    EXPECT_NE(find_quality(prepared(regulated(seed)), "feedback"), nullptr) << "seed " << seed;
    Signal white(4000, 1.6);
    add_noise(white, 0.1, seed);
    EXPECT_EQ(find_quality(prepared(recorded(white, seed)), "feedback"), nullptr) << "seed " << seed;
  }
}

TEST(QualityPlaces, AreWhereASensorFroze) {
  RawRecording raw = recorded(steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400), 4);
  std::fill_n(raw.output.values.begin() + 500, 60, raw.output.values[500]);
  const std::vector<QualityPlace> places = quality_places(prepared(raw));
  ASSERT_EQ(places.size(), 1u);
  EXPECT_EQ(places[0].code, "stuck");
  EXPECT_EQ(places[0].begin, 500u);
  EXPECT_EQ(places[0].end, 560u);
}

TEST(QualityPlaces, TellAGapFromAnOutlierThatWasLeftOut) {
  RawRecording raw = recorded(steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400), 4);
  raw.output.values[700] += 300;
  for (std::vector<double>* column : {&raw.time.values, &raw.input.values, &raw.output.values}) {
    column->erase(column->begin() + 300, column->begin() + 340);
  }
  const std::vector<QualityPlace> places = quality_places(prepared(raw));
  ASSERT_EQ(places.size(), 2u);
  EXPECT_EQ(places[0].code, "gap");
  EXPECT_EQ(places[0].begin, 300u);
  EXPECT_EQ(places[0].end, 340u);
  EXPECT_EQ(places[1].code, "outliers");
  EXPECT_EQ(places[1].begin, 700u);
  EXPECT_EQ(places[1].end, 701u);
}

TEST(QualityPlaces, AreEveryVisitToALevelThatIsHeld) {
  RawRecording raw = recorded(triangle_of(4000, 2000), 3);
  for (double& value : raw.output.values) value = std::min(value, 150.0);
  const Recording recording = prepared(raw);
  const std::vector<QualityPlace> places = quality_places(recording);
  ASSERT_EQ(places.size(), 2u);
  std::size_t samples = 0;
  for (const QualityPlace& place : places) {
    EXPECT_EQ(place.code, "clipped");
    samples += place.end - place.begin;
    for (std::size_t i = place.begin; i < place.end; ++i) EXPECT_EQ(recording.output.values[i], 150.0);
  }
  EXPECT_EQ(samples, find_quality(recording, "clipped")->count);
}

TEST(QualityPlaces, OfARecordingWithoutItemsAreNone) {
  EXPECT_TRUE(quality_places(prepared(recorded(steps_of({1.0, 1.4, 1.0}, 400), 1))).empty());
}

}  // namespace
}  // namespace valvetriage
