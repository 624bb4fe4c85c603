#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/recording/recording.h"
#include "core/recording/units.h"

namespace valvetriage {

/// A `--columns` or `columns=` text, `time=t_s,input=u,output=y,side=a,b`. A name without `=` continues `side`.
///
/// Errors  `bad_columns` naming the part; a role named twice, one column in two roles, no name, too many side inputs
Result<ColumnMapping> parse_column_mapping(std::string_view text);

/// Checks a sampling rate from outside: finite, within limits.h.
Result<void> check_sample_rate(double sample_rate_hz);

/// Which file column serves a role: its index in the table and the empty channel it fills.
struct PlannedColumn {
  ColumnRole role = ColumnRole::kTime;
  std::size_t index = 0;
  Channel channel;
};

/// Finds the columns of a table by its names: the mapping's, else `time_*`, `current_*`, `pressure_*`.
/// In the order time (where there is one), input, output, side inputs.
///
/// A contract column must carry an accepted unit. A mapped one with an accepted unit of its role is converted, any
/// other is unitless and keeps its numbers; a mapped time without an accepted unit is in seconds. Errors
/// `missing_column`, `unknown_unit`, `duplicate_column`, `bad_columns` (a sampling rate beside a time column)
Result<std::vector<PlannedColumn>> plan_columns(const std::vector<std::string>& names, const ColumnMapping& mapping);

/// Whether plan_columns could choose a column of this name: what a reader that sees names one by one must keep.
bool may_be_planned(std::string_view name, const ColumnMapping& mapping);

/// Moves filled channels into the recording's places and converts their numbers into their units.
void place_channels(std::vector<PlannedColumn> columns, RawRecording& raw);

}  // namespace valvetriage
