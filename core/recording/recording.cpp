#include "core/recording/recording.h"

#include <algorithm>
#include <array>
#include <utility>

namespace valvetriage {
namespace {

constexpr std::array<std::pair<TestKind, const char*>, 5> kTestNames{{{TestKind::kStep, "step"},
                                                                      {TestKind::kStaircase, "staircase"},
                                                                      {TestKind::kTriangle, "triangle"},
                                                                      {TestKind::kSweep, "sweep"},
                                                                      {TestKind::kOther, "other"}}};

}  // namespace

std::size_t Recording::valid_samples() const {
  if (valid.empty()) return samples();
  return samples() - static_cast<std::size_t>(std::count(valid.begin(), valid.end(), 0));
}

std::string to_string(TestKind kind) {
  for (const auto& [value, name] : kTestNames) {
    if (value == kind) return name;
  }
  return "other";
}

std::optional<TestKind> test_kind_from(const std::string& name) {
  for (const auto& [value, known] : kTestNames) {
    if (name == known) return value;
  }
  return std::nullopt;
}

}  // namespace valvetriage
