#include "server/wire/expand.h"

#include <fmt/format.h>
#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <array>
#include <vector>

#include "core/recording/text.h"
#include "server/wire/byte_source.h"

namespace valvetriage {
namespace {

constexpr std::size_t kPieceBytes = 64 * 1024;
constexpr int kGzipWindow = 15 + 16;  // zlib: largest window, gzip wrapper only

tl::unexpected<Error> too_large(std::uint64_t max_bytes) {
  Error error{.code = "too_large"};
  error.message = fmt::format("larger than {} bytes expanded", max_bytes);
  error.expected = fmt::format("at most {} bytes", max_bytes);
  return tl::unexpected(error);
}

/// Counts what comes out; the three sources below differ in how it is made.
class CountedSource : public ByteSource {
 public:
  CountedSource(ByteSource& source, std::uint64_t max_bytes) : source_(source), max_bytes_(max_bytes) {}

  Result<std::size_t> read(std::span<char> buffer) final {
    const auto n = produce(buffer);
    if (n && (given_ += *n) > max_bytes_) return too_large(max_bytes_);
    return n;
  }
  bool rewind() final {
    if (!source_.rewind()) return false;
    given_ = taken_ = 0;
    restart();
    return true;
  }

 protected:
  virtual Result<std::size_t> produce(std::span<char> buffer) = 0;
  virtual void restart() = 0;

  /// The next compressed piece, empty at the end. Compressed text that expands to nothing is bounded as well.
  Result<std::span<char>> take_piece() {
    const auto n = source_.read(piece_);
    if (!n) return tl::unexpected(n.error());
    if ((taken_ += *n) > max_bytes_) return too_large(max_bytes_);
    return std::span(piece_).first(*n);
  }

  ByteSource& source_;

 private:
  std::uint64_t max_bytes_;
  std::uint64_t given_ = 0;
  std::uint64_t taken_ = 0;
  std::array<char, kPieceBytes> piece_;
};

class PlainSource : public CountedSource {
 public:
  using CountedSource::CountedSource;

 private:
  Result<std::size_t> produce(std::span<char> buffer) override { return source_.read(buffer); }
  void restart() override {}
};

class GzipSource : public CountedSource {
 public:
  GzipSource(ByteSource& source, std::uint64_t max_bytes) : CountedSource(source, max_bytes) {
    inflateInit2(&stream_, kGzipWindow);
  }
  ~GzipSource() override { inflateEnd(&stream_); }

 private:
  Result<std::size_t> produce(std::span<char> buffer) override {
    stream_.next_out = reinterpret_cast<Bytef*>(buffer.data());
    stream_.avail_out = static_cast<uInt>(std::min<std::size_t>(buffer.size(), 1u << 30));
    const uInt room = stream_.avail_out;
    while (stream_.avail_out == room) {
      if (stream_.avail_in == 0 && !more_inside_) {
        const auto piece = take_piece();
        if (!piece) return tl::unexpected(piece.error());
        if (piece->empty()) return between_members_ && started_ ? Result<std::size_t>(0) : cut_off();
        stream_.next_in = reinterpret_cast<Bytef*>(piece->data());
        stream_.avail_in = static_cast<uInt>(piece->size());
      }
      if (std::exchange(between_members_, false)) inflateReset(&stream_);
      started_ = true;
      const int status = inflate(&stream_, Z_NO_FLUSH);
      more_inside_ = stream_.avail_out == 0 && status == Z_OK;
      if (status == Z_STREAM_END) {
        between_members_ = true;
      } else if (status != Z_OK && status != Z_BUF_ERROR) {
        return fail("malformed_encoding", "the gzip data are damaged or are not gzip");
      }
    }
    return room - stream_.avail_out;
  }
  static tl::unexpected<Error> cut_off() { return fail("malformed_encoding", "the gzip data are cut off"); }
  void restart() override {
    inflateReset(&stream_);
    stream_.avail_in = 0;
    between_members_ = started_ = more_inside_ = false;
  }

  z_stream stream_{};
  bool between_members_ = false;
  bool started_ = false;
  bool more_inside_ = false;  ///< what the decoder still holds comes out before more is read
};

class ZstdSource : public CountedSource {
 public:
  ZstdSource(ByteSource& source, std::uint64_t max_bytes, int window_log2)
      : CountedSource(source, max_bytes), window_log2_(window_log2), stream_(ZSTD_createDStream()) {
    ZSTD_DCtx_setParameter(stream_, ZSTD_d_windowLogMax, window_log2);
  }
  ~ZstdSource() override { ZSTD_freeDStream(stream_); }

