#include "core/recording/line_reader.h"

#include <fmt/format.h>

#include <cstring>

namespace valvetriage {

Result<void> LineReader::fill() {
  std::memmove(buffer_.get(), buffer_.get() + begin_, size_ - begin_);
  size_ -= begin_;
  begin_ = 0;
  while (!at_end_ && size_ < kMaxLineBytes) {
    const auto got = source_.read({buffer_.get() + size_, kMaxLineBytes - size_});
    if (!got) return tl::unexpected(got.error());
    size_ += *got;
    at_end_ = *got == 0;
  }
  if (at_end_ && size_ > 0 && buffer_[size_ - 1] != '\n') buffer_[size_++] = '\n';
  return {};
}

Result<std::string_view> LineReader::next_block() {
  if (auto filled = fill(); !filled) return tl::unexpected(filled.error());
  if (size_ == 0) return std::string_view{};
  const std::size_t last = std::string_view(buffer_.get(), size_).rfind('\n');
  if (last == std::string_view::npos) {
    return fail("too_large", fmt::format("longer than {} bytes", kMaxLineBytes));
  }
  begin_ = last + 1;
  return std::string_view(buffer_.get(), begin_);
}

}  // namespace valvetriage
