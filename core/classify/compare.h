#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/classify/learn.h"

namespace valvetriage {

/// folds, repeats   stratified cross-validation: every class is spread evenly over the folds, shuffled anew each repeat
/// seed             of the shuffling; equal seeds give equal tables
struct CompareOptions {
  int folds = 5;
  int repeats = 10;
  unsigned seed = 1;
};

/// One classifier on all held-out valves of all repeats.
///
/// predictions  valves classified; 0 where the classifier could not be trained
/// right        with the verdict of the label
/// soft         soft errors as is_soft_error defines them (not necessarily wrong verdicts)
/// hard         Good taken for bad or the reverse
struct ClassifierScore {
  std::string name;
  std::size_t predictions = 0;
  std::size_t right = 0;
  std::size_t soft = 0;
  std::size_t hard = 0;

  double accuracy() const { return predictions == 0 ? 0.0 : double(right) / double(predictions); }
};

struct Comparison {
  std::vector<ClassifierScore> scores;  ///< the fuzzy rule base, learned in each fold, first; then the rivals
  std::size_t features = 0;             ///< how many features every valve has; the rivals see these alone
  std::vector<std::string> notes;
};

/// The fuzzy rule base against the classifiers the paper cites, on the same valves and folds.
///
/// Errors  `too_few_labels` (each labelled class needs so many valves that every training part keeps three),
///         `level_missing` where no level has an error for every valve
/// Cost    folds · repeats trainings of every classifier
Result<Comparison> compare_classifiers(std::span<const LabelledValve> valves, const CompareOptions& options = {});

}  // namespace valvetriage
