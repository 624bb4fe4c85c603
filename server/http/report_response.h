#pragma once

#include <string>

#include "server/http/exchange.h"

namespace valvetriage::http {

/// A report as an answer, under a policy that lets it run and load nothing.
Response report_response(std::string html);

}  // namespace valvetriage::http
