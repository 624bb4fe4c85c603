#include "server/commands/server_options.h"

#include <cstdlib>
#include <fstream>

#include "core/recording/text.h"

namespace valvetriage {
namespace {

Result<std::string> read_token(const std::string& file) {
  if (file.empty()) {
    const char* token = std::getenv("VALVETRIAGE_TOKEN");
    return std::string(token ? token : "");
  }
  std::ifstream in(file);
  std::string token;
  if (in && std::getline(in, token)) return std::string(trim(token));
  Error error{.code = "cannot_read", .message = "the token file cannot be read or is empty"};
  error.file = file;
  return tl::unexpected(error);
}

}  // namespace

CLI::Option* add_server_options(CLI::App& verb, ServerOptions& options) {
  verb.add_option("--token-file", options.token_file, "File with the access token; else VALVETRIAGE_TOKEN");
  return verb.add_option("--server", options.url, "http://HOST:PORT or unix:PATH");
}

Result<http::Client> open_client(const ServerOptions& options) {
  return read_token(options.token_file).and_then([&](const std::string& token) {
    return http::Client::open(options.url, token);
  });
}

}  // namespace valvetriage
