#pragma once

#include <span>
#include <vector>

#include "core/analysis/part_to_fit.h"
#include "core/discrepancy/valve_diagnosis.h"

namespace valvetriage {

/// Gives tones that were found in thinned recordings the frequency that the whole recordings show: a tone of f looks
/// like |k fₛ ± f| where only every n-th sample is seen, fₛ being the rate of those that are kept.
///
/// recordings  as they were given, before they were thinned
/// without     free runs on all of their samples without each of the causes, in the order of `causes`
/// model       extended model, the causes last among its mechanisms; its frequency and phase follow
/// extended    its free runs on all samples: the tone, as each recording has it, stands on the run without it
void unfold_tones(std::span<const Recording> recordings, const PartToFit& part, std::span<const FreeRunsOf> without,
                  std::vector<NamedCause>& causes, Model& model, FreeRunsOf& extended);

}  // namespace valvetriage
