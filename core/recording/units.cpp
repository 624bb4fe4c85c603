#include "core/recording/units.h"

#include <array>
#include <vector>

namespace valvetriage {
namespace {

constexpr double kPascalPerPsi = 6894.757293168361;

struct RoleUnit {
  ColumnRole role;
  UnitScale unit;
};

constexpr std::array<RoleUnit, 8> kUnits{{{ColumnRole::kTime, {"s", "s", 1.0}},
                                          {ColumnRole::kTime, {"ms", "s", 1e-3}},
                                          {ColumnRole::kInput, {"A", "A", 1.0}},
                                          {ColumnRole::kInput, {"mA", "A", 1e-3}},
                                          {ColumnRole::kOutput, {"psi", "psi", 1.0}},
                                          {ColumnRole::kOutput, {"kPa", "psi", 1e3 / kPascalPerPsi}},
                                          {ColumnRole::kOutput, {"bar", "psi", 1e5 / kPascalPerPsi}},
                                          {ColumnRole::kOutput, {"MPa", "psi", 1e6 / kPascalPerPsi}}}};

}  // namespace

const UnitScale* find_unit(ColumnRole role, std::string_view suffix) {
  for (const RoleUnit& known : kUnits) {
    if ((role == ColumnRole::kSide || role == known.role) && known.unit.suffix == suffix) return &known.unit;
  }
  return nullptr;
}

std::string accepted_units(ColumnRole role) {
  std::vector<std::string_view> suffixes;
  for (const RoleUnit& known : kUnits) {
    if (role == ColumnRole::kSide || role == known.role) suffixes.push_back(known.unit.suffix);
  }
  std::string text(suffixes.front());
  for (std::size_t i = 1; i < suffixes.size(); ++i) {
    text += i + 1 == suffixes.size() ? " or " : ", ";
    text += suffixes[i];
  }
  return text;
}

ColumnName split_column_name(std::string_view name) {
  const std::size_t at = name.rfind('_');
  if (at == std::string_view::npos) return {name, {}};
  return {name.substr(0, at), name.substr(at + 1)};
}

}  // namespace valvetriage
