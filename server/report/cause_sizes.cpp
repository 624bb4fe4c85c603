#include "server/report/cause_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/report/markup.h"
#include "server/report/sentence.h"
#include "server/report/sizes_plot.h"

namespace valvetriage::report {
namespace {

/// The value below which `share` of the sorted values lie, between two of them by their distance.
double quantile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - std::floor(at)) * (sorted[above] - sorted[below]);
}

std::string picture(const std::string& cause, const ParameterSizes& parameter) {
  std::vector<double> sorted;
  std::vector<SizedMark> marks;
  for (const SizedValve& valve : parameter.values) {
    sorted.push_back(valve.value);
    marks.push_back({.value = valve.value, .low = valve.ci95[0], .high = valve.ci95[1]});
  }
  std::sort(sorted.begin(), sorted.end());
  std::optional<std::array<double, 2>> band;
  if (std::isfinite(parameter.population_mean) && std::isfinite(parameter.population_sd)) {
    band = {parameter.population_mean - 2 * parameter.population_sd,
            parameter.population_mean + 2 * parameter.population_sd};
  }
  const std::string title = fmt::format("{} of {}{}", parameter.name, spoken(cause),
                                        parameter.unit.empty() ? "" : " [" + parameter.unit + "]");
  std::string caption = counted(sorted.size(), "valve") + ": ";
  caption += sorted.size() == 1 ? quantity(sorted.front(), parameter.unit)
                                : fmt::format("median {}, the middle half from {} to {}",
                                              quantity(quantile(sorted, 0.5), parameter.unit),
                                              quantity(quantile(sorted, 0.25), parameter.unit),
                                              quantity(quantile(sorted, 0.75), parameter.unit));
  caption += band ? "; lines are 95 % intervals, the band is good valves." : "; lines are 95 % intervals.";
  return fmt::format("<figure>\n{}<figcaption>{}</figcaption>\n</figure>\n", sizes_plot(title, marks, band),
                     escaped(caption));
}

}  // namespace

std::string sizes_markup(const LotSizes& sizes) {
  std::string body;
  for (const CauseSizes& cause : sizes.causes) {
    if (cause.parameters.empty()) continue;
    body += fmt::format("<h3>{} ({})</h3>\n", escaped(spoken(cause.cause)), counted(cause.valves, "valve"));
    for (const ParameterSizes& parameter : cause.parameters) body += picture(cause.cause, parameter);
  }
  if (body.empty()) return "<p>No cause of this lot that has a size is settled.</p>\n";
  if (sizes.read < sizes.named) {
    body += fmt::format("<p class=\"small\">Of the newest {} of {} valves with a settled cause.</p>\n", sizes.read,
                        sizes.named);
  }
  return body;
}

}  // namespace valvetriage::report