 private:
  Result<std::size_t> produce(std::span<char> buffer) override {
    ZSTD_outBuffer out{buffer.data(), buffer.size(), 0};
    while (out.pos == 0) {
      if (in_.pos == in_.size && !more_inside_) {
        const auto piece = take_piece();
        if (!piece) return tl::unexpected(piece.error());
        if (piece->empty()) {
          if (frame_done_) return 0;
          return fail("malformed_encoding", "the zstd data are cut off");
        }
        in_ = {piece->data(), piece->size(), 0};
      }
      const std::size_t hint = ZSTD_decompressStream(stream_, &out, &in_);
      if (ZSTD_getErrorCode(hint) == ZSTD_error_frameParameter_windowTooLarge) {
        return fail("malformed_encoding", fmt::format("the zstd data need a window of more than {} MiB: compress at "
                                                      "level 19 at most, without --long",
                                                      (1 << window_log2_) >> 20));
      }
      if (ZSTD_isError(hint)) return fail("malformed_encoding", "the zstd data are damaged or are not zstd");
      frame_done_ = hint == 0;
      more_inside_ = out.pos == out.size && !frame_done_;
    }
    return out.pos;
  }
  void restart() override {
    ZSTD_DCtx_reset(stream_, ZSTD_reset_session_only);
    in_ = {nullptr, 0, 0};
    frame_done_ = more_inside_ = false;
  }

  int window_log2_;
  ZSTD_DStream* stream_;
  ZSTD_inBuffer in_{nullptr, 0, 0};
  bool frame_done_ = false;
  bool more_inside_ = false;
};

/// Expands once the first bytes have told how.
class ToldByBytes : public ByteSource {
 public:
  ToldByBytes(ByteSource& source, std::uint64_t max_bytes, int zstd_window_log2)
      : source_(source), max_bytes_(max_bytes), zstd_window_log2_(zstd_window_log2) {}

  Result<std::size_t> read(std::span<char> buffer) override {
    if (!expanded_) {
      const auto head = source_.peek();
      if (!head) return tl::unexpected(head.error());
      expanded_ = expand(compression_of_bytes(*head), source_, max_bytes_, zstd_window_log2_);
    }
    return expanded_->read(buffer);
  }
  bool rewind() override { return false; }

 private:
  PeekedSource source_;
  std::uint64_t max_bytes_;
  int zstd_window_log2_;
  std::unique_ptr<ByteSource> expanded_;
};

}  // namespace

Compression compression_of_name(std::string_view file_name) {
  const std::string lower = to_lower_ascii(file_name);
  if (lower.ends_with(".gz")) return Compression::kGzip;
  if (lower.ends_with(".zst")) return Compression::kZstd;
  return Compression::kNone;
}

std::string_view expanded_name(std::string_view file_name) {
  if (compression_of_name(file_name) == Compression::kNone) return file_name;
  return file_name.substr(0, file_name.rfind('.'));
}

std::optional<Compression> compression_of_encoding(std::string_view content_encoding) {
  if (content_encoding.empty() || content_encoding == "identity") return Compression::kNone;
  if (content_encoding == "gzip" || content_encoding == "x-gzip") return Compression::kGzip;
  if (content_encoding == "zstd") return Compression::kZstd;
  return std::nullopt;
}

Compression compression_of_bytes(std::string_view first_bytes) {
  if (first_bytes.starts_with("\x1f\x8b")) return Compression::kGzip;
  const bool skippable =
      first_bytes.size() >= 4 && (first_bytes[0] & 0xF0) == 0x50 && first_bytes.substr(1, 3) == "\x2a\x4d\x18";
  return skippable || first_bytes.starts_with("\x28\xb5\x2f\xfd") ? Compression::kZstd : Compression::kNone;
}

std::unique_ptr<ByteSource> expand(Compression compression, ByteSource& source, std::uint64_t max_bytes,
                                   int zstd_window_log2) {
  switch (compression) {
    case Compression::kGzip:
      return std::make_unique<GzipSource>(source, max_bytes);
    case Compression::kZstd:
      return std::make_unique<ZstdSource>(source, max_bytes, zstd_window_log2);
    case Compression::kNone:
      break;
  }
  return std::make_unique<PlainSource>(source, max_bytes);
}

std::unique_ptr<ByteSource> expand(ByteSource& source, std::uint64_t max_bytes, int zstd_window_log2) {
  return std::make_unique<ToldByBytes>(source, max_bytes, zstd_window_log2);
}

}  // namespace valvetriage
