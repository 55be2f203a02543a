// SPDX-License-Identifier: Apache-2.0
// These functions compute the CRC-32 that PNG, zip and Ethernet use (polynomial 0xEDB88320, reflected). It
// detects every error burst of up to 32 bits, and any other damage with a probability of 1 - 2^-32.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace ubs {

// Returns the CRC-32 of `bytes` appended to data whose CRC-32 is `before` (0 for no data).
std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t before = 0);
// Returns the CRC-32 of two consecutive chunks of data from the CRC-32 of each. The second chunk has
// `second_bytes` bytes.
std::uint32_t crc32_joined(std::uint32_t first, std::uint32_t second, std::uint64_t second_bytes);

}  // namespace ubs
