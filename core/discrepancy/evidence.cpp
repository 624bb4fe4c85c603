#include "core/discrepancy/evidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr std::array<Index, 4> kBlocks{1, 4, 16, 64};
constexpr std::array<Index, 5> kScoreBlocks{1, 4, 16, 64, 256};
// Fewer blocks do not tell how far their scores scatter.
constexpr double kFewestBlocks = 3;
constexpr double kBystanders = 0.2;

/// A size that scatters about `common_size` standard deviations from none scatters in its square as a non-central χ² of
/// one freedom does, however alike the few squares seen happen to be.
double most_freedoms_of_square(double common_size) {
  const double non_centrality = common_size * common_size;
  if (!std::isfinite(non_centrality)) return std::numeric_limits<double>::infinity();
  return (1 + non_centrality) * (1 + non_centrality) / (1 + 2 * non_centrality);
}

}  // namespace

double noise_inflation(const Stack& residual) {
  double largest = 1;
  for (const Index length : kBlocks) {
    double squares = 0, samples = 0;
    for (const Eigen::VectorXd& r : residual) {
      for (Index first = 0; first + length <= r.size(); first += length) {
        const double sum = r.segment(first, length).sum();
        squares += sum * sum;
        samples += static_cast<double>(length);
      }
    }
    if (samples > 0) largest = std::max(largest, squares / samples);
  }
  return largest;
}

double Evidence::as_normal() const {
  if (!std::isfinite(freedoms)) return value;
  const double factor = (8 * freedoms + 1) / (8 * freedoms + 3);
  return exact + factor * factor * freedoms * std::log1p((value - exact) / freedoms);
}

Evidence Evidence::at_most(double reduction) const {
  const double most = std::max(reduction, 0.0);
  return {std::min(value, most), std::min(exact, most), freedoms, prior_share};
}

Evidence consistent_evidence(const Stack& before, const Stack& after, double reduction, Index slowest) {
  double energy = 0, closed = 0;
  for (std::size_t r = 0; r < before.size(); ++r) {
    energy += (before[r] - after[r]).squaredNorm();
    closed += before[r].squaredNorm() - after[r].squaredNorm();
  }
  double scatter = energy;  // white noise of unit variance
  double freedoms = std::numeric_limits<double>::infinity();
  std::vector<Index> lengths(kScoreBlocks.begin(), kScoreBlocks.end());
  if (slowest > lengths.back()) lengths.push_back(slowest);
  for (const Index length : lengths) {
    double squares = 0, fourths = 0, blocks = 0;
    for (std::size_t r = 0; r < before.size(); ++r) {
      for (Index first = 0; first < before[r].size(); first += length) {
        const Index count = std::min(length, before[r].size() - first);
        const auto left = after[r].segment(first, count);
        const double score = (before[r].segment(first, count) - left).dot(left);
        squares += score * score;
        fourths += std::pow(score, 4);
        ++blocks;
      }
    }
    // The law was fitted to these scores: they sum to nothing.
    if (blocks > 1) squares *= blocks / (blocks - 1);
    if (squares > scatter) {
      scatter = squares;
      const double told = std::clamp(3 * squares * squares / fourths - 2, 1.0, std::max(1.0, blocks - 1));
      freedoms = told * std::pow(squares / (squares - energy), 2);
    }
    if (length == slowest && blocks < kFewestBlocks) freedoms = std::min(freedoms, 1.0);
  }
  const double of_samples = scatter > 0 ? energy * energy / scatter : 0;
  const double owed_to_prior = std::max(0.0, reduction - std::max(0.0, closed));
  // The samples hardly change: the law does what the valve's own parameters did, and only their distance from good
  // valves' speaks for it. How far that scatters, with whatever the simulation gets wrong, the good valves have told.
  if (energy < kBystanders * reduction) return {.value = owed_to_prior, .exact = owed_to_prior, .prior_share = 1};
  if (owed_to_prior <= of_samples) {
    const double all = of_samples + owed_to_prior;
    return {all, owed_to_prior, freedoms, all > 0 ? owed_to_prior / all : 0};
  }
  const double together = reduction * reduction / (scatter + std::max(0.0, reduction - energy));
  return {together, 0, freedoms};
}

Contrast contrast(const Stack& winner, const Stack& rival) {
  Contrast contrast;
  for (std::size_t r = 0; r < winner.size(); ++r)
    contrast.difference += rival[r].squaredNorm() - winner[r].squaredNorm();
  contrast.z = std::numeric_limits<double>::infinity();
  for (const Index length : kScoreBlocks) {
    double squares = 0;
    for (std::size_t r = 0; r < winner.size(); ++r) {
      for (Index first = 0; first < winner[r].size(); first += length) {
        const Index count = std::min(length, winner[r].size() - first);
        const double d = rival[r].segment(first, count).squaredNorm() - winner[r].segment(first, count).squaredNorm();
        squares += d * d;
      }
    }
    if (!(squares > 0)) return {contrast.difference, 0};
    contrast.z = std::min(contrast.z, std::abs(contrast.difference) / std::sqrt(squares));
  }
  contrast.z = std::copysign(contrast.z, contrast.difference);
  return contrast;
}

