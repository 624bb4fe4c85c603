#include "server/wire/sha256.h"

#include <gtest/gtest.h>

#include <string>

namespace valvetriage {
namespace {

TEST(Sha256, GivesThePublishedDigests) {  // FIPS 180-4, examples of "" and "abc"
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, OfPiecesIsThatOfTheWhole) {
  const std::string text(1000, 'x');
  Sha256 pieces;
  for (std::size_t from = 0; from < text.size(); from += 7) pieces.update(std::string_view(text).substr(from, 7));
  EXPECT_EQ(pieces.hex(), sha256_hex(text));
  EXPECT_EQ(pieces.hex(), sha256_hex(text)) << "asking does not change the state";
}

}  // namespace
}  // namespace valvetriage
