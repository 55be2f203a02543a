// SPDX-License-Identifier: Apache-2.0
#include "host/base/crc32.hpp"

#include <zlib.h>

namespace ubs {

std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t before) {
  // The pointer of an empty span may be null, and for a null pointer zlib returns the initial CRC.
  if (bytes.empty()) return before;
  return static_cast<std::uint32_t>(
      ::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::uint32_t crc32_joined(std::uint32_t first, std::uint32_t second, std::uint64_t second_bytes) {
  return static_cast<std::uint32_t>(::crc32_combine(first, second, static_cast<z_off_t>(second_bytes)));
}

}  // namespace ubs