double noise_along(const Stack& winner, const Stack& rival) {
  double energy = 0, largest = 1;
  for (std::size_t r = 0; r < winner.size(); ++r) energy += (rival[r] - winner[r]).squaredNorm();
  if (!(energy > 0)) return largest;
  for (const Index length : kScoreBlocks) {
    double squares = 0;
    for (std::size_t r = 0; r < winner.size(); ++r) {
      for (Index first = 0; first < winner[r].size(); first += length) {
        const Index count = std::min(length, winner[r].size() - first);
        const auto left = winner[r].segment(first, count);
        squares += std::pow((rival[r].segment(first, count) - left).dot(left), 2);
      }
    }
    largest = std::max(largest, squares / energy);
  }
  return largest;
}

double gain_to_be_borne_out(const Contrast& known, double least_z, double d, double samples, double noise_along) {
  const double known_scatter = known.z != 0 ? std::pow(known.difference / known.z, 2) : 0;
  const double blocks = std::max(1.0, samples / static_cast<double>(kScoreBlocks.back()));
  const double scatter = known_scatter + 4 * noise_along * d * d + std::pow(d, 4) / blocks;
  return least_z * std::sqrt(scatter) - known.difference;
}

double square_p_value(double times, double mean, double sd, int n, double most) {
  constexpr int kQuantiles = 32;  // of equal probability
  const auto beyond = [&](double freedoms) { return fisher_f_upper_tail(freedoms, freedoms * n, times); };
  if (!(sd > 0) || n < 3) return beyond(1);
  const double known = n - 1;
  double sum = 0;
  for (int i = 0; i < kQuantiles; ++i) {
    const double variance = sd * sd * known / chi_squared_quantile(known, (i + 0.5) / kQuantiles);
    sum += beyond(std::max(1.0, std::min(most, 2 * mean * mean / variance)));
  }
  return sum / kQuantiles;
}

double good_valve_p_value(const Evidence& evidence, Index freedoms, double noise_reduction,
                          const GoodValveEvidence& good) {
  const double k = static_cast<double>(freedoms);
  const double searched = std::max(0.0, noise_reduction - k);
  const double beyond_search = evidence.as_normal() - searched;
  if (!(beyond_search > 0)) return 1;
  const double by_noise = chi_squared_upper_tail(k, beyond_search);
  const double beyond_noise = evidence.value - std::max(0.0, noise_reduction - 1);
  if (!(beyond_noise > 0) || good.valves < 1) return by_noise;
  const double spread = std::max(0.0, good.mean - noise_reduction);
  const double sd = spread > 0 ? good.sd : 0;  // where good valves show noise alone its scatter tells nothing of theirs
  const double by_spread = square_p_value(beyond_noise / (1 + spread), 1 + spread, sd, good.valves,
                                          most_freedoms_of_square(good.common_size));
  return std::max(by_noise, by_spread);
}

double odds_at_unknown_size(double p_value) {
  constexpr double kSmallest = 0.5, kLargest = 50;
  constexpr int kSteps = 200;
  constexpr double kLeast_p = 1e-12;
  const double p = std::clamp(p_value, kLeast_p, 0.5);
  const double z = normal_upper_quantile(p);
  const double ratio = std::pow(kLargest / kSmallest, 1.0 / kSteps);
  double sum = 0, size = kSmallest * std::sqrt(ratio);
  for (int i = 0; i < kSteps; ++i, size *= ratio) sum += std::exp(size * (z - 0.5 * size));
  return sum / kSteps;
}

double size_p_value(double size_from_none, double mean_from_none, double sd, double error, double prior_share,
                    int good_valves) {
  if (!std::isfinite(error) || good_valves < 2) return 1;
  const double of_valves = sd * sd * (1 + 1.0 / good_valves);
  const double total = of_valves + error * error;
  if (!(total > 0)) return 1;
  const double told_by_valves = std::hypot(of_valves, prior_share * error * error) / total;
  constexpr double kMostFreedoms = 1e6;
  const double known = std::min(kMostFreedoms, (good_valves - 1) / (told_by_valves * told_by_valves));
  const double distance = std::abs(size_from_none - mean_from_none) / std::sqrt(total);
  return 2 * student_t_upper_tail(known, distance);
}

}  // namespace valvetriage
