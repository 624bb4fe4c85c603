#pragma once

#include <span>

#include "core/analysis/learn_reference.h"
#include "core/identify/valve_fit.h"

namespace valvetriage {

/// What good valves of one type have in common beside spool, map and volume: the gauge's lag, the shape of the magnetic
/// loop and the air in the fluid. One valve's spool takes most of it upon itself, so several are fitted together: every
/// valve with its own parameters, these shared (variable projection: Golub, Pereyra, Inverse Problems 19 (2003) R1).
///
/// Each is kept only where the valves pay for it: what it takes off their cost is beyond what its parameters would by
/// chance once in a million, in each of them. A lag of the coil and the friction of a good spool (1 mA of 1 A) were
/// tried beside them and paid for nothing.
///
/// valves   at least one, the first few are used
/// options  knots and reference pressure; `usual` is where the search begins
/// Errors   as fit_valve
Result<UsualMechanisms> learn_usual_mechanisms(std::span<const ValveRecordings> valves, ValveFitOptions options);

}  // namespace valvetriage
