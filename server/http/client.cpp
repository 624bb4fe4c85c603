#include "server/http/client.h"

#include <fmt/format.h>
#include <httplib.h>
#include <sodium/randombytes.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "server/http/endpoint.h"
#include "server/http/limits.h"
#include "server/http/request_head.h"

namespace valvetriage::http {
namespace {

constexpr time_t kConnectTimeout_s = 10;
constexpr time_t kAnswerTimeout_s = 120;  // a server that fsyncs a large upload on a slow disk

std::string random_boundary() {
  return fmt::format("valvetriage-{:08x}{:08x}{:08x}{:08x}", randombytes_random(), randombytes_random(),
                     randombytes_random(), randombytes_random());
}

std::string part_head(const std::string& boundary, const std::string& file) {
  std::string name = std::filesystem::path(file).filename().string();
  for (char& c : name) {
    if (c == '"' || c == '\\' || has_control_character({&c, 1})) c = '_';
  }
  return fmt::format("--{}\r\nContent-Disposition: form-data; name=\"file\"; filename=\"{}\"\r\n\r\n", boundary, name);
}

/// The bytes of a multipart body, piece by piece.
class UploadBody {
 public:
  UploadBody(const Upload& upload, std::string boundary) : upload_(upload), boundary_(std::move(boundary)) {}
  ~UploadBody() {
    if (file_) std::fclose(file_);
  }
  UploadBody(const UploadBody&) = delete;
  UploadBody& operator=(const UploadBody&) = delete;

  /// The next piece; empty at the end. Errors `cannot_read`.
  Result<std::string> next() {
    if (file_) {
      std::string piece(kPieceBytes, '\0');
      piece.resize(std::fread(piece.data(), 1, piece.size(), file_));
      if (!piece.empty()) return piece;
      const bool broken = std::ferror(file_) != 0;
      std::fclose(std::exchange(file_, nullptr));
      if (broken) return cannot_read(upload_.files[at_ - 1]);
      return std::string("\r\n");
    }
    if (at_ < upload_.files.size()) {
      const std::string& name = upload_.files[at_++];
      file_ = std::fopen(name.c_str(), "rb");
      if (!file_) return cannot_read(name);
      return part_head(boundary_, name);
    }
    if (std::exchange(ended_, true)) return std::string();
    return fmt::format("--{}--\r\n", boundary_);
  }

 private:
  static tl::unexpected<Error> cannot_read(const std::string& file) {
    Error error{.code = "cannot_read", .message = "the file cannot be read"};
    error.file = file;
    return tl::unexpected(error);
  }

  const Upload& upload_;
  std::string boundary_;
  std::size_t at_ = 0;
  std::FILE* file_ = nullptr;
  bool ended_ = false;
};

Result<Answer> answer_of(const httplib::Result& result, const std::string& url) {
  if (!result) {
    return fail("no_connection", fmt::format("no answer from {}: {}", url, httplib::to_string(result.error())));
  }
  Answer answer{.status = result->status, .body = result->body, .retry_after_s = std::nullopt};
  const std::string wait = result->get_header_value("Retry-After");
  int seconds = 0;
  if (std::from_chars(wait.data(), wait.data() + wait.size(), seconds).ec == std::errc())
    answer.retry_after_s = seconds;
  return answer;
}

bool may_pass(const Result<Answer>& answer) {
  if (!answer) return answer.error().code == "no_connection";
  constexpr std::array kPassing{408, 429, 502, 503, 504};
  return std::find(kPassing.begin(), kPassing.end(), answer->status) != kPassing.end();
}

}  // namespace

struct Client::State {
  State(const Endpoint& endpoint, const std::string& token)
      : url(endpoint.url()),
        client(endpoint.is_unix() ? endpoint.socket_path : endpoint.host, endpoint.is_unix() ? 80 : endpoint.port) {
    if (endpoint.is_unix()) client.set_address_family(AF_UNIX);
    client.set_connection_timeout(kConnectTimeout_s);
    client.set_read_timeout(kAnswerTimeout_s);
    client.set_write_timeout(kAnswerTimeout_s);
    client.set_keep_alive(true);
    client.set_tcp_nodelay(true);
    if (endpoint.is_unix()) headers.emplace("Host", "localhost");
    if (!token.empty()) headers.emplace("Authorization", "Bearer " + token);
  }

  std::string url;
  httplib::Client client;
  httplib::Headers headers;
};

Client::Client(std::unique_ptr<State> state) : state_(std::move(state)) {}
Client::Client(Client&&) noexcept = default;
Client::~Client() = default;

Result<Client> Client::open(const std::string& url, const std::string& token) {
  constexpr std::string_view kScheme = "http://";
  std::string place = url;
  if (place.starts_with("https://")) {
    return fail("bad_parameter",
                "https is spoken by the proxy; reach it through a local forwarder, or use http://HOST:PORT "
                "or unix:PATH");
  }
  if (place.starts_with(kScheme)) place.erase(0, kScheme.size());
  while (place.ends_with('/') && !place.starts_with("unix:")) place.pop_back();
  const auto endpoint = parse_endpoint(place);
  if (!endpoint) return tl::unexpected(endpoint.error());
  return Client(std::make_unique<State>(*endpoint, token));
}

Result<Answer> Client::get(const std::string& path) {
  return answer_of(state_->client.Get(path, state_->headers), state_->url);
}

Result<Answer> Client::post(const std::string& path, const std::string& json) {
  return answer_of(state_->client.Post(path, state_->headers, json, "application/json"), state_->url);
}

Result<Answer> Client::remove(const std::string& path) {
  return answer_of(state_->client.Delete(path, state_->headers), state_->url);
}

Result<Answer> Client::upload(const Upload& upload, const std::function<void(std::uint64_t bytes)>& sent) {
  const std::string boundary = random_boundary();
  UploadBody body(upload, boundary);
  std::optional<Error> broken;
  std::uint64_t bytes = 0;
  const auto provide = [&](std::size_t, httplib::DataSink& sink) {
    const auto piece = body.next();
    if (!piece) broken = piece.error();
    if (broken) return false;
    if (piece->empty()) {
      sink.done();
      return true;
    }
    sent(bytes += piece->size());
    return sink.write(piece->data(), piece->size());
  };
  httplib::Headers headers = state_->headers;
  headers.emplace("Idempotency-Key", upload.idempotency_key);
  const auto result = state_->client.Post(upload.path, headers, provide, "multipart/form-data; boundary=" + boundary);
  if (broken) return tl::unexpected(*broken);
  return answer_of(result, state_->url);
}

Result<Answer> with_retries(const Patience& patience, const std::function<Result<Answer>()>& request) {
  double wait_s = patience.first_wait_s;
  for (int attempt = 1;; ++attempt) {
    auto answer = request();
    if (attempt == patience.attempts || !may_pass(answer)) return answer;
    const double jitter = 0.5 + 0.5 * randombytes_random() / 4294967296.0;
    double this_wait_s = wait_s * jitter;
    if (answer && answer->retry_after_s) this_wait_s = *answer->retry_after_s;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::clamp(this_wait_s, 0.0, patience.longest_wait_s)));
    wait_s *= 2;
  }
}

}  // namespace valvetriage::http
