#pragma once

#include <string>

#include "core/result.h"
#include "server/http/exchange.h"
#include "server/wire/json.h"

namespace valvetriage::http {

/// HTTP status of an error code: 422 for bad recordings and documents, the codes of the front and the store by table,
/// 500 for codes of our own faults.
int status_of(const std::string& code);

/// A fault of ours or of the machine, whose message is for the operator: it may name paths and SQL.
bool is_fault(const std::string& code);

/// RFC 9457 document of an error: type, title, status, detail, code and, where known, file, line, column, field, found,
/// expected.
Json problem_document(const Error& error);

/// The document as an answer; of a fault it says the code only. `Retry-After` where waiting helps.
Response problem(const Error& error);

}  // namespace valvetriage::http
