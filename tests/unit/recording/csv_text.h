#pragma once

#include <algorithm>
#include <cstring>
#include <string>

#include "core/recording/parse_csv.h"

namespace valvetriage {

/// A text as a source; `pieces` bytes at a time, rewindable or not.
class TextSource : public ByteSource {
 public:
  explicit TextSource(std::string text, std::size_t piece = 1u << 20, bool can_rewind = true)
      : text_(std::move(text)), piece_(piece), can_rewind_(can_rewind) {}
  Result<std::size_t> read(std::span<char> buffer) override {
    const std::size_t n = std::min({piece_, buffer.size(), text_.size() - at_});
    std::memcpy(buffer.data(), text_.data() + at_, n);
    at_ += n;
    return n;
  }
  bool rewind() override {
    if (can_rewind_) at_ = 0;
    return can_rewind_;
  }

 private:
  std::string text_;
  std::size_t piece_;
  bool can_rewind_;
  std::size_t at_ = 0;
};

inline Result<RawRecording> parse_text(const std::string& text, const ColumnMapping& mapping = {}) {
  TextSource source(text);
  return parse_csv(source, "valve.csv", mapping);
}

/// `rows` good rows of the contract's columns, 5 ms apart, from row `first` on.
inline std::string good_rows(std::size_t rows, std::size_t first = 0) {
  std::string text;
  for (std::size_t i = first; i < first + rows; ++i) {
    text += std::to_string(0.005 * static_cast<double>(i)) + "," + (i < 20 ? "1.0" : "1.2") + "," +
            std::to_string(i % 7) + "\n";
  }
  return text;
}

inline const std::string kHeader = "time_s,current_A,pressure_psi\n";

}  // namespace valvetriage
