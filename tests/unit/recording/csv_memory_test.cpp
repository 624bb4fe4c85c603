// The CSV reader's promise on memory: at most 1.3 times the parsed arrays plus a fixed buffer.
#include <gtest/gtest.h>
#include <malloc.h>

#include <atomic>
#include <cstdlib>
#include <new>

#include "core/recording/limits.h"
#include "tests/unit/recording/csv_text.h"

namespace {

std::atomic<std::size_t> in_use{0};
std::atomic<std::size_t> most_in_use{0};

void* counted(std::size_t size) {
  void* memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  const std::size_t now = in_use += malloc_usable_size(memory);
  if (now > most_in_use) most_in_use = now;
  return memory;
}

void release(void* memory) noexcept {
  if (memory != nullptr) in_use -= malloc_usable_size(memory);
  std::free(memory);
}

}  // namespace

void* operator new(std::size_t size) {
  return counted(size);
}
void* operator new[](std::size_t size) {
  return counted(size);
}
void operator delete(void* memory) noexcept {
  release(memory);
}
void operator delete[](void* memory) noexcept {
  release(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  release(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  release(memory);
}

namespace valvetriage {
namespace {

TEST(CsvMemory, StaysWithinThreeTenthsOfTheArraysAndAFixedBuffer) {
  // the reader's line buffer, names, the plan: nothing that grows with the rows
  constexpr std::size_t kFixedBytes = 2 * kMaxLineBytes;
  for (const std::size_t rows : {std::size_t{1'000}, std::size_t{1} << 16, std::size_t{300'001}}) {
    TextSource source("# serial: 1\n" + kHeader + good_rows(rows));
    const std::size_t before = in_use;
    most_in_use = before;
    const auto raw = parse_csv(source, "valve.csv", {});
    ASSERT_TRUE(raw);
    ASSERT_EQ(raw->output.values.size(), rows);
    const double arrays = static_cast<double>(3 * rows * sizeof(double));
    const double peak = static_cast<double>(most_in_use - before);
    RecordProperty("peak_over_arrays_" + std::to_string(rows), std::to_string(peak / arrays));
    EXPECT_LE(peak, 1.3 * arrays + static_cast<double>(kFixedBytes)) << rows << " rows";
  }
}

}  // namespace
}  // namespace valvetriage
