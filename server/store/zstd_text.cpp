#include "server/store/zstd_text.h"

#include <zstd.h>

#include <new>

namespace valvetriage {
namespace {

/// An analysis or a reference is far smaller; a damaged length must not ask for all the memory.
constexpr unsigned long long kMaxExpandedBytes = std::size_t{256} << 20;
constexpr int kLevel = 3;

}  // namespace

std::string compress_text(std::string_view text) {
  std::string compressed(ZSTD_compressBound(text.size()), '\0');
  const std::size_t size = ZSTD_compress(compressed.data(), compressed.size(), text.data(), text.size(), kLevel);
  if (ZSTD_isError(size)) throw std::bad_alloc();  // with a large enough target only memory can fail
  compressed.resize(size);
  return compressed;
}

Result<std::string> expand_text(std::string_view compressed) {
  const auto damaged = [] { return fail("store_broken", "a stored document is damaged: restore it from a backup"); };
  const unsigned long long size = ZSTD_getFrameContentSize(compressed.data(), compressed.size());
  if (size == ZSTD_CONTENTSIZE_ERROR || size == ZSTD_CONTENTSIZE_UNKNOWN || size > kMaxExpandedBytes) return damaged();
  std::string text(size, '\0');
  const std::size_t got = ZSTD_decompress(text.data(), text.size(), compressed.data(), compressed.size());
  if (ZSTD_isError(got) || got != text.size()) return damaged();
  return text;
}

}  // namespace valvetriage
