#pragma once

#include <string>
#include <vector>

#include "core/model/transfer_function.h"

namespace valvetriage::report {

/// A transfer function and the sign that draws it.
struct BodeCurve {
  std::string name;
  char sign = '*';
  TransferFunction g;
};

/// Gain relative to the static one, 20 log10 |G / G(0)|, over a logarithmic axis of angular frequency, as lines of
/// text.
///
/// curves     at least one, with static gains; where two meet, the later one's sign stands
/// from, to   angular frequency in the unit of the corners, 0 < from < to
/// lowest_db  bottom of the picture, < 0; what lies lower is not drawn
/// Cost       O(columns · order); pure
std::string bode_text(const std::vector<BodeCurve>& curves, double from, double to, double lowest_db);

}  // namespace valvetriage::report
