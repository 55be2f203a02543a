// SPDX-License-Identifier: Apache-2.0
#include "host/base/crc32.hpp"

#include <array>

namespace ubs {
namespace {

constexpr std::array<std::uint32_t, 256> make_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = value & 1 ? 0xEDB88320u ^ (value >> 1) : value >> 1;
    table[i] = value;
  }
  return table;
}
constexpr std::array<std::uint32_t, 256> kTable = make_table();

}  // namespace

std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t before) {
  std::uint32_t value = ~before;
  for (const std::byte b : bytes)
    value = kTable[(value ^ static_cast<std::uint32_t>(b)) & 0xff] ^ (value >> 8);
  return ~value;
}

}  // namespace ubs
