#include "server/http/multipart.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cstring>

namespace valvetriage::http {
namespace {

/// Gives its text in pieces of at most `piece` bytes.
class Pieces : public ByteSource {
 public:
  Pieces(std::string text, std::size_t piece) : text_(std::move(text)), piece_(piece) {}
  Result<std::size_t> read(std::span<char> buffer) override {
    const std::size_t n = std::min({piece_, buffer.size(), text_.size() - at_});
    std::memcpy(buffer.data(), text_.data() + at_, n);
    at_ += n;
    return n;
  }
  bool rewind() override { return false; }

 private:
  std::string text_;
  std::size_t piece_, at_ = 0;
};

Result<std::vector<std::pair<std::string, std::string>>> files_of(const std::string& body, std::size_t piece) {
  Pieces source(body, piece);
  MultipartReader reader(source, "b");
  std::vector<std::pair<std::string, std::string>> files;
  for (;;) {
    const auto part = reader.next();
    if (!part) return tl::unexpected(part.error());
    if (!*part) return files;
    std::string content, buffer(7, '\0');
    for (;;) {
      const auto n = reader.read(buffer);
      if (!n) return tl::unexpected(n.error());
      if (*n == 0) break;
      content.append(buffer, 0, *n);
    }
    files.emplace_back((*part)->file_name, content);
  }
}

std::string part(const std::string& name, const std::string& content) {
  return "--b\r\nContent-Disposition: form-data; name=\"file\"; filename=\"" + name + "\"\r\n\r\n" + content + "\r\n";
}

TEST(Multipart, GivesBackEveryPartHoweverItsBytesArriveAndWhateverLooksLikeABoundaryInThem) {
  rc::check([] {
    const auto text = rc::gen::container<std::string>(rc::gen::element('\r', '\n', '-', 'b', 'x'));
    const auto contents = *rc::gen::container<std::vector<std::string>>(text);
    const auto piece = *rc::gen::inRange<std::size_t>(1, 50);
    std::string body = "preamble\r\n";
    std::vector<std::pair<std::string, std::string>> expected;
    for (const std::string& content : contents) {
      RC_PRE(("\r\n" + content + "\r\n").find("\r\n--b") == std::string::npos);
      expected.emplace_back("f.csv", content);
      body += part("f.csv", content);
    }
    const auto files = files_of(body + "--b--\r\n", piece);
    RC_ASSERT(files.has_value());
    RC_ASSERT(*files == expected);
  });
}

TEST(Multipart, KeepsOnlyTheLastPartOfAFileName) {
  for (const std::string name : {"a.csv", "C:\\x\\a.csv", "../../a.csv", "/etc/a.csv"}) {
    EXPECT_EQ((*files_of(part(name, "x") + "--b--", 100))[0].first, "a.csv") << name;
  }
}

TEST(Multipart, RefusesABodyThatIsCutOffOrMalformed) {
  const std::string whole = part("a.csv", "content") + "--b--";
  for (std::size_t size = 0; size + 1 < whole.size(); ++size) EXPECT_FALSE(files_of(whole.substr(0, size), 3)) << size;
  EXPECT_FALSE(files_of("--b\r\nno header\r\n\r\nx\r\n--b--", 100));
  EXPECT_FALSE(files_of("--bx\r\n\r\nx\r\n--b--", 100));
}

TEST(Multipart, ReadsTheBoundaryOfItsContentType) {
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=b"), "b");
  EXPECT_EQ(multipart_boundary("Multipart/Form-Data; charset=utf-8; Boundary=\"a b\""), "a b");
  EXPECT_EQ(multipart_boundary("multipart/form-data"), std::nullopt);
  EXPECT_EQ(multipart_boundary("multipart/mixed; boundary=b"), std::nullopt);
  EXPECT_EQ(multipart_boundary("multipart/form-data; boundary=" + std::string(71, 'b')), std::nullopt);
}

}  // namespace
}  // namespace valvetriage::http
