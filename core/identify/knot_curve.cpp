#include "core/identify/knot_curve.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

/// Hermite's cubic with slopes by differences, on knots −1, 0, 1, 2 of a piece from 0 to 1.
std::array<double, 4> inner_weights(double t) {
  const double rest = 1 - t;
  const double left_slope = t * rest * rest, right_slope = -t * t * rest;
  const double right = t * t * (3 - 2 * t);
  return {-0.5 * left_slope, 1 - right - 0.5 * right_slope, right + 0.5 * left_slope, 0.5 * right_slope};
}

/// Weights of the knots that there are: one beyond an end lies on the parabola through the last three, the straight
/// line through two.
KnotCurve::Share share_in(std::size_t piece, double t, std::size_t knots) {
  const std::array<double, 4> weight = inner_weights(t);
  std::vector<double> all(knots + 2, 0.0);  // with one beyond each end
  for (std::size_t k = 0; k < weight.size(); ++k) all[piece + k] = weight[k];
  const double before = all.front(), behind = all.back();
  const auto at = [&](std::size_t knot) -> double& { return all[knot + 1]; };
  const auto spread = [&](double ghost, std::size_t next, std::size_t second, std::size_t third) {
    at(next) += knots > 2 ? 3 * ghost : 2 * ghost;
    at(second) -= knots > 2 ? 3 * ghost : ghost;
    if (knots > 2) at(third) += ghost;
  };
  spread(before, 0, 1, 2);
  spread(behind, knots - 1, knots - 2, knots - 3);
  KnotCurve::Share share{.first = std::min(piece > 0 ? piece - 1 : 0, knots > 4 ? knots - 4 : 0)};
  for (std::size_t k = 0; k < share.weight.size() && share.first + k < knots; ++k) {
    share.weight[k] = at(share.first + k);
  }
  return share;
}

}  // namespace

std::size_t nearest_knot(const std::vector<double>& knots, double input) {
  const double spacing = knots[1] - knots[0];
  const auto last = static_cast<std::ptrdiff_t>(knots.size()) - 1;
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(std::lround((input - knots[0]) / spacing), 0, last));
}

KnotCurve::KnotCurve(const std::vector<double>& knots) {
  const std::size_t pieces = (knots.size() - 1) * kPieces;
  const double spacing = (knots.back() - knots.front()) / static_cast<double>(pieces);
  for (std::size_t i = 0; i <= pieces; ++i) {
    const std::size_t piece = std::min(i / kPieces, knots.size() - 2);
    const double t = static_cast<double>(i - piece * kPieces) / kPieces;
    fine_input_.push_back(i == pieces ? knots.back() : knots.front() + spacing * static_cast<double>(i));
    fine_.push_back(share_in(piece, t, knots.size()));
  }
}

KnotCurve::Share KnotCurve::share_at(double input) const {
  const double spacing = fine_input_[1] - fine_input_[0];
  const double place = std::floor((input - fine_input_.front()) / spacing);
  const auto left = static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(fine_.size() - 2)));
  const double way = (input - fine_input_[left]) / spacing;
  // Both ends of a straight piece between two knots have their weights within five knots; those of one piece of the
  // curve are the same four, but for the end that is the next knot itself.
  const Share &low = fine_[left], &high = fine_[left + 1];
  Share share{.first = low.first};
  for (std::size_t k = 0; k < share.weight.size(); ++k) {
    share.weight[k] = (1 - way) * low.weight[k];
    const std::size_t knot = low.first + k;
    if (knot >= high.first && knot - high.first < high.weight.size())
      share.weight[k] += way * high.weight[knot - high.first];
  }
  return share;
}

StaticMap KnotCurve::through(const std::vector<double>& outputs) const {
  StaticMap map{.input = fine_input_, .output = {}};
  map.output.reserve(fine_.size());
  for (const Share& share : fine_) {
    double output = 0;
    for (std::size_t k = 0; k < share.weight.size() && share.first + k < outputs.size(); ++k) {
      output += share.weight[k] * outputs[share.first + k];
    }
    map.output.push_back(output);
  }
  return map;
}

StaticMap KnotCurve::rising_through(const std::vector<double>& outputs) const {
  StaticMap map = through(outputs);
  map.output = monotone_regression(map.output, std::vector<double>(map.output.size(), 1.0));
  return map;
}

}  // namespace valvetriage
