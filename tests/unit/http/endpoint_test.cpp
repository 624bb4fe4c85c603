#include "server/http/endpoint.h"

#include <gtest/gtest.h>

#include "tests/contract/temporary_folder.h"

namespace valvetriage::http {
namespace {

TEST(Endpoint, IsReadAndWrittenAsItsUrl) {
  EXPECT_EQ(parse_endpoint("127.0.0.1:8080")->url(), "http://127.0.0.1:8080");
  EXPECT_EQ(parse_endpoint("[::1]:0")->url(), "http://[::1]:0");
  EXPECT_EQ(parse_endpoint("unix:/run/v.sock")->url(), "unix:/run/v.sock");
  for (const char* bad :
       {"", "8080", ":8080", "localhost", "localhost:", "localhost:x", "localhost:65536", "::1:80", "unix:"}) {
    EXPECT_FALSE(parse_endpoint(bad)) << bad;
  }
}

TEST(Listener, TellsThePortItGotAndThatItIsLocal) {
  const auto listener = Listener::open(*parse_endpoint("127.0.0.1:0"));
  ASSERT_TRUE(listener);
  EXPECT_NE(listener->endpoint().port, 0);
  EXPECT_TRUE(listener->is_local());
  EXPECT_FALSE(Listener::open(*parse_endpoint("0.0.0.0:0"))->is_local());
}

TEST(Listener, NeverSharesAPortWithAnother) {
  const auto first = Listener::open(*parse_endpoint("127.0.0.1:0"));
  ASSERT_TRUE(first);
  const auto second = Listener::open(first->endpoint());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, "address_in_use");
}

TEST(Listener, TakesOverTheSocketFileOfADeadServerButNotOfALiveOneNorAnotherFile) {
  const test::TemporaryFolder folder;
  const Endpoint endpoint{.host = {}, .port = 0, .socket_path = folder.file("v.sock")};
  {
    const auto live = Listener::open(endpoint);
    ASSERT_TRUE(live);
    EXPECT_EQ(Listener::open(endpoint).error().code, "address_in_use");
  }
  EXPECT_FALSE(std::filesystem::exists(endpoint.socket_path));
  EXPECT_TRUE(Listener::open(endpoint));
  const Endpoint file{.host = {}, .port = 0, .socket_path = folder.file("precious.csv")};
  std::filesystem::copy_file("/proc/self/comm", file.socket_path);
  EXPECT_FALSE(Listener::open(file));
  EXPECT_TRUE(std::filesystem::exists(file.socket_path));
}

}  // namespace
}  // namespace valvetriage::http
