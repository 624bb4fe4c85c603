#pragma once

#include <string>
#include <string_view>

namespace valvetriage {

/// What a column is for. A side input may be of any quantity.
enum class ColumnRole { kTime, kInput, kOutput, kSide };

/// An accepted unit suffix and what a number in it is multiplied with to be in `unit` (s, A or psi).
struct UnitScale {
  std::string_view suffix;
  std::string_view unit;
  double scale;
};

/// The unit that `suffix` names for a column of this role; nullptr where it names none.
///
///   time s ms; current A mA; pressure psi kPa bar MPa; 1 psi = 6894.757293168 Pa (lbf/in² by definition)
const UnitScale* find_unit(ColumnRole role, std::string_view suffix);

/// The accepted suffixes of a role as a sentence part: "psi, kPa, bar or MPa".
std::string accepted_units(ColumnRole role);

/// A column name split after its last `_`: `current_A` -> {current, A}; no suffix where there is no `_`.
struct ColumnName {
  std::string_view quantity;
  std::string_view suffix;
};
ColumnName split_column_name(std::string_view name);

}  // namespace valvetriage
