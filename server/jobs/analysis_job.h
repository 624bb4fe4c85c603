#pragma once

#include "server/jobs/child_protocol.h"

namespace valvetriage {

/// What an analysis child does: reads the job's recordings, analyses them together, gives the row to store.
///
/// Errors  those of reading and of `analyze_session`, final; a file that cannot be opened now is a passing fault
/// Cost    seconds and hundreds of megabytes for the largest session: run it in a process of its own
Result<NewAnalysis> run_analysis_job(const JobSpec& spec, const StageReport& progress);

}  // namespace valvetriage
