#include <fmt/format.h>

#include <array>
#include <charconv>
#include <utility>

#include "server/store/sqlite/operations.h"
#include "server/store/sqlite/rows.h"

namespace valvetriage::sqlite {
namespace {

tl::unexpected<Error> not_found(std::string_view what, std::string_view id) {
  return fail("not_found", fmt::format("there is no {} '{}'", what, id));
}

Result<void> check_limit(int limit) {
  if (limit >= 1 && limit <= kMaxPageLimit) return {};
  return fail("invalid_limit", fmt::format("limit is {}, it must be 1 to {}", limit, kMaxPageLimit));
}

/// Where a page ended: the sort key of its last row, most significant first.
struct Position {
  std::int64_t received_at = 0;
  std::int64_t submission_seq = 0;
  std::int64_t row_seq = 0;
};

std::string to_cursor(const Position& position) {
  return fmt::format("c1-{:x}-{:x}-{:x}", position.received_at, position.submission_seq, position.row_seq);
}

Result<Position> from_cursor(std::string_view cursor) {
  const tl::unexpected<Error> invalid = fail("invalid_cursor", "cursor is not one that an earlier page gave as 'next'");
  if (cursor.substr(0, 2) != "c1") return invalid;
  cursor.remove_prefix(2);
  Position position;
  for (std::int64_t* part : {&position.received_at, &position.submission_seq, &position.row_seq}) {
    if (cursor.empty() || cursor[0] != '-') return invalid;
    const auto [end, error] = std::from_chars(cursor.data() + 1, cursor.data() + cursor.size(), *part, 16);
    if (error != std::errc{}) return invalid;
    cursor.remove_prefix(static_cast<std::size_t>(end - cursor.data()));
  }
  if (!cursor.empty()) return invalid;
  return position;
}

Result<std::optional<Position>> start_of(const PageRequest& page) {
  if (auto sound = check_limit(page.limit); !sound) return tl::unexpected(sound.error());
  if (!page.cursor) return std::nullopt;
  const auto position = from_cursor(*page.cursor);
  if (!position) return tl::unexpected(position.error());
  return *position;
}

/// A list of submissions newest first, in the pieces of its SQL. A submission has several causes, so these stand in a
/// table of their own: where the cause is the most selective filter, that table leads, in the order of the list.
struct ListSql {
  std::string from, where, order;
};

ListSql list_sql(const Filter& filter, const std::optional<Position>& start, std::string_view row_seq) {
  const bool by_cause = filter.cause && !filter.serial && !filter.lot && !filter.stand;
  // The most selective filter given walks its index in the order of the list; a unary plus keeps the planner, which has
  // no statistics, from choosing any other.
  const std::array<std::pair<bool, std::string_view>, 5> by_selectivity = {
      {{filter.serial.has_value(), "s.serial"},
       {filter.lot.has_value(), "s.lot"},
       {filter.stand.has_value(), "s.stand"},
       {filter.verdict.has_value(), "s.verdict"},
       {filter.valve_type.has_value(), "s.valve_type"}}};
  std::string where = "WHERE 1";
  bool index_chosen = by_cause;
  for (const auto& [given, column] : by_selectivity) {
    if (!given) continue;
    where += fmt::format(" AND {}{} = ?", index_chosen ? "+" : "", column);
    index_chosen = true;
  }
  if (by_cause) where += " AND c.cause = ?";
  if (filter.cause && !by_cause) {
    where +=
        " AND EXISTS (SELECT 1 FROM submission_causes c WHERE c.cause = ? AND c.received_at = s.received_at AND "
        "c.submission_seq = s.seq)";
  }
  const std::string time = by_cause ? "c.received_at" : "s.received_at";
  const std::string seq = by_cause ? "c.submission_seq" : "s.seq";
  if (filter.since) where += fmt::format(" AND {} >= ?", time);
  if (filter.until) where += fmt::format(" AND {} < ?", time);
  if (start) where += fmt::format(" AND {0} <= ? AND ({0}, {1}, {2}) < (?, ?, ?)", time, seq, row_seq);
  // CROSS JOIN fixes the order of the loops.
  return {.from = by_cause ? "FROM submission_causes c CROSS JOIN submissions s ON s.seq = c.submission_seq"
                           : "FROM submissions s",
          .where = where,
          .order = fmt::format("ORDER BY {} DESC, {} DESC", time, seq)};
}

/// In the order of list_sql, then the list's LIMIT: one row more than the page, to see whether there is a next.
void bind_list(Query& query, const Filter& filter, const std::optional<Position>& start, int limit) {
  for (const auto* text :
       {&filter.serial, &filter.lot, &filter.stand, &filter.verdict, &filter.valve_type, &filter.cause}) {
    if (*text) query.bind(**text);
  }
  if (filter.since) query.bind(*filter.since);
  if (filter.until) query.bind(*filter.until);
  if (start) {
    query.bind(start->received_at);
    query.bind(start->received_at);
    query.bind(start->submission_seq);
    query.bind(start->row_seq);
  }
  query.bind(limit + 1);
}

std::vector<RecordingRow> read_recordings(Query& query, const SubmissionRow& submission) {
  std::vector<RecordingRow> rows;
  while (query.next()) rows.push_back(read_recording(query, submission).row);
  return rows;
}

void count_valves(Connection& connection, LotRow& row) {
  Query query =
      connection.query("SELECT analysed, verdict, valves FROM lot_counts WHERE lot = ? AND valves > 0", row.lot);
  while (query.next()) {
    const bool analysed = query.integer() != 0;
    const std::string verdict = query.text();
    const std::int64_t valves = query.integer();
    row.valves += valves;
    if (!analysed) continue;
    row.analysed_valves += valves;
    row.verdicts[verdict] += valves;
  }
  Query causes = connection.query("SELECT cause, count(*) FROM lot_causes WHERE lot = ? GROUP BY cause", row.lot);
  while (causes.next()) {
    const std::string cause = causes.text();
    row.causes[cause] = causes.integer();
  }
}

constexpr std::string_view kLotColumns = "seq, lot, first_received_at, last_received_at, recordings, submissions";

std::pair<std::int64_t, LotRow> read_lot(Query& query) {
  const std::int64_t seq = query.integer();
  LotRow row;
  row.lot = query.text();
  row.first_received_at = query.integer();
  row.last_received_at = query.integer();
  row.recordings = query.integer();
  row.submissions = query.integer();
  return {seq, row};
}

}  // namespace

Result<std::int64_t> submission_seq(Connection& connection, std::string_view id) {
  Query query = connection.query("SELECT seq FROM submissions WHERE id = ?", id);
  if (!query.next()) return not_found("submission", id);
  return query.integer();
}

Result<SubmissionRow> submission_at(Connection& connection, std::int64_t seq) {
  static const std::string sql = fmt::format("SELECT {} FROM submissions s WHERE s.seq = ?", kSubmissionColumns);
  Query query = connection.query(sql, seq);
  if (!query.next()) return not_found("submission", std::to_string(seq));
  return read_submission(query).row;
}

Result<SubmissionRow> submission(Connection& connection, std::string_view id) {
  const auto seq = submission_seq(connection, id);
  if (!seq) return tl::unexpected(seq.error());
  return submission_at(connection, *seq);
}

std::vector<RecordingRow> recordings_at(Connection& connection, std::int64_t submission_seq) {
  static const std::string sql =
      fmt::format("SELECT {} FROM recordings r WHERE r.submission_seq = ? ORDER BY r.seq", kRecordingColumns);
  const auto submission = submission_at(connection, submission_seq);
  if (!submission) return {};
  Query query = connection.query(sql, submission_seq);
  return read_recordings(query, *submission);
}

Result<RecordingRow> recording(Connection& connection, std::string_view id) {
  static const std::string sql =
      fmt::format("SELECT {}, {} FROM recordings r JOIN submissions s ON s.seq = r.submission_seq WHERE r.id = ?",
                  kSubmissionColumns, kRecordingColumns);
  Query query = connection.query(sql, id);
  if (!query.next()) return not_found("recording", id);
  const SubmissionAt submission = read_submission(query);
  return read_recording(query, submission.row).row;
}

Result<Page<RecordingRow>> list_recordings(Connection& connection, const Filter& filter, const PageRequest& page) {
  const auto start = start_of(page);
  if (!start) return tl::unexpected(start.error());
  const ListSql sql = list_sql(filter, *start, "r.seq");
  // Submissions by their index, newest first, then the recordings of each.
  Query query = connection.query(
      fmt::format("SELECT {}, {} {} CROSS JOIN recordings r ON r.submission_seq = s.seq {} {}, r.seq DESC LIMIT ?",
                  kSubmissionColumns, kRecordingColumns, sql.from, sql.where, sql.order));
  bind_list(query, filter, *start, page.limit);
  Page<RecordingRow> result;
  Position last;
  while (query.next()) {
    if (static_cast<int>(result.items.size()) == page.limit) {
      result.next = to_cursor(last);
      break;
    }
    const SubmissionAt submission = read_submission(query);
    RecordingAt recording = read_recording(query, submission.row);
    last = {submission.row.received_at, submission.seq, recording.seq};
    result.items.push_back(std::move(recording.row));
  }
  return result;
}

Result<Page<SubmissionRow>> list_submissions(Connection& connection, const Filter& filter, const PageRequest& page) {
  const auto start = start_of(page);
  if (!start) return tl::unexpected(start.error());
  const ListSql sql = list_sql(filter, *start, "0");
  Query query =
      connection.query(fmt::format("SELECT {} {} {} {} LIMIT ?", kSubmissionColumns, sql.from, sql.where, sql.order));
  bind_list(query, filter, *start, page.limit);
  Page<SubmissionRow> result;
  Position last;
  while (query.next()) {
    if (static_cast<int>(result.items.size()) == page.limit) {
      result.next = to_cursor(last);
      break;
    }
    SubmissionAt submission = read_submission(query);
    last = {submission.row.received_at, submission.seq, 0};
    result.items.push_back(std::move(submission.row));
  }
  return result;
}

Result<Page<LotRow>> list_lots(Connection& connection, const PageRequest& page) {
  static const std::string sql =
      fmt::format("SELECT {} FROM lots WHERE seq < ? ORDER BY seq DESC LIMIT ?", kLotColumns);
  const auto start = start_of(page);
  if (!start) return tl::unexpected(start.error());
  const std::int64_t before = *start ? (*start)->row_seq : INT64_MAX;
  Query query = connection.query(sql, before, page.limit + 1);
  Page<LotRow> result;
  std::int64_t last = 0;
  while (query.next()) {
    if (static_cast<int>(result.items.size()) == page.limit) {
      result.next = to_cursor({0, 0, last});
      break;
    }
    auto [seq, row] = read_lot(query);
    count_valves(connection, row);
    last = seq;
    result.items.push_back(std::move(row));
  }
  return result;
}

Result<LotRow> lot(Connection& connection, std::string_view name) {
  static const std::string sql = fmt::format("SELECT {} FROM lots WHERE lot = ?", kLotColumns);
  Query query = connection.query(sql, name);
  if (!query.next()) return not_found("lot", name);
  LotRow row = read_lot(query).second;
  count_valves(connection, row);
  return row;
}

}  // namespace valvetriage::sqlite
