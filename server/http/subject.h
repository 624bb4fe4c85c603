#pragma once

#include "server/http/exchange.h"
#include "server/http/service.h"
#include "server/wire/analysis_json.h"

namespace valvetriage::http {

/// What /v1/recordings/{id}/... and /v1/submissions/{id}/... speak of. Errors `not_found`; the store's.

/// The submission, or the one that the recording belongs to.
Result<SubmissionRow> submission_asked_for(Service& service, const Request& request);

/// The recording; of a submission the only one, or that of `recording=ID`. Errors `recording_needed` where several are
/// there and none is chosen.
Result<RecordingRow> recording_asked_for(Service& service, const Request& request);

/// The newest analysis. Errors `not_finished` while there is none yet, or the problem that ended the job.
Result<AnalysisRow> analysis_asked_for(Service& service, const SubmissionRow& submission);

/// The reference that an analysis was made with, where showing it needs that: where a recording of it leaves the
/// reference's range, or what good valves leave on its tests was taken off. Empty where the reference is no longer
/// there as well.
Result<std::optional<Reference>> reference_to_show(Service& service, const Analysis& analysis);

/// What a stored analysis says. Errors `not_available` where it is of a format that this version cannot read.
Result<AnalysisDocument> stored_analysis(Service& service, const AnalysisRow& row);

}  // namespace valvetriage::http
