// SPDX-License-Identifier: Apache-2.0
// The CRC-32 of PNG, zip and Ethernet (polynomial 0xEDB88320, reflected): finds every error burst of up to 32
// bits, and any other damage but for one in 2^32.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace ubs {

// Of `bytes` behind what `before` is the CRC-32 of (0 for nothing).
std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t before = 0);
// The CRC-32 of two pieces, one directly after the other, from that of each; the second has `second_bytes`.
std::uint32_t crc32_joined(std::uint32_t first, std::uint32_t second, std::uint64_t second_bytes);

}  // namespace ubs
