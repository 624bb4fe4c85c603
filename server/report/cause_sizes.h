#pragma once

#include <array>
#include <string>
#include <vector>

namespace valvetriage::report {

/// A parameter of one valve's settled cause; an interval of NaN where there is none.
struct SizedValve {
  std::string submission_id, serial;  ///< serial empty: the valve names none
  double value = 0;
  std::array<double, 2> ci95{};
};

/// A parameter of one cause over the valves that have it. Mean and sd are of good valves, NaN where they are not known.
struct ParameterSizes {
  std::string name, unit;
  double population_mean = 0, population_sd = 0;
  std::vector<SizedValve> values;
};

struct CauseSizes {
  std::string cause;
  std::size_t valves = 0;
  std::vector<ParameterSizes> parameters;
};

/// How large the settled causes of a lot are, most frequent first; of the newest `read` of `named` valves with any.
struct LotSizes {
  std::size_t named = 0, read = 0;
  std::vector<CauseSizes> causes;
};

/// A picture for each parameter of each cause: one mark per valve with its 95 % interval, good valves as a band.
std::string sizes_markup(const LotSizes& sizes);

}  // namespace valvetriage::report
