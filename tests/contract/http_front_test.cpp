#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "server/http/connection.h"
#include "server/http/front.h"
#include "server/http/limits.h"
#include "server/http/routes.h"
#include "tests/contract/http_fixture.h"

namespace {
std::atomic<bool> out_of_descriptors = false;
std::atomic<int> refused_accepts = 0;
}  // namespace

/// In front of the system's, so that a test can count how often the server asks for what it cannot have.
extern "C" int accept4(int listener, sockaddr* address, socklen_t* size, int flags) {
  if (!out_of_descriptors) return static_cast<int>(syscall(SYS_accept4, listener, address, size, flags));
  ++refused_accepts;
  errno = EMFILE;
  return -1;
}

namespace valvetriage {
namespace {

constexpr const char* kGet = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
constexpr const char* kPost = "POST /v1/recordings HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";

TEST(HttpFront, RefusesHeadsThatTwoReadersCouldTakeDifferently) {
  TestServer server({});
  const std::string get = kGet, post = kPost;
  const std::vector<std::pair<std::string, int>> attacks{
      {post + "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400},
      {post + "Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd", 400},
      {post + "Content-Length: 3\r\nContent-Length: 3\r\n\r\nabc", 400},
      {post + "Content-Length: abc\r\n\r\n", 400},
      {post + "Content-Length: -1\r\n\r\n", 400},
      {post + "Content-Length: +1\r\n\r\na", 400},
      {post + "Content-Length: 0x10\r\n\r\n", 400},
      {post + "Content-Length: 1, 1\r\n\r\na", 400},
      {post + "Content-Length: 99999999999999999999999\r\n\r\n", 400},
      {post + "Content-Length:\r\n\r\n", 400},
      {post + "Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n", 501},
      {post + "Transfer-Encoding: xchunked\r\n\r\n0\r\n\r\n", 501},
      {post + "Transfer-Encoding : chunked\r\n\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: chunked\r\n\r\n-1\r\nabc\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: chunked\r\n\r\nffffffffffffffffff\r\nabc\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: chunked\r\n\r\n3\r\nabcd\r\n0\r\n\r\n", 400},
      {post + "Transfer-Encoding: chunked\r\n\r\n3;\nx\r\nabc\r\n0\r\n\r\n", 400},
      {get + "X: a\r\n b\r\n\r\n", 400},
      {get + "X: a\rb\r\n\r\n", 400},
      {get + std::string("X: a\0b\r\n\r\n", 11), 400},
      {get + "X: a%0d%0aInjected: 1\r\n\r\n", 400},
      {get + "X\r\n\r\n", 400},
      {get + "X Y: 1\r\n\r\n", 400},
      {get + ": 1\r\n\r\n", 400},
      {"GET /healthz HTTP/1.1\nHost: localhost\n\n", 400},
      {"GET /healthz HTTP/1.1\r\nConnection: close\r\n\r\n", 400},
      {get + "Host: other\r\n\r\n", 400},
      {"GET  /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /healthz\r\nHost: localhost\r\n\r\n", 400},
      {"GET http://localhost/healthz HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /%zz HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /v1/lots/a%00b HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /v1/recordings?lot=a%0ab HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /v1/recordings?lot=a&lot=b HTTP/1.1\r\nHost: localhost\r\n\r\n", 400},
      {"GET /healthz HTTP/2.0\r\nHost: localhost\r\n\r\n", 505},
      {"\x16\x03\x01\x02\r\n\r\n", 400},
      {get + "Expect: 200-ok\r\n\r\n", 417},
  };
  for (const auto& [bytes, status] : attacks) {
    const RawAnswer answer = send_raw(server.port(), bytes);
    EXPECT_EQ(answer.status, status) << bytes;
    EXPECT_EQ(answer.header("Connection"), "close") << bytes;
    EXPECT_EQ(answer.header("Content-Type"), "application/problem+json") << bytes;
  }
  EXPECT_EQ(server.get("/healthz").status, 200);
}

TEST(HttpFront, BoundsTheHeadInBytesAndInNumberOfHeaders) {
  TestServer server({});
  const auto with_headers = [&](std::size_t count) {
    std::string bytes = kGet;  // Host and Connection are two of them
    for (std::size_t i = 2; i < count; ++i) bytes += "X-" + std::to_string(i) + ": 1\r\n";
    return send_raw(server.port(), bytes + "\r\n").status;
  };
  EXPECT_EQ(with_headers(http::kMaxHeaders), 200);
  EXPECT_EQ(with_headers(http::kMaxHeaders + 1), 431);
  const auto with_bytes = [&](std::size_t size) {
    std::string bytes = std::string(kGet) + "X: ";
    bytes += std::string(size - bytes.size() - 4, 'x') + "\r\n\r\n";
    return send_raw(server.port(), bytes).status;
  };
  EXPECT_EQ(with_bytes(http::kMaxHeadBytes), 200);
  EXPECT_EQ(with_bytes(http::kMaxHeadBytes + 1), 431);
  EXPECT_EQ(send_raw(server.port(), std::string(1 << 20, 'x')).status, 431);
}

TEST(HttpFront, ServesManyRequestsOfOneConnectionAlsoWhenTheyComeAtOnce) {
  TestServer server({});
  const std::string one = "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";
  const std::string body = good_csv("EFC-1");
  const std::string post =
      "POST /v1/recordings HTTP/1.1\r\nHost: localhost\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" +
      body;
  const RawAnswer all = send_raw(server.port(), one + post + one + kGet + "\r\n");
  const std::string text = all.head + all.body;
  EXPECT_NE(text.find("202 Accepted"), std::string::npos);
  std::size_t answers = 0;
  for (auto at = text.find("HTTP/1.1 "); at != std::string::npos; at = text.find("HTTP/1.1 ", at + 1)) ++answers;
  EXPECT_EQ(answers, 4u);
}

TEST(HttpFront, HoldsNoMoreOfAConnectionThatIsAlwaysARequestAhead) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, ends), 0);
  http::Connection connection(ends[0], "unix");
  const std::string head = "GET / HTTP/1.1\r\nX: " + std::string(10'000, 'a') + "\r\n\r\n";
  ASSERT_EQ(write(ends[1], head.data(), head.size()), static_cast<ssize_t>(head.size()));
  for (int request = 0; request < 100; ++request) {
    ASSERT_EQ(write(ends[1], head.data(), head.size()), static_cast<ssize_t>(head.size()));
    ASSERT_TRUE(connection.fill());
    EXPECT_EQ(connection.take(connection.head_size()), head);
  }
  EXPECT_GT(connection.buffered(), 0u);
  EXPECT_LT(connection.held(), 4 * head.size());
  close(ends[1]);
}

TEST(HttpFront, InvitesABodyOnlyWhenItWillBeRead) {
  TestServer server({.tokens_required = true, .workers = 0, .limits = {}});
  const RawAnswer refused =
      send_raw(server.port(), std::string(kPost) + "Content-Length: 10\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ(refused.status, 401);
}

TEST(HttpFront, TellsWhatIsNotThereAndWhatIsNotPossible) {
  TestServer server({});
  EXPECT_EQ(server.get("/v1/nothing").status, 404);
  EXPECT_EQ(server.get("/v1/recordings/rec_x").status, 404);
  EXPECT_EQ(server.get("/v1/recordings/rec_x/plot.svg").status, 404);
  EXPECT_EQ(server.get("/../../etc/passwd").status, 404);
  EXPECT_EQ(server.get("/web/..%2f..%2fetc%2fpasswd").status, 404);
  const RawAnswer wrong = request(server.port(), "DELETE", "/v1/recordings");
  EXPECT_EQ(wrong.status, 405);
  EXPECT_EQ(wrong.header("Allow"), "GET, HEAD, OPTIONS, POST");
  EXPECT_EQ(request(server.port(), "OPTIONS", "/v1/recordings").status, 204);
  const RawAnswer head = request(server.port(), "HEAD", "/healthz");
  EXPECT_EQ(head.status, 200);
  EXPECT_TRUE(head.body.empty());
  EXPECT_NE(head.header("Content-Length"), "0");
  EXPECT_EQ(json_of(server.get("/v1/recordings?nonsense=1"))["code"], "unknown_parameter");
  EXPECT_EQ(server.get("/v1/recordings?limit=0").status, 400);
  EXPECT_EQ(server.get("/v1/recordings?limit=1001").status, 400);
  EXPECT_EQ(server.get("/v1/recordings?cursor=nonsense").status, 400);
  EXPECT_EQ(server.get("/v1/recordings?since=yesterday").status, 400);
}

TEST(HttpFront, KeepsPagesOfOtherSitesAway) {
  TestServer server({});
  const auto post = [&](const Headers& headers) {
    return server.post("/v1/recordings", good_csv("EFC-1"), headers).status;
  };
  EXPECT_EQ(post({{"Origin", "http://evil.example"}}), 403);
  EXPECT_EQ(post({{"Origin", "null"}}), 403);
  EXPECT_EQ(post({{"Sec-Fetch-Site", "cross-site"}}), 403);
  EXPECT_EQ(post({{"Origin", "http://localhost"}}), 202);
}

TEST(HttpFront, AnswersToTheNamesOfThisMachineOnlySoThatNoOtherNameCanBeReboundToIt) {
  TestServer server({});
  const auto lots_of = [&](const std::string& host) {
    return send_raw(server.port(), "GET /v1/lots HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n").status;
  };
  for (const char* other : {"evil.example", "127.evil.example", "127.0.0.1.evil.example", "128.0.0.1", "127.1", "[::2]",
                            "localhost.evil.example"}) {
    EXPECT_EQ(lots_of(other), 403) << other;
  }
  for (const char* own : {"localhost", "LocalHost:8080", "127.0.0.1", "127.3.2.1:80", "[::1]", "[::1]:8080", "::1"}) {
    EXPECT_EQ(lots_of(own), 200) << own;
  }
}

/// A connection of a test's own, held open.
class Client {
 public:
  explicit Client(int port) { address_.sin_port = htons(static_cast<std::uint16_t>(port)); }
  explicit Client(const TestServer& server) : Client(server.port()) {}
  Client(Client&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)), address_(other.address_) {}
  Client& operator=(Client&&) = delete;
  ~Client() {
    if (descriptor_ >= 0) close(descriptor_);
  }

  /// By the kernel: the server need not have taken it.
  bool connects() const {
    return connect(descriptor_, reinterpret_cast<const sockaddr*>(&address_), sizeof address_) == 0;
  }
  void says(const std::string& bytes) const {
    EXPECT_EQ(send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  /// The first bytes of the answer, fewer where the server closes.
  std::string hears(std::size_t bytes) const {
    std::string answer(bytes, '\0');
    const ssize_t got = recv(descriptor_, answer.data(), answer.size(), MSG_WAITALL);
    answer.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return answer;
  }
  void hears_a_head() const {
    std::string head;
    while (!head.ends_with("\r\n\r\n")) {
      const std::string byte = hears(1);
      ASSERT_NE(byte, "");
      head += byte;
    }
  }

 private:
  int descriptor_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address_{.sin_family = AF_INET, .sin_port = 0, .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
};

TEST(HttpFront, CutsOffAnUploadThatOutlastsAServerThatWasToldToStop) {
  auto listener = http::Listener::open({.host = "127.0.0.1", .port = 0, .socket_path = {}});
  ASSERT_TRUE(listener);
  std::atomic<bool> is_read = false;
  std::string end;
  http::Front front(
      std::move(*listener), 1,
      [&](http::Request& request) {
        std::array<char, 16> bytes;
        is_read = true;
        Result<std::size_t> n = 0;
        do {
          n = request.body->read(bytes);
        } while (n && *n > 0);
        if (!n) end = n.error().code;
        return http::Response{};
      },
      [](const http::Answered&) {});
  std::atomic<bool> told = false;
  std::thread serving([&] { front.run([&] { told = true; }, std::chrono::milliseconds(100)); });
  const Client client(front.endpoint().port);
  ASSERT_TRUE(client.connects());
  client.says(std::string(kPost) + "Content-Length: 1000000\r\n\r\nnot all of it");
  while (!is_read) std::this_thread::yield();
  front.stop();
  serving.join();
  EXPECT_TRUE(told);
  EXPECT_EQ(end, "incomplete_body") << "it has ten seconds and more where nobody ends it";
}

TEST(HttpFront, TakesConnectionsAgainOnceTheMachineHasDescriptorsForThem) {
  TestServer server({});
  const Client client(server);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{3, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  ASSERT_TRUE(client.connects());
  client.says(std::string(kGet) + "\r\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  EXPECT_EQ(client.hears(12), "HTTP/1.1 200");
}

TEST(HttpFront, DoesNotAskAgainAndAgainForAConnectionItHasNoDescriptorFor) {
  TestServer server({});
  const Client served(server), late(server);
  ASSERT_TRUE(served.connects());
  const auto ask = [&] {
    served.says("HEAD /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
    served.hears_a_head();
  };
  ask();
  refused_accepts = 0;
  out_of_descriptors = true;
  ASSERT_TRUE(late.connects());
  late.says(std::string(kGet) + "\r\n");
  constexpr int kRequests = 500;  // each at least two rounds of the loop that also watches the listener
  for (int i = 0; i < kRequests; ++i) ask();
  out_of_descriptors = false;
  EXPECT_LT(refused_accepts, kRequests);
  EXPECT_EQ(late.hears(12), "HTTP/1.1 200");
}

TEST(HttpFront, CountsTheConnectionsItServesAmongThoseItMayHold) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit enough{before.rlim_max, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &enough), 0);
  {
    TestServer server({});
    const Client served(server);
    ASSERT_TRUE(served.connects());
    served.says("GET /v1/events?after=0&wait_s=30 HTTP/1.1\r\nHost: localhost\r\n\r\n");
    while (server.service().event_waiters == 0) std::this_thread::yield();
    std::vector<Client> idle;
    for (std::size_t i = 1; i < http::kMaxConnections; ++i) {
      idle.emplace_back(server);
      ASSERT_TRUE(idle.back().connects());
    }
    const Client one_too_many(server);
    ASSERT_TRUE(one_too_many.connects());
    EXPECT_EQ(one_too_many.hears(12), "");
  }
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
}

TEST(HttpFront, ShowsThePageUnderAStrictPolicy) {
  TestServer server({});
  const RawAnswer page = server.get("/");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.header("Content-Type"), "text/html; charset=utf-8");
  EXPECT_NE(page.header("Content-Security-Policy").find("default-src 'none'; script-src 'self'"), std::string::npos);
  EXPECT_EQ(page.header("X-Content-Type-Options"), "nosniff");
  EXPECT_EQ(page.body.find("<script>"), std::string::npos);
  EXPECT_EQ(server.get("/web/page.js").header("Content-Type"), "text/javascript; charset=utf-8");
}

TEST(HttpFront, ListsAsCsvThatASpreadsheetTakesForTextOnly) {
  TestServer server({});
  ASSERT_EQ(server.post("/v1/recordings?name=%3Dcmd%7C%27x%27%21A0&lot=%2Blot%2C%22q%22", good_csv("-S", "+lot,\"q\""))
                .status,
            202);
  const RawAnswer list = server.get("/v1/recordings", {{"Accept", "text/csv"}});
  EXPECT_TRUE(list.header("Content-Type").starts_with("text/csv"));
  EXPECT_NE(list.body.find(",'=cmd|'x'!A0,"), std::string::npos) << list.body;
  EXPECT_NE(list.body.find(",\"'+lot,\"\"q\"\"\",'-S,"), std::string::npos) << list.body;
  EXPECT_EQ(server.get("/v1/recordings?format=csv").body, list.body);
}

TEST(HttpFront, RefusesAVerdictAndACauseThatAreNoneInsteadOfFindingNothing) {
  TestServer server({});
  for (const char* list : {"/v1/recordings", "/v1/submissions"}) {
    for (const char* wrong : {"verdict=good", "verdict=Bad", "cause=stiction", "cause=Friction"}) {
      const RawAnswer answer = server.get(std::string(list) + "?" + wrong);
      EXPECT_EQ(answer.status, 400) << wrong;
      EXPECT_EQ(json_of(answer)["code"], "bad_parameter") << wrong;
    }
    EXPECT_EQ(server.get(std::string(list) + "?verdict=Good&cause=friction").status, 200);
  }
}

TEST(HttpFront, PagesThroughAListWithoutLossOrRepetition) {
  TestServer server({});
  for (int i = 0; i < 7; ++i)
    ASSERT_EQ(server.post("/v1/recordings", good_csv("EFC-" + std::to_string(i))).status, 202);
  std::vector<std::string> serials;
  std::string cursor;
  do {
    const Json page = json_of(server.get("/v1/recordings?limit=3" + cursor));
    for (const Json& item : page["items"]) serials.push_back(item["serial"]);
    cursor = page["next"].is_null() ? "" : "&cursor=" + http::percent_encode(page["next"].get<std::string>());
  } while (!cursor.empty());
  EXPECT_EQ(serials, (std::vector<std::string>{"EFC-6", "EFC-5", "EFC-4", "EFC-3", "EFC-2", "EFC-1", "EFC-0"}));
}

/// A path that fits the pattern.
std::string path_of(const http::Route& route) {
  std::string path;
  for (std::size_t i = 0; i < route.pattern.size(); ++i) {
    if (route.pattern[i] == '{') {
      i = route.pattern.find('}', i);
      path += "x";
    } else {
      path += route.pattern[i];
    }
  }
  return path;
}

TEST(HttpAccess, IsGrantedByScopeOnEveryRouteOfTheTable) {
  TestServer server({.tokens_required = true, .workers = 0, .limits = {}});
  const std::string read = server.add_token({"read"}), submit = server.add_token({"submit"}),
                    admin = server.add_token({"admin"});
  const std::string revoked = server.add_token({"admin"});
  const auto tokens = server.store().list_tokens();
  ASSERT_TRUE(tokens);
  ASSERT_TRUE(server.store().revoke_token(
      tokens->back().created_at >= tokens->front().created_at ? tokens->back().id : tokens->front().id, "test"));
  const auto status = [&](const http::Route& route, const std::string& token) {
    Headers headers;
    if (!token.empty()) headers.emplace_back("Authorization", "Bearer " + token);
    return request(server.port(), std::string(route.method), path_of(route), "", headers).status;
  };
  for (const http::Route& route : http::routes()) {
    SCOPED_TRACE(std::string(route.method) + " " + std::string(route.pattern));
    const bool is_public = route.scope == http::Scope::kPublic;
    const auto granted = [](int code) { return code != 401 && code != 403; };
    EXPECT_EQ(granted(status(route, "")), is_public);
    EXPECT_EQ(status(route, "") == 401, !is_public);
    EXPECT_EQ(status(route, "vt_unknown") == 401, !is_public);
    EXPECT_EQ(status(route, revoked) == 401, !is_public);
    EXPECT_EQ(granted(status(route, read)), is_public || route.scope == http::Scope::kRead);
    EXPECT_EQ(granted(status(route, submit)), is_public || route.scope == http::Scope::kSubmit);
    EXPECT_TRUE(granted(status(route, admin)));
  }
}

}  // namespace
}  // namespace valvetriage
