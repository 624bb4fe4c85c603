#include "core/recording/columns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/recording/limits.h"
#include "core/recording/text.h"

namespace valvetriage {
namespace {

tl::unexpected<Error> column_error(std::string code, std::string_view field, std::string_view found,
                                   std::string expected, std::string message) {
  Error error{.code = std::move(code), .message = std::move(message)};
  error.field = shown(field);
  error.found = shown(found);
  error.expected = std::move(expected);
  return tl::unexpected(error);
}

tl::unexpected<Error> bad_columns(std::string_view found, std::string expected) {
  std::string message = fmt::format("columns: found '{}', expected {}", shown(found), expected);
  return column_error("bad_columns", "columns", found, std::move(expected), std::move(message));
}

/// What a role is called in the contract's own column names and in `--columns`.
struct RoleNames {
  ColumnRole role;
  std::string_view quantity;
  std::string_view option;
  std::string ColumnMapping::*mapped;
};
constexpr RoleNames kRoles[] = {{ColumnRole::kTime, "time", "time", &ColumnMapping::time},
                                {ColumnRole::kInput, "current", "input", &ColumnMapping::input},
                                {ColumnRole::kOutput, "pressure", "output", &ColumnMapping::output}};

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    if (!text.empty()) text += ',';
    text += name;
    if (text.size() > 200) return text + "...";
  }
  return text;
}

/// The one place where `matches` holds; nothing where it holds nowhere.
template <typename Matches>
Result<std::optional<std::size_t>> find_only(const std::vector<std::string>& names, const Matches& matches) {
  std::optional<std::size_t> at;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!matches(names[i])) continue;
    if (at) {
      const std::string message =
          fmt::format("column {} ({}): columns {} and {} ({}) both fit; name one with --columns", i + 1,
                      shown(names[i]), *at + 1, i + 1, shown(names[i]));
      auto error = column_error("duplicate_column", names[i], names[i], "one such column", message);
      error.value().column = i + 1;
      return error;
    }
    at = i;
  }
  return at;
}

PlannedColumn planned(ColumnRole role, std::size_t index, const std::string& name) {
  const auto [quantity, suffix] = split_column_name(name);
  PlannedColumn column{.role = role, .index = index, .channel = {}};
  column.channel.name = name;
  if (const UnitScale* unit = find_unit(role, suffix)) {
    column.channel.quantity = quantity;
    column.channel.unit = unit->unit;
    column.channel.file_unit = suffix;
    column.channel.file_unit_scale = unit->scale;
  } else {
    column.channel.quantity = name;
    column.channel.unit = std::string(role == ColumnRole::kTime ? "s" : "");
  }
  return column;
}

Result<PlannedColumn> plan_mapped(const std::vector<std::string>& names, ColumnRole role, const std::string& wanted) {
  const auto at = find_only(names, [&](const std::string& name) { return name == wanted; });
  if (!at) return tl::unexpected(at.error());
  if (!*at) {
    return column_error(
        "missing_column", wanted, joined(names), wanted,
        fmt::format("there is no column '{}'; the columns are {}", shown(wanted), shown(joined(names))));
  }
  return planned(role, **at, wanted);
}

/// The contract's column of a role, nothing where there is none.
Result<std::optional<PlannedColumn>> plan_default(const std::vector<std::string>& names, const RoleNames& role) {
  const auto at = find_only(names, [&](const std::string& name) {
    return name == role.quantity || split_column_name(name).quantity == role.quantity;
  });
  if (!at) return tl::unexpected(at.error());
  if (!*at) return std::nullopt;
  const std::string& name = names[**at];
  const std::string_view suffix = name == role.quantity ? "" : split_column_name(name).suffix;
  if (find_unit(role.role, suffix) == nullptr) {
    const std::string expected = fmt::format("{}_ and one of {}", role.quantity, accepted_units(role.role));
    auto error = column_error("unknown_unit", name, suffix, expected,
                              fmt::format("column {} ({}): '{}' is not a unit of {}; expected {}", **at + 1,
                                          shown(name), shown(suffix), role.quantity, accepted_units(role.role)));
    error.value().column = **at + 1;
    return error;
  }
  return planned(role.role, **at, name);
}

Result<void> check_mapping_is_injective(const ColumnMapping& mapping) {
  std::vector<std::string> used;
  for (const RoleNames& role : kRoles) {
    if (!(mapping.*role.mapped).empty()) used.push_back(mapping.*role.mapped);
  }
  used.insert(used.end(), mapping.side.begin(), mapping.side.end());
  std::ranges::sort(used);
  const auto twice = std::ranges::adjacent_find(used);
  if (twice != used.end()) return bad_columns(*twice, "each column in one role");
  return {};
}

}  // namespace

