#pragma once

#include "core/result.h"
#include "server/http/lot_history.h"
#include "server/store/store.h"
#include "server/wire/json.h"

namespace valvetriage::http {

/// Every submission that fits, newest first, up to `most` and the rest of a page.
Result<std::vector<SubmissionRow>> all_submissions(Store& store, const Filter& filter, std::size_t most);

/// The valves whose submissions fit: of a lot, of a stand.
Result<LotHistory> stored_history(Store& store, const Filter& filter);

/// The newest analysis of a valve as it is stored.
Result<Json> newest_document(Store& store, const SubmissionRow& valve);

/// The settled causes in the newest analysis of a valve, entries of `discrepancy.causes`; an empty array without any.
Result<Json> named_causes(Store& store, const SubmissionRow& valve);

}  // namespace valvetriage::http
