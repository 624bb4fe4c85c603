#include "server/report/lot_shift.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/report/sentence.h"

namespace valvetriage::report {
namespace {

std::string with_sign(double value, const std::string& unit) {
  return (value > 0 ? "+" : "") + quantity(value, unit);
}

std::string p_text(double p) {
  return p < 0.0001 ? "p < 0.0001" : fmt::format("p = {:.2g}", p);
}

}  // namespace

double FigureShift::good_mean() const {
  return figure.logarithmic ? std::exp(figure.good.mean) : figure.good.mean;
}

double FigureShift::lot_mean() const {
  return good_mean() + difference();
}

double FigureShift::difference() const {
  return figure.logarithmic ? good_mean() * std::expm1(shift.shift) : shift.shift;
}

std::array<double, 2> FigureShift::difference_ci95() const {
  if (!figure.logarithmic) return shift.ci95;
  return {good_mean() * std::expm1(shift.ci95[0]), good_mean() * std::expm1(shift.ci95[1])};
}

std::string figure_words(const PopulationFigure& figure) {
  std::string words = figure.name;
  for (const char* unit : {"_rad_s", "_psi", "_s", "_A"}) {
    if (!words.ends_with(unit)) continue;
    words.resize(words.size() - std::string_view(unit).size());
    break;
  }
  std::replace(words.begin(), words.end(), '_', ' ');
  if (words == "supply") words = "supply pressure";
  return figure.level_a ? fmt::format("{} at {:.2f} A", words, *figure.level_a) : words;
}

std::vector<std::string> shift_sentences(const LotShifts& shifts) {
  std::vector<std::string> sentences;
  for (const FigureShift& found : shifts.figures) {
    if (found.p_adjusted >= kShiftSignificance) continue;
    const std::string& unit = found.figure.unit;
    const auto [low, high] = found.difference_ci95();
    std::string sentence = spoken(figure_words(found.figure));
    sentence +=
        fmt::format(": {} in all valves (95 %: {} to {}), {} where good valves have {}, {} paid for {} figures.",
                    with_sign(found.difference(), unit), with_sign(low, unit), with_sign(high, unit),
                    quantity(found.lot_mean(), unit), quantity(found.good_mean(), unit), p_text(found.p_adjusted),
                    shifts.figures.size());
    sentence += fmt::format(" The farthest single valve is {:.1f} standard deviations from good ones.",
                            found.shift.largest_single);
    sentences.push_back(std::move(sentence));
  }
  return sentences;
}

std::string shift_scope(const LotShifts& shifts) {
  if (shifts.valve_type.empty())
    return "No valve of this lot without a settled cause was compared with a stored reference of good valves.";
  if (shifts.figures.empty()) {
    return fmt::format(
        "A shift that all valves share needs {} valves without a settled cause; of this lot {} can be compared.",
        kFewestShiftValves, shifts.valves);
  }
  std::string scope = fmt::format("Compared: the fits of {}", counted(shifts.valves, "valve"));
  if (shifts.valves < shifts.fitting) scope += fmt::format(" of {}", shifts.fitting);
  scope += fmt::format(" without a settled cause, with {} good valves of type '{}' (reference version {}); {} figures.",
                       shifts.good_valves, shifts.valve_type, shifts.reference_version, shifts.figures.size());
  if (shift_sentences(shifts).empty()) scope += " No figure is shifted beyond chance.";
  scope += " Fits are drawn towards good valves, so a true shift is rather larger.";
  return scope;
}

}  // namespace valvetriage::report
