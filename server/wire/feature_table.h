#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/classify/learn.h"

namespace valvetriage {

/// Limits on a feature table, since anybody may upload one: 100,000 rows are two years of a busy stand.
inline constexpr std::size_t kMaxTableBytes = 16 << 20;
inline constexpr std::size_t kMaxTableRows = 100'000;
inline constexpr std::size_t kMaxTableColumns = 256;

/// One valve of a table.
struct FeatureRow {
  std::size_t line = 0;  ///< 1-based line in the text
  std::string serial{};  ///< empty where the table does not say
  std::vector<LevelFeatures> levels{};
  std::optional<Verdict> verdict{};
};

struct FeatureTable {
  std::vector<std::string> feature_columns;  ///< as named in the header, the verdict not among them
  bool has_verdicts = false;                 ///< there is a `verdict` column: then every row has one
  std::vector<FeatureRow> rows;
};

/// A table of valves: a header line, then one valve per line.
///
///   error_low, error_high        Eq 20 at 1.4 A and at 1.6 A, or one per level: error_1.4, error_1.8A
///   settling_error_<level>, rise_time_<level> [s], bandwidth_<level> [Hz]
///                                where they are there; an empty field is a value not measured
///   verdict                      Good, Malfunctioned or Severe
///   serial                       which valve it is, for what is printed
///
/// Separator `,` `;` or tab; a decimal comma with the latter two; UTF-8 with or without BOM; LF or CRLF; lines that
/// start with `#` and empty lines are skipped; other columns are ignored.
///
/// Errors  `missing_column`, `duplicate_column`, `not_a_number`, `not_finite`, `negative`, `not_positive`,
///         `wrong_field_count`, `unknown_verdict`, `no_rows`, `too_large`; with line, column, found and expected
Result<FeatureTable> parse_feature_table(std::string_view text);

/// The rows that can be learned from.
///
/// Errors  `missing_column` without a verdict column
Result<std::vector<LabelledValve>> labelled_valves(const FeatureTable& table);

}  // namespace valvetriage
