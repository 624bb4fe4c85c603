#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <thread>

#include "server/http/http_server.h"
#include "server/http/service.h"
#include "server/jobs/worker.h"
#include "server/store/blob_store.h"
#include "server/store/store.h"
#include "server/wire/json.h"
#include "tests/contract/http_exchange.h"
#include "tests/contract/temporary_folder.h"

namespace valvetriage {

/// A whole server on a free loopback port with an empty database in a folder of its own. Its jobs run in children of
/// the test's own executable, whose analyser (http_main.cpp) reads the recordings as the real one does and fits
/// nothing.
class TestServer {
 public:
  struct Options {
    bool tokens_required = false;
    int workers = 0;
    AcceptLimits limits{};
  };

  explicit TestServer(const Options& options);
  ~TestServer();

  /// Of its database and recordings.
  const std::string& folder() const { return folder_.path(); }
  int port() const { return front_->endpoint().port; }
  Store& store() { return *store_; }
  http::Service& service() { return service_; }

  RawAnswer get(const std::string& target, const Headers& headers = {}) const {
    return request(port(), "GET", target, "", headers);
  }
  RawAnswer post(const std::string& target, const std::string& body, const Headers& headers = {}) const {
    return request(port(), "POST", target, body, headers);
  }
  /// Polls a recording or submission until its state is final; the document.
  Json await(const std::string& target) const;
  /// A token's secret.
  std::string add_token(const std::vector<std::string>& scopes);

 private:
  test::TemporaryFolder folder_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<BlobStore> blobs_;
  http::Service service_;
  std::unique_ptr<WorkerPool> pool_;
  std::unique_ptr<http::Front> front_;
  std::thread thread_;
};

/// A recording that every analysis can read: steps at 200 Hz with a first-order response, `serial` in its head.
std::string good_csv(const std::string& serial, const std::string& lot = "lot-1");

Json json_of(const RawAnswer& answer);

}  // namespace valvetriage
