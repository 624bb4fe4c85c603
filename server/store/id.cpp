#include "server/store/id.h"

#include <sodium.h>

#include <array>
#include <cstdint>
#include <cstdlib>

namespace valvetriage {
namespace {

constexpr std::string_view kCrockford = "0123456789ABCDEFGHJKMNPQRSTVWXYZ";
constexpr int kTimeDigits = 10;
constexpr int kRandomDigits = 16;

void ensure_sodium() {
  static const int ready = sodium_init();
  if (ready < 0) std::abort();  // no source of randomness: nothing here may run
}

}  // namespace

std::string new_id(std::string_view prefix, TimestampMs now) {
  ensure_sodium();
  std::array<unsigned char, kRandomDigits> random{};
  randombytes_buf(random.data(), random.size());
  std::string id(prefix);
  for (int digit = kTimeDigits - 1; digit >= 0; --digit) {
    id += kCrockford[(static_cast<std::uint64_t>(now) >> (5 * digit)) & 31];
  }
  for (const unsigned char byte : random) id += kCrockford[byte & 31];
  return id;
}

std::string random_name() {
  ensure_sodium();
  std::array<unsigned char, 16> random{};
  randombytes_buf(random.data(), random.size());
  std::string name(random.size() * 2 + 1, '\0');
  sodium_bin2hex(name.data(), name.size(), random.data(), random.size());
  name.pop_back();
  return name;
}

}  // namespace valvetriage
