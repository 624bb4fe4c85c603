#include "server/report/bode_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage::report {
namespace {

constexpr std::size_t kColumns = 72;
constexpr std::size_t kRows = 16;

double frequency_at(std::size_t column, double from, double to) {
  return from * std::pow(to / from, static_cast<double>(column) / static_cast<double>(kColumns - 1));
}

std::vector<std::string> picture_of(const std::vector<BodeCurve>& curves, double from, double to, double lowest_db) {
  std::vector<std::string> rows(kRows, std::string(kColumns, ' '));
  for (const BodeCurve& curve : curves) {
    for (std::size_t column = 0; column < kColumns; ++column) {
      const double hz = frequency_at(column, from, to) / (2 * std::numbers::pi);
      const double gain = std::abs(frequency_response(curve.g, std::vector<double>{hz})[0] / static_gain(curve.g));
      const double share = 20 * std::log10(gain) / lowest_db;
      const auto row = std::lround(std::max(0.0, share) * static_cast<double>(kRows - 1));
      if (row < static_cast<long>(kRows)) rows[static_cast<std::size_t>(row)][column] = curve.sign;
    }
  }
  return rows;
}

/// Whole powers of ten below the axis.
std::string ticks(double from, double to) {
  std::string line(kColumns + 4, ' ');
  for (int decade = static_cast<int>(std::ceil(std::log10(from) - 1e-9)); std::pow(10, decade) <= to * (1 + 1e-9);
       ++decade) {
    const double share = std::log(std::pow(10, decade) / from) / std::log(to / from);
    const std::string label = fmt::format("{:g}", std::pow(10, decade));
    line.replace(static_cast<std::size_t>(std::lround(share * (kColumns - 1))), label.size(), label);
  }
  line.erase(line.find_last_not_of(' ') + 1);
  return line;
}

}  // namespace

std::string bode_text(const std::vector<BodeCurve>& curves, double from, double to, double lowest_db) {
  std::vector<std::string> rows = picture_of(curves, from, to, lowest_db);
  std::string text;
  for (std::size_t row = 0; row < kRows; ++row) {
    rows[row].erase(rows[row].find_last_not_of(' ') + 1);
    const double db = lowest_db * static_cast<double>(row) / static_cast<double>(kRows - 1);
    text += fmt::format("{:>7} |{}\n", row % 5 == 0 ? fmt::format("{:.0f} dB", db) : "", rows[row]);
  }
  text += fmt::format("{:>7} +{}\n{:>9}{}\n", "", std::string(kColumns, '-'), "", ticks(from, to));
  for (const BodeCurve& curve : curves) text += fmt::format("{:>9}{}  {}\n", "", curve.sign, curve.name);
  return text;
}

}  // namespace valvetriage::report
