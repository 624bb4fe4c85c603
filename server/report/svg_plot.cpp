#include "server/report/svg_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "server/report/markup.h"
#include "server/report/sizes_plot.h"

namespace valvetriage::report {
namespace {

constexpr double kWidth = 720;
constexpr double kLeft = 56, kRight = 12;  // room for the numbers of the vertical axis; the last of the horizontal one
constexpr double kTop = 24, kBottom = 24;  // title and legend; numbers of the horizontal axis
constexpr double kAxisTitle = 16;
constexpr int kTicksAcross = 9;
constexpr double kLetter = 6;         // width of a letter, about
constexpr double kTickDistance = 36;  // between numbers of the vertical axis

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void include(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  /// Never empty: something to draw on even where there is nothing to draw.
  Range drawable() const {
    if (low > high) return {0, 1};
    if (low == high) return {low - 0.5 * std::max(1.0, std::abs(low)), high + 0.5 * std::max(1.0, std::abs(high))};
    return *this;
  }
  Range widened(double share) const { return {low - share * (high - low), high + share * (high - low)}; }
};

/// A linear scale from values to places.
struct Scale {
  Range values;
  double from = 0, to = 0;
  double operator()(double value) const {
    return from + (value - values.low) / (values.high - values.low) * (to - from);
  }
};

const char* colour(Ink ink) {
  constexpr std::array kColours{"#1b1f24", "#0072b2", "#c2410c", "#57606a"};
  return kColours[static_cast<std::size_t>(ink)];
}

std::string stroke(Ink ink) {
  return fmt::format("stroke=\"{}\" stroke-width=\"{}\"{}", colour(ink), ink == Ink::kMeasured ? "1" : "1.4",
                     ink == Ink::kExtended ? " stroke-dasharray=\"6 3\"" : "");
}

std::string open_svg(const std::string& title, double height) {
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {:.0f} {:.0f}\" role=\"img\" "
      "font-family=\"sans-serif\" font-size=\"11\" fill=\"#57606a\"><title>{}</title>\n",
      kWidth, height, escaped(title));
}

std::string text(double x, double y, std::string_view words, std::string_view attributes = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\"{}{}>{}</text>\n", x, y, attributes.empty() ? "" : " ", attributes,
                     escaped(words));
}

std::string line(double x1, double y1, double x2, double y2, std::string_view attributes) {
  return fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", x1, y1, x2, y2,
                     attributes);
}

std::string vertical_axis(const Scale& y) {
  std::string out;
  const int wanted = std::max(2, static_cast<int>((y.from - y.to) / kTickDistance));
  for (const double tick : round_ticks(y.values.low, y.values.high, wanted)) {
    out += line(kLeft, y(tick), kWidth - kRight, y(tick), "stroke=\"#e3e6ea\"");
    out += text(kLeft - 6, y(tick) + 4, fmt::format("{:.6g}", tick), "text-anchor=\"end\"");
  }
  return out;
}

std::string horizontal_axis(const Scale& x, double bottom) {
  std::string out = line(kLeft, bottom, kWidth - kRight, bottom, "stroke=\"#c4cad1\"");
  for (const double tick : round_ticks(x.values.low, x.values.high, kTicksAcross)) {
    out += text(x(tick), bottom + 15, fmt::format("{:.6g}", tick), "text-anchor=\"middle\"");
  }
  return out;
}

std::string path(const Curve& curve, const Scale& x, const Scale& y) {
  std::string steps;
  bool drawing = false;
  for (std::size_t i = 0; i < std::min(curve.x.size(), curve.y.size()); ++i) {
    const bool there = std::isfinite(curve.y[i]);
    if (there) steps += fmt::format("{}{:.1f} {:.1f}", drawing ? "L" : "M", x(curve.x[i]), y(curve.y[i]));
    drawing = there;
  }
  if (steps.empty()) return {};
  return fmt::format("<path fill=\"none\" {} d=\"{}\"/>\n", stroke(curve.ink), steps);
}

std::string legend(const Panel& panel, double y) {
  std::string out = text(kLeft, y, panel.title, "font-weight=\"bold\" fill=\"#1b1f24\"");
  double x = kLeft + 9 + 6.6 * static_cast<double>(panel.title.size());
  for (const Curve& curve : panel.curves) {
    out += line(x, y - 4, x + 22, y - 4, stroke(curve.ink));
    out += text(x + 26, y, curve.name);
    x += 40 + 5.8 * static_cast<double>(curve.name.size());
  }
  return out;
}

