#include "core/classify/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "core/classify/rivals/anfis.h"
#include "core/classify/rivals/pc_knn.h"
#include "core/classify/rivals/possibilistic_c_means.h"
#include "core/classify/rivals/self_organising_map.h"

namespace valvetriage {
namespace {

constexpr std::size_t kFewestPerClass = 3;

/// A classifier as the comparison sees it: valves in, a classifier of valves out.
using Predict = std::function<Result<RivalPrediction>(std::size_t valve)>;
using Train = std::function<Result<Predict>(const std::vector<std::size_t>& training)>;

struct Contender {
  std::string name;
  Train train;
};

/// The features that every valve has, n × p.
Eigen::MatrixXd complete_features(std::span<const LabelledValve> valves) {
  std::vector<Eigen::VectorXd> columns;
  for (const LevelFeatures& first : valves.front().levels) {
    for (const Quantity quantity : kQuantities) {
      Eigen::VectorXd column(Eigen::Index(valves.size()));
      bool complete = true;
      for (std::size_t v = 0; v < valves.size() && complete; ++v) {
        const auto& levels = valves[v].levels;
        const auto same = [&](const LevelFeatures& f) { return std::abs(f.level_a - first.level_a) < kLevelTolerance; };
        const auto level = std::find_if(levels.begin(), levels.end(), same);
        const auto value = level == levels.end() ? std::nullopt : value_of(*level, quantity);
        complete = value.has_value();
        column(Eigen::Index(v)) = value.value_or(0);
      }
      if (complete) columns.push_back(std::move(column));
    }
  }
  Eigen::MatrixXd features(Eigen::Index(valves.size()), Eigen::Index(columns.size()));
  for (std::size_t c = 0; c < columns.size(); ++c) features.col(Eigen::Index(c)) = columns[c];
  return features;
}

Train train_fuzzy(std::span<const LabelledValve> valves) {
  return [valves](const std::vector<std::size_t>& training) -> Result<Predict> {
    std::vector<LabelledValve> kept;
    for (const std::size_t v : training) kept.push_back(valves[v]);
    auto learned = learn_rule_base(kept, {});
    if (!learned) return tl::unexpected(learned.error());
    return [valves, base = std::move(learned->base)](std::size_t v) -> Result<RivalPrediction> {
      const auto classified = classify(base, valves[v].levels);
      if (!classified) return tl::unexpected(classified.error());
      if (!classified->verdict) return fail("level_missing", "a level is missing");
      return RivalPrediction{*classified->verdict, classified->memberships};
    };
  };
}

template <typename TrainRival>
Train train_rival(std::span<const LabelledValve> valves, const Eigen::MatrixXd& features, TrainRival train) {
  return [=](const std::vector<std::size_t>& training) -> Result<Predict> {
    TrainingSet set{Eigen::MatrixXd(Eigen::Index(training.size()), features.cols()), {}};
    for (std::size_t i = 0; i < training.size(); ++i) {
      set.features.row(Eigen::Index(i)) = features.row(Eigen::Index(training[i]));
      set.verdicts.push_back(valves[training[i]].verdict);
    }
    return [features, rival = train(set)](std::size_t v) -> Result<RivalPrediction> {
      return rival(features.row(Eigen::Index(v)).transpose());
    };
  };
}

std::vector<Contender> contenders(std::span<const LabelledValve> valves, const Eigen::MatrixXd& features) {
  const auto rival = [&](auto train) { return train_rival(valves, features, train); };
  return {{"fuzzy rule base", train_fuzzy(valves)},
          {"PC-kNN", rival([](const TrainingSet& set) { return train_pc_knn(set); })},
          {"possibilistic c-means", rival([](const TrainingSet& set) { return train_possibilistic_c_means(set); })},
          {"self-organising map", rival([](const TrainingSet& set) { return train_self_organising_map(set); })},
          {"ANFIS", rival([](const TrainingSet& set) { return train_anfis(set); })}};
}

/// The fold of every valve, each class dealt out in shuffled order.
std::vector<int> stratified_folds(std::span<const LabelledValve> valves, int folds, std::mt19937& random) {
  std::vector<int> fold(valves.size());
  int next = 0;
  for (const Verdict verdict : kVerdicts) {
    std::vector<std::size_t> members;
    for (std::size_t v = 0; v < valves.size(); ++v) {
      if (valves[v].verdict == verdict) members.push_back(v);
    }
    // Fisher-Yates by hand: std::shuffle may differ between standard libraries, a table must not.
    for (std::size_t i = members.size(); i > 1; --i) std::swap(members[i - 1], members[random() % i]);
    for (const std::size_t v : members) fold[v] = next++ % folds;
  }
  return fold;
}

void score_fold(const Contender& contender, std::span<const LabelledValve> valves, const std::vector<int>& folds,
                int fold, ClassifierScore& score) {
  std::vector<std::size_t> training;
  for (std::size_t v = 0; v < valves.size(); ++v) {
    if (folds[v] != fold) training.push_back(v);
  }
  const auto predict = contender.train(training);
  if (!predict) return;
  for (std::size_t v = 0; v < valves.size(); ++v) {
    if (folds[v] != fold) continue;
    const auto prediction = (*predict)(v);
    if (!prediction) continue;
    const Verdict truth = valves[v].verdict;
    ++score.predictions;
    score.right += prediction->verdict == truth;
    score.soft += is_soft_error(truth, prediction->verdict, prediction->memberships);
    score.hard += is_hard_error(truth, prediction->verdict);
  }
}

/// Every class must keep kFewestPerClass valves when the largest share of it is held out.
Result<void> require_enough(std::span<const LabelledValve> valves, int folds) {
  for (const Verdict verdict : kVerdicts) {
    const auto is_it = [&](const LabelledValve& valve) { return valve.verdict == verdict; };
    const auto n = std::size_t(std::count_if(valves.begin(), valves.end(), is_it));
    const std::size_t held_out = (n + std::size_t(folds) - 1) / std::size_t(folds);
    if (n > 0 && n - held_out < kFewestPerClass) {
      return fail("too_few_labels", fmt::format("{} valves labelled {}: {} folds need at least {}", n,
                                                to_string(verdict), folds, kFewestPerClass + 1));
    }
  }
  return {};
}

}  // namespace

Result<Comparison> compare_classifiers(std::span<const LabelledValve> valves, const CompareOptions& options) {
  if (auto enough = require_enough(valves, options.folds); !enough) return tl::unexpected(enough.error());
  // What cannot be learned from all valves cannot be learned from fewer: the sentence for the user comes from here.
  if (auto all = learn_rule_base(valves, {}); !all) return tl::unexpected(all.error());
  const Eigen::MatrixXd features = complete_features(valves);
  if (features.cols() == 0) return fail("level_missing", "no level has an error for every valve");

  Comparison comparison{.features = std::size_t(features.cols())};
  const std::vector<Contender> all = contenders(valves, features);
  for (const Contender& contender : all) comparison.scores.push_back({.name = contender.name});
  std::mt19937 random(options.seed);
  for (int repeat = 0; repeat < options.repeats; ++repeat) {
    const std::vector<int> folds = stratified_folds(valves, options.folds, random);
    for (int fold = 0; fold < options.folds; ++fold) {
      for (std::size_t c = 0; c < all.size(); ++c) score_fold(all[c], valves, folds, fold, comparison.scores[c]);
    }
  }
  const std::size_t expected = valves.size() * std::size_t(options.repeats);
  for (const ClassifierScore& score : comparison.scores) {
    if (score.predictions == expected) continue;
    comparison.notes.push_back(fmt::format("{}: {} of {} held-out valves could not be classified", score.name,
                                           expected - score.predictions, expected));
  }
  return comparison;
}

}  // namespace valvetriage
