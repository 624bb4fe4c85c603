#include "tests/contract/http_fixture.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <stdexcept>

#include "server/http/access.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

std::unique_ptr<Store> open_store(const test::TemporaryFolder& folder) {
  auto store = open_sqlite_store(folder.file("valvetriage.sqlite"));
  if (!store) throw std::runtime_error(store.error().message);
  return std::move(*store);
}

std::unique_ptr<BlobStore> open_blobs(const test::TemporaryFolder& folder) {
  auto blobs = BlobStore::open(folder.path());
  if (!blobs) throw std::runtime_error(blobs.error().message);
  return std::move(*blobs);
}

http::Listener open_listener() {
  auto listener = http::Listener::open({.host = "127.0.0.1", .port = 0, .socket_path = {}});
  if (!listener) throw std::runtime_error(listener.error().message);
  return std::move(*listener);
}

}  // namespace

TestServer::TestServer(const Options& options)
    : store_(open_store(folder_)),
      blobs_(open_blobs(folder_)),
      service_{
          .store = *store_, .blobs = *blobs_, .limits = options.limits, .tokens_required = options.tokens_required} {
  if (options.workers > 0) {
    WorkerOptions worker;
    worker.workers = options.workers;
    pool_ = std::make_unique<WorkerPool>(*store_, *blobs_, worker);
    service_.job_added = [this] { pool_->wake(); };
  }
  front_ = http::make_http_server(service_, open_listener(), 8, false);
  thread_ = std::thread([this] { front_->run(); });
}

TestServer::~TestServer() {
  front_->stop();
  thread_.join();
  front_.reset();
  pool_.reset();
  blobs_.reset();
  store_.reset();
}

Json TestServer::await(const std::string& target) const {
  for (int i = 0; i < 3000; ++i) {  // 60 s: only a hang gets there
    Json document = json_of(get(target));
    const std::string state = document.value("state", "failed");
    if (state != "queued" && state != "running") return document;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  ADD_FAILURE() << target << " never ended";
  return {};
}

std::string TestServer::add_token(const std::vector<std::string>& scopes) {
  const std::string secret = http::new_token_secret();
  EXPECT_TRUE(store_->add_token({.name = "test", .secret_sha256 = http::token_sha256(secret), .scopes = scopes}));
  return secret;
}

std::string good_csv(const std::string& serial, const std::string& lot) {
  std::string text = fmt::format("# serial: {}\n# lot: {}\n# test: step\ntime_s,current_A,pressure_psi\n", serial, lot);
  double pressure = 26;
  for (int i = 0; i < 400; ++i) {
    const double current = i < 100 ? 1.2 : i < 250 ? 1.6 : 1.4;
    pressure += 0.08 * (26 + 150 * (current - 1.2) - pressure);
    // A fixed pattern below the display: no draw of the data is a straight line.
    text += fmt::format("{:.4f},{:.4f},{:.3f}\n", 0.005 * i, current, pressure + 0.05 * std::sin(i * i));
  }
  return text;
}

Json json_of(const RawAnswer& answer) {
  auto document = parse_json(answer.body);
  if (document) return std::move(*document);
  ADD_FAILURE() << "no JSON in answer " << answer.status << ": " << answer.body.substr(0, 200);
  return {};
}

}  // namespace valvetriage
