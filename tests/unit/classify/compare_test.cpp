#include "core/classify/compare.h"

#include <gtest/gtest.h>

#include "core/classify/rivals/anfis.h"
#include "core/classify/rivals/pc_knn.h"
#include "core/classify/rivals/possibilistic_c_means.h"
#include "core/classify/rivals/self_organising_map.h"
#include "tests/unit/classify/table_one.h"

namespace valvetriage {
namespace {

TrainingSet table_one_features() {
  TrainingSet set{Eigen::MatrixXd(Eigen::Index(kPaperTable.size()), 2), {}};
  for (std::size_t i = 0; i < kPaperTable.size(); ++i) {
    set.features.row(Eigen::Index(i)) << kPaperTable[i].error_low, kPaperTable[i].error_high;
    set.verdicts.push_back(kPaperTable[i].verdict());
  }
  return set;
}

class Rivals : public testing::TestWithParam<RivalClassifier (*)(const TrainingSet&)> {};

TEST_P(Rivals, LearnTheirOwnWellSeparatedTrainingValves) {
  const TrainingSet set = table_one_features();
  const RivalClassifier rival = GetParam()(set);
  for (Eigen::Index i = 0; i < set.features.rows(); ++i) {
    const auto prediction = rival(set.features.row(i).transpose());
    EXPECT_EQ(prediction.verdict, set.verdicts[std::size_t(i)]) << "row " << i;
    EXPECT_EQ(largest_membership(prediction.memberships), prediction.verdict);
  }
}

TEST_P(Rivals, GiveTheSameAnswerWhenTrainedAgain) {
  const TrainingSet set = table_one_features();
  const Eigen::VectorXd between = (set.features.row(5) + set.features.row(35)).transpose() / 2;
  EXPECT_EQ(GetParam()(set)(between).memberships, GetParam()(set)(between).memberships);
}

TEST_P(Rivals, KeepDegreesBetweenZeroAndOneFarAway) {
  const RivalClassifier rival = GetParam()(table_one_features());
  for (const double far : {-100.0, 0.0, 100.0}) {
    for (const double degree : rival(Eigen::Vector2d(far, -far)).memberships) {
      EXPECT_GE(degree, 0);
      EXPECT_LE(degree, 1 + 1e-12);  // shares that add up to 1 in double arithmetic
    }
  }
}

TEST_P(Rivals, BearAFeatureThatDoesNotVary) {
  TrainingSet set = table_one_features();
  set.features.conservativeResize(Eigen::NoChange, 3);
  set.features.col(2).setConstant(7);
  EXPECT_EQ(GetParam()(set)(set.features.row(0).transpose()).verdict, Verdict::kGood);
}

INSTANTIATE_TEST_SUITE_P(All, Rivals,
                         testing::Values([](const TrainingSet& s) { return train_pc_knn(s); },
                                         [](const TrainingSet& s) { return train_possibilistic_c_means(s); },
                                         [](const TrainingSet& s) { return train_self_organising_map(s); },
                                         [](const TrainingSet& s) { return train_anfis(s); }));

TEST(CompareClassifiers, ClassifiesEveryValveOncePerRepeat) {
  const auto comparison = compare_classifiers(test::table_one(), {.folds = 5, .repeats = 2}).value();
  ASSERT_EQ(comparison.scores.size(), 5u);
  EXPECT_EQ(comparison.features, 2u);
  for (const ClassifierScore& score : comparison.scores) EXPECT_EQ(score.predictions, 80u) << score.name;
}

TEST(CompareClassifiers, FuzzyRuleBaseHasNoErrorOnHeldOutRowsOfTableOne) {
  const auto comparison = compare_classifiers(test::table_one()).value();
  const ClassifierScore& fuzzy = comparison.scores.front();
  EXPECT_EQ(fuzzy.name, "fuzzy rule base");
  EXPECT_EQ(fuzzy.right, fuzzy.predictions);
  EXPECT_EQ(fuzzy.soft + fuzzy.hard, 0u);
}

TEST(CompareClassifiers, IsTheSameTableForTheSameSeed) {
  const auto once = compare_classifiers(test::table_one(), {.repeats = 2, .seed = 7}).value();
  const auto again = compare_classifiers(test::table_one(), {.repeats = 2, .seed = 7}).value();
  for (std::size_t i = 0; i < once.scores.size(); ++i) {
    EXPECT_EQ(once.scores[i].right, again.scores[i].right);
    EXPECT_EQ(once.scores[i].soft, again.scores[i].soft);
  }
}

TEST(CompareClassifiers, NeedsFourValvesOfEveryClass) {
  auto valves = test::table_one();
  const auto keep = [&](int most) {
    int seen = 0;
    std::erase_if(valves, [&](const LabelledValve& v) { return v.verdict == Verdict::kSevere && ++seen > most; });
  };
  keep(4);
  EXPECT_TRUE(compare_classifiers(valves, {.repeats = 1}));
  keep(3);
  EXPECT_EQ(compare_classifiers(valves, {.repeats = 1}).error().code, "too_few_labels");
}

}  // namespace
}  // namespace valvetriage
