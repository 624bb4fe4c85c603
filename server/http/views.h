#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "server/http/exchange.h"
#include "server/http/lot_history.h"
#include "server/store/store.h"
#include "server/wire/json.h"

namespace valvetriage::http {

/// Rows as the contract shows them (section 5).
Json view(const RecordingRow& row);
Json view(const SubmissionRow& row);
/// The same with its recordings.
Json view(const SubmissionRow& row, const std::vector<RecordingRow>& recordings);
Json view(const JobRow& row);
Json view(const AnalysisRow& row);
Json view(const LotRow& row);
Json view(const FindingRow& row);
Json view(const DocumentRow& row);
Json view(const TokenRow& row);
/// valves  that the alarm's indices are of
Json view(const StandAlarm& alarm, const std::vector<SubmissionRow>& valves);

Response json_response(const Json& document, int status = 200);

/// Whether `format`, or without it Accept, asks for text/csv. Errors `bad_parameter` for any other format than json.
Result<bool> wants_csv(const Request& request);

/// A list as JSON, {"items", "next"}, or as text/csv where that is asked for. A CSV has the members of the items as its
/// columns, none where there are no items; `next` stands in the header X-Next-Cursor. Errors as wants_csv
Result<Response> list_response(const Request& request, std::vector<Json> items, const std::optional<std::string>& next);
/// A page of a list that is short enough to be held whole: all of it where no `limit` is given. Errors as wants_csv and
/// page_request, and `invalid_cursor`
Result<Response> whole_list_response(const Request& request, std::vector<Json> items);

/// `limit` and `cursor`. Errors `bad_parameter`.
Result<PageRequest> page_request(const Request& request);
/// Gives the response the entity tag of that name. Whether the client has it (If-None-Match): the answer is then 304.
bool is_known(const Request& request, std::string_view name, Response& response);
/// The filters of the lists. Errors `bad_parameter` for a time that is not RFC 3339, a verdict or cause that is none.
Result<Filter> filter_of(const Request& request);

/// CSV rows of objects: RFC 4180, one header line, numbers as they are, texts that a spreadsheet would take for a
/// formula (first character = + - @, tab, return) behind an apostrophe, other values as JSON text.
std::string to_csv(const std::vector<Json>& items);

}  // namespace valvetriage::http
