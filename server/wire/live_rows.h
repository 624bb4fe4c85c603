#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "core/recording/columns.h"
#include "core/recording/metadata.h"

namespace valvetriage {

/// One row of a live stream, in s, A and psi (or the columns' own numbers).
struct LiveRow {
  double time_s = 0;
  double input = 0;
  double output = 0;
};

/// CSV rows as they come, one line at a time: what parse_csv reads from a whole file, without looking ahead.
class LiveRows {
 public:
  /// given  metadata that stand beside the rows
  explicit LiveRows(ColumnMapping mapping, Metadata given = {})
      : mapping_(std::move(mapping)), given_(std::move(given)) {}

  /// A line without its end. Empty for `#` lines, blank lines and the header.
  ///
  /// Errors  those of plan_columns for the header; those of parse_metadata_line, and contradicting_metadata, for what
  ///         stands ahead of it; ragged_row, not_a_number, not_finite and time_not_increasing with
  /// line
  ///         and column for a row, which then counts as not seen
  Result<std::optional<LiveRow>> take(std::string_view line);

  std::size_t rows() const { return rows_; }
  /// Mean period of the rows so far [s]; 0 before the second.
  double sample_period_s() const;

 private:
  Error at_line(Error error) const;
  Result<void> read_header(const std::vector<std::string_view>& fields);
  Result<double> read_field(const std::vector<std::string_view>& fields, const PlannedColumn& column) const;

  ColumnMapping mapping_;
  Metadata given_, said_;
  std::vector<PlannedColumn> columns_;
  std::size_t fields_ = 0;
  char separator_ = ',';
  std::size_t line_ = 0;
  std::size_t rows_ = 0;
  double first_time_s_ = 0;
  double last_time_s_ = 0;
};

}  // namespace valvetriage
