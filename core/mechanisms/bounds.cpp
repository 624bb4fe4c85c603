#include "core/mechanisms/bounds.h"

#include <cmath>

namespace valvetriage {

std::vector<double> spread(double low, double high, int count) {
  std::vector<double> values;
  if (!(low > 0) || !(high > low)) return values;
  for (int i = 0; i < count; ++i) {
    const double share = count > 1 ? static_cast<double>(i) / (count - 1) : 0.5;
    values.push_back(low * std::pow(high / low, share));
  }
  return values;
}

MechanismBounds one_parameter(double lower, double upper, double step, const std::vector<double>& starts) {
  MechanismBounds bounds{.lower = {lower}, .upper = {upper}, .step = {step}, .starts = {}};
  for (const double start : starts) {
    if (start >= lower && start <= upper) bounds.starts.push_back({start});
  }
  return bounds;
}

std::vector<double> both_signs(const std::vector<double>& sizes) {
  std::vector<double> values;
  for (const double size : sizes) {
    values.push_back(size);
    values.push_back(-size);
  }
  return values;
}

}  // namespace valvetriage
