#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/discrepancy/machine_search.h"

namespace valvetriage {
namespace {

constexpr double kFewestPeriods = 3;
constexpr std::size_t kBackgroundBins = 24;  // to either side
constexpr std::size_t kMostTones = 2;
// Power of a line over its background's median that white noise reaches in one of 10⁵ records of 2,500 bins.
constexpr double kProminent = 28;

struct Line {
  double frequency_hz = 0;
  double prominence = 0;
};

/// Σ over the records of |Σ x exp(−2πi f t)|², at the frequencies k / longest.
std::vector<double> periodogram(const std::vector<std::vector<double>>& signals, std::size_t longest) {
  std::vector<double> power(longest / 2);
  for (std::size_t k = 0; k < power.size(); ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(longest);
    const double turn_cos = std::cos(angle), turn_sin = std::sin(angle);
    for (const auto& signal : signals) {
      double c = 1, s = 0, real = 0, imaginary = 0;
      for (const double x : signal) {
        real += c * x;
        imaginary += s * x;
        const double next = c * turn_cos - s * turn_sin;
        s = s * turn_cos + c * turn_sin;
        c = next;
      }
      power[k] += real * real + imaginary * imaginary;
    }
  }
  return power;
}

double background(const std::vector<double>& power, std::size_t at) {
  std::vector<double> near;
  const std::size_t first = at > kBackgroundBins ? at - kBackgroundBins : 1;
  for (std::size_t k = first; k < std::min(power.size(), at + kBackgroundBins + 1); ++k) near.push_back(power[k]);
  std::nth_element(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2), near.end());
  return std::max(near[near.size() / 2], 1e-300);
}

}  // namespace

std::vector<double> residual_tones(const MachineData& data, const MachineFit& fit) {
  std::vector<std::vector<double>> residuals, inputs;
  std::size_t longest = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    const auto y = run_record(data, r, fit);
    std::vector<double> gap(y.size());
    for (const std::size_t t : record.valid) gap[t] = record.output[t] - y[t];
    residuals.push_back(std::move(gap));
    inputs.push_back(record.input);
    longest = std::max(longest, record.input.size());
  }
  const auto power = periodogram(residuals, longest);
  const auto driving = periodogram(inputs, longest);
  std::vector<Line> lines;
  for (auto k = static_cast<std::size_t>(kFewestPeriods); k + 1 < power.size(); ++k) {
    if (power[k] < power[k - 1] || power[k] < power[k + 1]) continue;
    const double prominence = power[k] / background(power, k);
    if (!(prominence > kProminent) || driving[k] > kProminent * background(driving, k)) continue;
    lines.push_back({static_cast<double>(k) / (static_cast<double>(longest) * data.period_s), prominence});
  }
  std::stable_sort(lines.begin(), lines.end(),
                   [](const Line& a, const Line& b) { return a.prominence > b.prominence; });
  std::vector<double> tones;
  for (std::size_t i = 0; i < std::min(lines.size(), kMostTones); ++i) tones.push_back(lines[i].frequency_hz);
  return tones;
}

}  // namespace valvetriage
