#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "server/http/client.h"

namespace valvetriage {

/// The running server that a verb speaks to, and as whom.
struct ServerOptions {
  std::string url;         ///< http://HOST:PORT or unix:PATH
  std::string token_file;  ///< empty: the token is in VALVETRIAGE_TOKEN, or none is needed
};

/// Adds --server and --token-file; the first is returned. `options` has to live as long as the application.
CLI::Option* add_server_options(CLI::App& verb, ServerOptions& options);

/// Errors  `cannot_read` for the token file, `bad_parameter` for the URL
Result<http::Client> open_client(const ServerOptions& options);

}  // namespace valvetriage
