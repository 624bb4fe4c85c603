#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace valvetriage {

/// The three classes of the paper (section 4), in order: a larger value is a worse valve.
enum class Verdict : std::uint8_t { kGood, kMalfunctioned, kSevere };

inline constexpr std::size_t kVerdictCount = 3;
inline constexpr std::array<Verdict, kVerdictCount> kVerdicts{Verdict::kGood, Verdict::kMalfunctioned,
                                                              Verdict::kSevere};

constexpr std::size_t index_of(Verdict verdict) {
  return static_cast<std::size_t>(verdict);
}

/// `Good`, `Malfunctioned`, `Severe`: as results, tables and rule bases spell them.
constexpr std::string_view to_string(Verdict verdict) {
  constexpr std::array<std::string_view, kVerdictCount> names{"Good", "Malfunctioned", "Severe"};
  return names[index_of(verdict)];
}

/// The same in lower case: the keys of `memberships` and the usual names of input sets.
constexpr std::string_view membership_key(Verdict verdict) {
  constexpr std::array<std::string_view, kVerdictCount> names{"good", "malfunctioned", "severe"};
  return names[index_of(verdict)];
}

/// The verdict of that name, in either spelling; nothing for any other text.
constexpr std::optional<Verdict> verdict_from(std::string_view name) {
  for (const Verdict verdict : kVerdicts) {
    if (name == to_string(verdict) || name == membership_key(verdict)) return verdict;
  }
  return std::nullopt;
}

/// One degree per class, 0 to 1, in the order of kVerdicts. They need not add up to 1.
using Memberships = std::array<double, kVerdictCount>;

/// The class of the largest degree, the worse one where two are equal.
constexpr Verdict largest_membership(const Memberships& memberships) {
  Verdict largest = Verdict::kGood;
  for (const Verdict verdict : kVerdicts) {
    if (memberships[index_of(verdict)] >= memberships[index_of(largest)]) largest = verdict;
  }
  return largest;
}

}  // namespace valvetriage
