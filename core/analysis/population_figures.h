#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/classify/shared_shift.h"
#include "core/model/model.h"
#include "core/model/reference.h"

namespace valvetriage {

/// A physical figure of one fitted valve beside the population it is compared with.
struct PopulationFigure {
  std::string name;  ///< a parameter of the reference, or `steady_pressure_psi`
  std::string unit;
  std::optional<double> level_a;  ///< of `steady_pressure_psi`
  bool logarithmic = false;       ///< value and good are in ln(figure)
  double value = 0;
  GoodValves good;
};

/// The valve's own parameters and its steady pressure at the reference's levels, in the population's scale.
///
/// model    as an analysis against this reference fitted it (`baseline.model`)
/// Returns  the same figures in the same order for every such model; nothing for a model of another kind
/// Cost     O(parameters + levels)
std::vector<PopulationFigure> population_figures(const Model& model, const Reference& reference);

}  // namespace valvetriage