std::string draw_panel(const Panel& panel, const Scale& x, double top) {
  Range values;
  for (const Curve& curve : panel.curves) {
    for (const double value : curve.y) values.include(value);
  }
  const Scale y{values.drawable().widened(0.04), top + panel.height - kBottom, top + kTop};
  std::string out = legend(panel, top + 14) + vertical_axis(y) + horizontal_axis(x, y.from);
  for (const Curve& curve : panel.curves) out += path(curve, x, y);
  return out;
}

/// A line where the stretch begins; its name beside it where there is room for it before the next.
std::string beginning(const Stretch& stretch, const Scale& x, double top, double bottom, bool named) {
  std::string out;
  if (stretch.from > x.values.low) {
    out += line(x(stretch.from), top, x(stretch.from), bottom, "stroke=\"#c4cad1\" stroke-dasharray=\"2 3\"");
  }
  const double needed = kLetter * static_cast<double>(stretch.name.size()) + 6;
  if (named && x(stretch.to) - x(stretch.from) >= needed) out += text(x(stretch.from) + 3, top + 9, stretch.name);
  return out;
}

/// A tinted stretch, at least as wide as a line, with its name for whoever points at it.
std::string shade(const Stretch& stretch, const Scale& x, double top, double bottom) {
  const double width = std::max(1.5, x(stretch.to) - x(stretch.from));
  return fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"#b35c00\" "
      "fill-opacity=\"0.18\"><title>{}</title></rect>\n",
      x(stretch.from), top, width, bottom - top, escaped(stretch.name));
}

std::string mark(const ChartPoint& point, double x, double y) {
  std::string out;
  if (point.outside)
    out = fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"8\" fill=\"none\" stroke=\"#a1123f\"/>", x, y);
  if (point.verdict == "Severe") {
    out += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"7\" height=\"7\" fill=\"#a1123f\"/>", x - 3.5, y - 3.5);
  } else if (point.verdict == "Malfunctioned") {
    out += fmt::format("<path d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}H{:.1f}Z\" fill=\"#b35c00\"/>", x, y - 4, x + 4, y + 4,
                       x - 4);
  } else {
    out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.5\" fill=\"{}\"/>", x, y,
                       point.verdict == "Good" ? "#0072b2" : "#8b949e");
  }
  return out + "\n";
}

std::string limit_line(const Scale& y, double value, std::string_view name, bool centre) {
  return line(kLeft, y(value), kWidth - kRight, y(value),
              centre ? "stroke=\"#57606a\"" : "stroke=\"#a1123f\" stroke-dasharray=\"6 4\"") +
         text(kWidth - kRight, y(value) - 4, fmt::format("{} {:.3g}", name, value), "text-anchor=\"end\"");
}

}  // namespace

std::vector<double> round_ticks(double low, double high, int wanted) {
  if (!(high > low) || wanted < 1) return {};
  const double power = std::pow(10, std::floor(std::log10((high - low) / wanted)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if ((high - low) / (factor * power) <= wanted) step = factor * power;
  }
  std::vector<double> ticks;
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i) ticks.push_back(i * step + 0.0);
  return ticks;
}

std::string time_plot(const std::string& title, std::span<const Panel> panels, std::span<const Stretch> stretches) {
  Range times;
  double height = kAxisTitle;
  for (const Panel& panel : panels) {
    height += panel.height;
    for (const Curve& curve : panel.curves) {
      for (const double time : curve.x) times.include(time);
    }
  }
  const Scale x{times.drawable(), kLeft, kWidth - kRight};
  std::string out = open_svg(title, height);
  double top = 0;
  for (const Panel& panel : panels) {
    for (const Stretch& stretch : stretches) {
      out += stretch.odd ? shade(stretch, x, top + kTop, top + panel.height - kBottom)
                         : beginning(stretch, x, top + kTop, top + panel.height - kBottom, top == 0);
    }
    out += draw_panel(panel, x, top);
    top += panel.height;
  }
  return out + text((kLeft + kWidth) / 2, height - 4, "time [s]", "text-anchor=\"middle\"") + "</svg>\n";
}

