#include "server/wire/byte_source.h"

#include <errno.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

namespace valvetriage {

Result<std::size_t> MemorySource::read(std::span<char> buffer) {
  const std::size_t count = std::min(buffer.size(), bytes_.size() - at_);
  std::copy_n(bytes_.data() + at_, count, buffer.data());
  at_ += count;
  return count;
}

bool MemorySource::rewind() {
  at_ = 0;
  return true;
}

DescriptorSource::DescriptorSource(int descriptor)
    : descriptor_(descriptor), start_(::lseek(descriptor, 0, SEEK_CUR)) {}

Result<std::size_t> DescriptorSource::read(std::span<char> buffer) {
  for (;;) {
    const ssize_t got = ::read(descriptor_, buffer.data(), buffer.size());
    if (got >= 0) return static_cast<std::size_t>(got);
    if (errno != EINTR) return fail("cannot_read", fmt::format("cannot read: {}", std::strerror(errno)));
  }
}

bool DescriptorSource::rewind() {
  return start_ >= 0 && ::lseek(descriptor_, start_, SEEK_SET) == start_;
}

Result<std::string_view> PeekedSource::peek() {
  while (end_ < kPeekBytes) {
    const auto got = inner_.read({peeked_.data() + end_, kPeekBytes - end_});
    if (!got) return tl::unexpected(got.error());
    if (*got == 0) break;
    end_ += *got;
  }
  return std::string_view(peeked_.data(), end_);
}

Result<std::size_t> PeekedSource::read(std::span<char> buffer) {
  if (begin_ == end_) return inner_.read(buffer);
  const std::size_t count = std::min(buffer.size(), end_ - begin_);
  std::copy_n(peeked_.data() + begin_, count, buffer.data());
  begin_ += count;
  return count;
}

bool PeekedSource::rewind() {
  if (!inner_.rewind()) return false;
  begin_ = end_ = 0;
  return true;
}

Result<std::size_t> HashedSource::read(std::span<char> buffer) {
  const auto got = inner_.read(buffer);
  if (!got) return got;
  bytes_ += *got;
  if (!sha256_.empty()) return got;
  hash_.update({buffer.data(), *got});
  if (*got == 0) sha256_ = hash_.hex();
  return got;
}

bool HashedSource::rewind() {
  if (!inner_.rewind()) return false;
  if (sha256_.empty()) hash_ = Sha256();
  bytes_ = 0;
  return true;
}

Result<void> HashedSource::drain() {
  std::array<char, 16'384> buffer;
  for (;;) {
    const auto got = read(buffer);
    if (!got) return tl::unexpected(got.error());
    if (*got == 0) return {};
  }
}

}  // namespace valvetriage
