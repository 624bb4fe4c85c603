#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace valvetriage::report {

/// What a curve is; every kind has its own colour and dash, so that print without colour tells them apart.
enum class Ink { kMeasured, kSimulated, kExtended, kInput };

struct Curve {
  std::string name;
  Ink ink = Ink::kMeasured;
  std::vector<double> x, y;  ///< equally many; NaN breaks the line
};

/// One of several diagrams over the same horizontal axis.
struct Panel {
  std::string title;  ///< with the unit: "Output [psi]"
  double height = 180;
  std::vector<Curve> curves;
};

/// A stretch of time that is pointed out. What the input does is a line at its beginning with a name in the first
/// panel; what is odd about the samples is shaded in every panel.
struct Stretch {
  double from = 0, to = 0;  ///< [s]
  std::string name;         ///< written where there is room
  bool odd = false;
};

/// Curves over time as one SVG document, the panels below each other. The same input gives the same bytes.
///
/// title      for readers who do not see the drawing
/// stretches  in the order of their beginnings
/// Cost       O(points)
std::string time_plot(const std::string& title, std::span<const Panel> panels, std::span<const Stretch> stretches = {});

struct Bar {
  std::string name;
  double value = 0;
  std::string text;  ///< the value as it is written behind the bar
  Ink ink = Ink::kSimulated;
};

/// Horizontal bars on one scale that begins at zero.
std::string bar_plot(const std::string& title, std::span<const Bar> bars);

struct ChartPoint {
  double value = 0;
  std::string verdict;   ///< its shape: circle Good, triangle Malfunctioned, square Severe
  bool outside = false;  ///< of the limits: ringed
};

struct ChartLimits {
  double centre = 0, lower = 0, upper = 0;
};

/// An individuals chart: one mark per valve in the order received, with mean and limits where there are any.
std::string individuals_plot(const std::string& title, std::span<const ChartPoint> points,
                             const std::optional<ChartLimits>& limits);

/// Round numbers (1, 2 or 5 times a power of ten) inside [low, high], about `wanted` of them.
std::vector<double> round_ticks(double low, double high, int wanted);

}  // namespace valvetriage::report