std::string bar_plot(const std::string& title, std::span<const Bar> bars) {
  constexpr double kRow = 20, kNames = 160, kTexts = 110;
  double largest = 0;
  for (const Bar& bar : bars) largest = std::max(largest, std::isfinite(bar.value) ? bar.value : 0);
  std::string out = open_svg(title, kRow * static_cast<double>(bars.size()) + 6);
  double y = 3;
  for (const Bar& bar : bars) {
    const double share = largest > 0 && bar.value > 0 ? bar.value / largest : 0;
    out += text(kNames - 8, y + 14, bar.name, "text-anchor=\"end\" fill=\"#1b1f24\"");
    out += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"13\" fill=\"{}\"/>\n", kNames, y + 3,
                       share * (kWidth - kNames - kTexts), colour(bar.ink));
    out += text(kNames + share * (kWidth - kNames - kTexts) + 6, y + 14, bar.text);
    y += kRow;
  }
  return out + "</svg>\n";
}

std::string individuals_plot(const std::string& title, std::span<const ChartPoint> points,
                             const std::optional<ChartLimits>& limits) {
  constexpr double kHeight = 220;
  Range values;
  values.include(0);
  for (const ChartPoint& point : points) values.include(point.value);
  if (limits) values.include(limits->upper);
  const Scale y{values.drawable().widened(0.05), kHeight - kBottom, kTop};
  const Scale x{{-0.5, static_cast<double>(points.size()) - 0.5}, kLeft, kWidth - kRight};
  std::string out =
      open_svg(title, kHeight) + text(kLeft, 14, title, "font-weight=\"bold\" fill=\"#1b1f24\"") + vertical_axis(y);
  if (limits) {
    out += limit_line(y, limits->centre, "mean", true) + limit_line(y, limits->upper, "upper limit", false);
    if (limits->lower > 0) out += limit_line(y, limits->lower, "lower limit", false);
  }
  for (std::size_t i = 0; i < points.size(); ++i) out += mark(points[i], x(static_cast<double>(i)), y(points[i].value));
  return out + text((kLeft + kWidth) / 2, kHeight - 6, "valves in the order received", "text-anchor=\"middle\"") +
         "</svg>\n";
}

std::string sizes_plot(const std::string& title, std::span<const SizedMark> marks,
                       const std::optional<std::array<double, 2>>& band) {
  constexpr double kRow = 9, kFewestRows = 4, kMostRows = 40;
  std::vector<SizedMark> sorted(marks.begin(), marks.end());
  std::sort(sorted.begin(), sorted.end(), [](const SizedMark& a, const SizedMark& b) { return a.value > b.value; });
  Range values;
  for (const SizedMark& sized : sorted) {
    for (const double value : {sized.value, sized.low, sized.high}) values.include(value);
  }
  if (band) std::for_each(band->begin(), band->end(), [&](double value) { values.include(value); });
  const auto count = static_cast<double>(sorted.size());
  const double height = kTop + kRow * std::clamp(count, kFewestRows, kMostRows) + kBottom;
  const Scale x{values.drawable().widened(0.04), kLeft, kWidth - kRight};
  const Scale y{{-0.5, std::max(count, 1.0) - 0.5}, kTop, height - kBottom};
  std::string out = open_svg(title, height) + text(kLeft, 14, title, "font-weight=\"bold\" fill=\"#1b1f24\"");
  if (band) {
    out += fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"#0072b2\" "
        "fill-opacity=\"0.15\"><title>good valves</title></rect>\n",
        x((*band)[0]), kTop, std::max(1.0, x((*band)[1]) - x((*band)[0])), height - kTop - kBottom);
  }
  out += horizontal_axis(x, height - kBottom);
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const SizedMark& sized = sorted[i];
    const double place = y(static_cast<double>(i));
    if (std::isfinite(sized.low) && std::isfinite(sized.high)) {
      out += line(x(sized.low), place, x(sized.high), place, "stroke=\"#57606a\"");
    }
    out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3\" fill=\"#0072b2\"/>\n", x(sized.value), place);
  }
  return out + "</svg>\n";
}

}  // namespace valvetriage::report
