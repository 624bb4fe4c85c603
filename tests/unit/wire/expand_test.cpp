#include "server/wire/expand.h"

#include <gtest/gtest.h>
#include <zlib.h>
#include <zstd.h>

#include <cstring>

namespace valvetriage {
namespace {

/// Gives its text in pieces of `piece` bytes.
class Pieces : public ByteSource {
 public:
  Pieces(std::string text, std::size_t piece) : text_(std::move(text)), piece_(piece) {}
  Result<std::size_t> read(std::span<char> buffer) override {
    const std::size_t n = std::min({piece_, buffer.size(), text_.size() - at_});
    std::memcpy(buffer.data(), text_.data() + at_, n);
    at_ += n;
    return n;
  }
  bool rewind() override {
    at_ = 0;
    return true;
  }

 private:
  std::string text_;
  std::size_t piece_;
  std::size_t at_ = 0;
};

std::string gzip(const std::string& text) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, text.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

std::string zstd(const std::string& text) {
  std::string out(ZSTD_compressBound(text.size()), '\0');
  out.resize(ZSTD_compress(out.data(), out.size(), text.data(), text.size(), 3));
  return out;
}

Result<std::string> read_all(Compression compression, ByteSource& source, std::uint64_t max_bytes, std::size_t step) {
  const auto expanded = expand(compression, source, max_bytes);
  std::string text, buffer(step, '\0');
  for (;;) {
    const auto n = expanded->read(buffer);
    if (!n) return tl::unexpected(n.error());
    if (*n == 0) return text;
    text.append(buffer, 0, *n);
  }
}

std::string rows(int count) {
  std::string text = "time_s,current_A,pressure_psi\n";
  for (int i = 0; i < count; ++i) text += std::to_string(i) + ",1.2,26.5\n";
  return text;
}

TEST(Expand, GivesBackWhatWasCompressedInPiecesOfAnySize) {
  const std::string text = rows(20'000);
  for (const std::size_t piece : {1u, 7u, 1000u, 1'000'000u}) {
    for (const std::size_t step : {3u, 65'536u}) {
      Pieces as_gzip(gzip(text), piece), as_zstd(zstd(text), piece), plain(text, piece);
      EXPECT_EQ(*read_all(Compression::kGzip, as_gzip, text.size(), step), text);
      EXPECT_EQ(*read_all(Compression::kZstd, as_zstd, text.size(), step), text);
      EXPECT_EQ(*read_all(Compression::kNone, plain, text.size(), step), text);
    }
  }
}

TEST(Expand, ReadsMembersAndFramesThatFollowEachOtherAsOneText) {
  Pieces as_gzip(gzip("a,") + gzip("b"), 5), as_zstd(zstd("a,") + zstd("b"), 5);
  EXPECT_EQ(*read_all(Compression::kGzip, as_gzip, 100, 64), "a,b");
  EXPECT_EQ(*read_all(Compression::kZstd, as_zstd, 100, 64), "a,b");
}

TEST(Expand, TakesWindowsUpToTheBoundAndSaysHowToStayWithinIt) {
  std::string text(20 << 20, '\0');
  std::uint32_t state = 1;
  for (char& c : text) c = static_cast<char>((state = state * 1664525 + 1013904223) >> 24);
  for (const int window : {kUploadZstdWindowLog2, kUploadZstdWindowLog2 + 1}) {
    ZSTD_CCtx* context = ZSTD_createCCtx();
    ZSTD_CCtx_setParameter(context, ZSTD_c_windowLog, window);
    std::string packed(ZSTD_compressBound(text.size()), '\0');
    packed.resize(ZSTD_compress2(context, packed.data(), packed.size(), text.data(), text.size()));
    ZSTD_freeCCtx(context);
    Pieces source(packed, 1 << 20);
    const auto expanded = expand(Compression::kZstd, source, text.size(), kUploadZstdWindowLog2);
    std::string buffer(1 << 20, '\0');
    const auto n = expanded->read(buffer);
    EXPECT_EQ(n.has_value(), window == kUploadZstdWindowLog2);
    const std::string said = n ? "" : n.error().message;
    EXPECT_EQ(said.find("8 MiB") != std::string::npos, !n.has_value()) << said;
  }
}

TEST(Expand, StopsAtTheBoundOfTheExpandedBytes) {
  const std::string bomb(50'000'000, '0');
  for (const auto& [compression, bytes] :
       {std::pair(Compression::kGzip, gzip(bomb)), std::pair(Compression::kZstd, zstd(bomb))}) {
    Pieces exact(bytes, 4096), short_by_one(bytes, 4096);
    EXPECT_TRUE(read_all(compression, exact, bomb.size(), 65'536));
    EXPECT_EQ(read_all(compression, short_by_one, bomb.size() - 1, 65'536).error().code, "too_large");
  }
}

TEST(Expand, RefusesWhatIsDamagedCutOffOrNotCompressed) {
  const std::string text = rows(1000);
  for (const auto& [compression, bytes] :
       {std::pair(Compression::kGzip, gzip(text)), std::pair(Compression::kZstd, zstd(text))}) {
    std::string damaged = bytes;
    damaged[damaged.size() / 2] ^= 0x55;
    for (const std::string& bad : {bytes.substr(0, bytes.size() - 1), bytes.substr(0, 5), std::string(), text,
                                   compression == Compression::kGzip ? damaged : text}) {
      Pieces source(bad, 100);
      const auto read = read_all(compression, source, 1'000'000, 1000);
      ASSERT_FALSE(read) << bad.size();
      EXPECT_EQ(read.error().code, "malformed_encoding");
    }
  }
}

TEST(Expand, StartsAgainAfterARewind) {
  const std::string text = rows(5000);
  for (const auto& [compression, bytes] :
       {std::pair(Compression::kGzip, gzip(text)), std::pair(Compression::kZstd, zstd(text))}) {
    Pieces source(bytes, 512);
    const auto expanded = expand(compression, source, text.size());
    std::string buffer(1000, '\0');
    ASSERT_EQ(*expanded->read(std::span(buffer).first(10)), 10u);
    ASSERT_TRUE(expanded->rewind());
    std::string again;
    while (const auto n = *expanded->read(buffer)) again.append(buffer, 0, n);
    EXPECT_EQ(again, text);
  }
}

TEST(Expand, KnowsCompressionByNameAndByEncoding) {
  EXPECT_EQ(compression_of_name("a.csv.gz"), Compression::kGzip);
  EXPECT_EQ(compression_of_name("a.csv.zst"), Compression::kZstd);
  EXPECT_EQ(compression_of_name("a.csv"), Compression::kNone);
  EXPECT_EQ(expanded_name("a.csv.gz"), "a.csv");
  EXPECT_EQ(expanded_name("a.csv"), "a.csv");
  EXPECT_EQ(compression_of_encoding("gzip"), Compression::kGzip);
  EXPECT_EQ(compression_of_encoding("zstd"), Compression::kZstd);
  EXPECT_EQ(compression_of_encoding("identity"), Compression::kNone);
  EXPECT_EQ(compression_of_encoding("br"), std::nullopt);
  EXPECT_EQ(compression_of_encoding("gzip, gzip"), std::nullopt);
}

}  // namespace
}  // namespace valvetriage