Result<ColumnMapping> parse_column_mapping(std::string_view text) {
  ColumnMapping mapping;
  bool in_side = false;
  while (!text.empty()) {
    const std::string_view part = trim(text.substr(0, text.find(',')));
    text.remove_prefix(
        std::min(text.size(), text.find(',') == std::string_view::npos ? text.size() : text.find(',') + 1));
    const std::size_t equals = part.find('=');
    const std::string_view option = equals == std::string_view::npos ? "" : trim(part.substr(0, equals));
    const std::string_view name = equals == std::string_view::npos ? part : trim(part.substr(equals + 1));
    if (name.empty() || name.size() > kMaxColumnNameBytes || !is_clean_utf8(name)) {
      return bad_columns(part, "a column name");
    }
    if (option == "side" || (option.empty() && in_side)) {
      in_side = true;
      mapping.side.emplace_back(name);
      if (mapping.side.size() > kMaxSideInputs)
        return bad_columns(part, fmt::format("at most {} side inputs", kMaxSideInputs));
      continue;
    }
    in_side = false;
    const auto* role = std::ranges::find(kRoles, option, &RoleNames::option);
    if (role == std::end(kRoles)) return bad_columns(part, "time=, input=, output= or side=");
    if (!(mapping.*role->mapped).empty()) return bad_columns(part, fmt::format("{}= once", option));
    mapping.*role->mapped = name;
  }
  if (auto checked = check_mapping_is_injective(mapping); !checked) return tl::unexpected(checked.error());
  return mapping;
}

Result<void> check_sample_rate(double sample_rate_hz) {
  if (sample_rate_hz >= kMinSampleRateHz && sample_rate_hz <= kMaxSampleRateHz) return {};
  const std::string expected = fmt::format("a rate from {} to {} Hz", kMinSampleRateHz, kMaxSampleRateHz);
  return column_error("bad_sample_rate", "sample_rate_hz", fmt::format("{}", sample_rate_hz), expected,
                      fmt::format("sample_rate_hz: found {}, expected {}", sample_rate_hz, expected));
}

Result<std::vector<PlannedColumn>> plan_columns(const std::vector<std::string>& names, const ColumnMapping& mapping) {
  if (auto checked = check_mapping_is_injective(mapping); !checked) return tl::unexpected(checked.error());
  if (mapping.sample_rate_hz) {
    if (auto checked = check_sample_rate(*mapping.sample_rate_hz); !checked) return tl::unexpected(checked.error());
  }
  std::vector<PlannedColumn> plan;
  for (const RoleNames& role : kRoles) {
    const std::string& mapped = mapping.*role.mapped;
    if (!mapped.empty()) {
      auto column = plan_mapped(names, role.role, mapped);
      if (!column) return tl::unexpected(column.error());
      plan.push_back(std::move(*column));
      continue;
    }
    auto column = plan_default(names, role);
    if (!column) return tl::unexpected(column.error());
    if (*column) {
      plan.push_back(std::move(**column));
    } else if (role.role == ColumnRole::kOutput && mapping.output_optional) {
      continue;
    } else if (role.role != ColumnRole::kTime || !mapping.sample_rate_hz) {
      const std::string expected = fmt::format("{}_ and one of {}", role.quantity, accepted_units(role.role));
      return column_error(
          "missing_column", role.option, joined(names), expected,
          fmt::format("there is no column for the {} ({}); the columns are {}; name one with --columns {}=NAME{}",
                      role.option, expected, shown(joined(names)), role.option,
                      role.role == ColumnRole::kTime ? " or give --sample-rate-hz" : ""));
    }
  }
  if (mapping.sample_rate_hz && plan.front().role == ColumnRole::kTime) {
    return bad_columns(fmt::format("sample_rate_hz beside {}", plan.front().channel.name),
                       "a sampling rate only where there is no time column");
  }
  for (const std::string& wanted : mapping.side) {
    auto column = plan_mapped(names, ColumnRole::kSide, wanted);
    if (!column) return tl::unexpected(column.error());
    plan.push_back(std::move(*column));
  }
  return plan;
}

bool may_be_planned(std::string_view name, const ColumnMapping& mapping) {
  for (const RoleNames& role : kRoles) {
    const std::string& mapped = mapping.*role.mapped;
    if (!mapped.empty() ? name == mapped : name == role.quantity || split_column_name(name).quantity == role.quantity) {
      return true;
    }
  }
  return std::ranges::find(mapping.side, name) != mapping.side.end();
}

void place_channels(std::vector<PlannedColumn> columns, RawRecording& raw) {
  for (PlannedColumn& column : columns) {
    if (column.channel.file_unit_scale != 1.0) {
      for (double& value : column.channel.values) value *= column.channel.file_unit_scale;
    }
    switch (column.role) {
      case ColumnRole::kTime:
        raw.time = std::move(column.channel);
        break;
      case ColumnRole::kInput:
        raw.input = std::move(column.channel);
        break;
      case ColumnRole::kOutput:
        raw.output = std::move(column.channel);
        break;
      case ColumnRole::kSide:
        raw.side.push_back(std::move(column.channel));
        break;
    }
  }
}

}  // namespace valvetriage
