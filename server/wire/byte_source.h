#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "core/recording/parse_csv.h"
#include "server/wire/sha256.h"

namespace valvetriage {

/// Bytes that somebody else keeps alive.
class MemorySource : public ByteSource {
 public:
  explicit MemorySource(std::string_view bytes) : bytes_(bytes) {}
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override;

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

/// An open descriptor, read from where it stands; not closed. A pipe cannot rewind.
class DescriptorSource : public ByteSource {
 public:
  explicit DescriptorSource(int descriptor);
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override;

 private:
  int descriptor_;
  long long start_;  ///< negative where it cannot be sought
};

/// Shows the first bytes of a source, which has to live longer, without taking them.
class PeekedSource : public ByteSource {
 public:
  static constexpr std::size_t kPeekBytes = 512;

  explicit PeekedSource(ByteSource& inner) : inner_(inner) {}
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override;
  /// Up to kPeekBytes; call before the first read. Valid until the next read or rewind.
  Result<std::string_view> peek();

 private:
  ByteSource& inner_;
  std::array<char, kPeekBytes> peeked_{};
  std::size_t begin_ = 0, end_ = 0;
};

/// Hashes and counts the bytes of a source, which has to live longer, as they pass. The hash is that of the first whole
/// pass; what is read again after a rewind is not hashed again.
class HashedSource : public ByteSource {
 public:
  explicit HashedSource(ByteSource& inner) : inner_(inner) {}
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override;
  /// Reads what is left to the end, so that the hash is complete.
  Result<void> drain();
  /// SHA-256 in lower-case hex; empty before a pass met the end.
  const std::string& sha256() const { return sha256_; }
  std::size_t bytes() const { return bytes_; }

 private:
  ByteSource& inner_;
  Sha256 hash_;
  std::size_t bytes_ = 0;
  std::string sha256_;
};

}  // namespace valvetriage
