#include "server/http/serve.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <filesystem>
#include <memory>

#include "server/http/http_server.h"
#include "server/http/log.h"
#include "server/jobs/worker.h"
#include "server/store/file_lock.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage::http {
namespace {

std::atomic<Front*> stopped_by_signal{nullptr};

void on_stop_signal(int) {
  if (Front* front = stopped_by_signal.load()) front->stop();
}

/// SIGTERM and SIGINT stop this front as long as the object lives.
class StopSignals {
 public:
  explicit StopSignals(Front& front) {
    stopped_by_signal = &front;
    struct sigaction action {};
    action.sa_handler = on_stop_signal;
    sigaction(SIGTERM, &action, &before_term_);
    sigaction(SIGINT, &action, &before_int_);
  }
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;
  ~StopSignals() {
    sigaction(SIGTERM, &before_term_, nullptr);
    sigaction(SIGINT, &before_int_, nullptr);
    stopped_by_signal = nullptr;
  }

 private:
  struct sigaction before_term_ {
  }, before_int_{};
};

Result<bool> has_token(Store& store) {
  const auto tokens = store.list_tokens();
  if (!tokens) return tl::unexpected(tokens.error());
  return std::any_of(tokens->begin(), tokens->end(), [](const TokenRow& token) { return !token.revoked_at; });
}

/// Whoever reaches a local address may do everything, unless tokens are asked for; elsewhere tokens are a must.
Result<void> check_exposure(const ServeOptions& options, const Listener& listener, Store& store) {
  if (!listener.is_local() && !options.behind_proxy) {
    return fail(
        "unsafe_listen",
        fmt::format("others can reach {}; put nginx with TLS in front (deploy/nginx) and pass --behind-proxy, or "
                    "listen on 127.0.0.1 or unix:PATH",
                    listener.endpoint().url()));
  }
  if (listener.is_local() && !options.behind_proxy && !options.require_token) return {};
  const auto tokens = has_token(store);
  if (!tokens) return tl::unexpected(tokens.error());
  if (*tokens) return {};
  return fail("unsafe_listen",
              "there is no access token yet; make one with 'valvetriage token create NAME --scopes "
              "submit,read' on the same database, then start again");
}

/// A new database is made, but not beside the recordings of another one: that is on a disk that is not mounted.
Result<void> check_database_is_there(const ServeOptions& options, const BlobStore& blobs) {
  const auto claimed = blobs.is_claimed();
  if (!claimed) return tl::unexpected(claimed.error());
  std::error_code unreadable;
  if (!*claimed || std::filesystem::exists(options.database_file, unreadable)) return {};
  return fail("store_mismatch",
              fmt::format("there is no database {}, though {} holds the recordings of one: is every disk mounted, and "
                          "are --data-dir and --database the ones that go together?",
                          options.database_file, options.data_dir));
}

std::unique_ptr<WorkerPool> start_workers(const ServeOptions& options, Store& store, BlobStore& blobs) {
  if (options.workers == 0) return nullptr;
  WorkerOptions worker;
  worker.workers = options.workers;
  worker.child_command = options.child_command;
  worker.rule_base_json = options.rule_base_json;
  worker.log = [](std::string_view message) { log_event("worker", std::string(message)); };
  return std::make_unique<WorkerPool>(store, blobs, worker);
}

}  // namespace

Result<void> make_folder(const std::string& path) {
  std::error_code error;
  const bool is_new = std::filesystem::create_directories(path, error);
  // Recordings, results and token hashes are nobody else's; of a folder that was there its owner has decided.
  using std::filesystem::perms;
  if (is_new) {
    std::filesystem::permissions(path, perms::owner_all | perms::group_read | perms::group_exec, error);
  }
  if (error) return fail("cannot_make_folder", fmt::format("cannot make the folder {}: {}", path, error.message()));
  return {};
}

Result<void> serve(const ServeOptions& options, const std::function<void(const Endpoint&)>& listening) {
  const auto endpoint = parse_endpoint(options.listen);
  if (!endpoint) return tl::unexpected(endpoint.error());
  if (auto made = make_folder(options.data_dir); !made) return made;
  const auto folder = lock_data_folder(options.data_dir);
  if (!folder) return tl::unexpected(folder.error());
  const auto blobs = BlobStore::open(options.data_dir);
  if (!blobs) return tl::unexpected(blobs.error());
  if (auto there = check_database_is_there(options, **blobs); !there) return there;
  const auto store = open_sqlite_store(options.database_file);
  if (!store) return tl::unexpected(store.error());
  auto listener = Listener::open(*endpoint);
  if (!listener) return tl::unexpected(listener.error());
  if (auto safe = check_exposure(options, *listener, **store); !safe) return safe;
  if (auto ours = (*blobs)->belong_to(**store); !ours) return ours;
  if (auto swept = (*blobs)->sweep(**store); !swept) return tl::unexpected(swept.error());
  if (auto released = (*store)->release_dead_leases(); !released) return tl::unexpected(released.error());

  Service service{.store = **store, .blobs = **blobs};
  service.workers = std::max(1, options.workers);
  service.tokens_required = options.require_token || options.behind_proxy || !listener->is_local();
  service.check_host = !endpoint->is_unix();
  const auto pool = start_workers(options, **store, **blobs);
  if (pool) service.job_added = [&pool] { pool->wake(); };
  const auto front = make_http_server(service, std::move(*listener), options.connections, options.log_requests);
  const StopSignals signals(*front);
  std::signal(SIGPIPE, SIG_IGN);  // a log that nobody reads any more ends nothing
  listening(front->endpoint());
  front->run([&pool] {
    log_event("stopping", "no new connections; running jobs are handed back");
    if (pool) pool->drain();
  });
  return {};
}

}  // namespace valvetriage::http
