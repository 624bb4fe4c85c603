#pragma once

#include "core/result.h"
#include "server/http/exchange.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// One function per route of the table in routes.cpp; what each does is said in schemas/openapi.yaml.
// clang-format off
#define VALVETRIAGE_HANDLERS(X) \
  X(post_recording) \
  X(post_submission) \
  X(post_reanalyze) \
  X(list_recordings) \
  X(get_recording) \
  X(get_recording_raw) \
  X(get_analysis) \
  X(list_analyses) \
  X(get_summary) \
  X(list_causes) \
  X(get_report) \
  X(get_plot) \
  X(get_lot_report) \
  X(get_events) \
  X(get_stored_analysis) \
  X(list_submissions) \
  X(get_submission) \
  X(get_submission_raw) \
  X(get_job) \
  X(post_cancel) \
  X(get_series) \
  X(get_marks) \
  X(post_simulation) \
  X(list_lots) \
  X(get_lot) \
  X(get_lot_history) \
  X(get_lot_parameters) \
  X(get_lot_shifts) \
  X(get_lot_patterns) \
  X(get_comparison) \
  X(list_stands) \
  X(get_confusion) \
  X(get_valve) \
  X(post_finding) \
  X(list_references) \
  X(post_reference) \
  X(get_reference) \
  X(list_rule_bases) \
  X(post_rule_base) \
  X(get_rule_base) \
  X(list_tokens) \
  X(post_token) \
  X(delete_token) \
  X(get_metrics) \
  X(get_openapi) \
  X(get_healthz) \
  X(get_readyz) \
  X(get_page) \
  X(get_page_file)
// clang-format on

#define X(name) Result<Response> name(Service& service, Request& request);
VALVETRIAGE_HANDLERS(X)
#undef X

}  // namespace valvetriage::http
