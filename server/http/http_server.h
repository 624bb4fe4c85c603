#pragma once

#include <memory>

#include "server/http/front.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// The front that answers with the routes of routes.h, counts, and logs where `log_requests`. The service lives longer.
std::unique_ptr<Front> make_http_server(Service& service, Listener listener, int connections, bool log_requests);

}  // namespace valvetriage::http
