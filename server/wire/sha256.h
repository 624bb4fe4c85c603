#pragma once

#include <sodium/crypto_hash_sha256.h>

#include <string>
#include <string_view>

namespace valvetriage {

/// SHA-256 of bytes that arrive piece by piece, by libsodium.
///
/// Cost   one pass, fixed memory; one object, one thread
class Sha256 {
 public:
  Sha256() { crypto_hash_sha256_init(&state_); }
  Sha256& update(std::string_view bytes);
  /// 64 lower-case hexadecimal digits of everything given so far; the object can go on afterwards.
  std::string hex() const;

 private:
  crypto_hash_sha256_state state_;
};

/// SHA-256 of one piece.
std::string sha256_hex(std::string_view bytes);

}  // namespace valvetriage
