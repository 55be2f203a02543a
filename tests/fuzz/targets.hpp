// SPDX-License-Identifier: Apache-2.0
// Lists the fuzz targets. Each target reads its input, any sequence of bytes, as the content of one or more
// files. An Error is a correct result. Any other exception, and every report of a sanitizer, is a defect.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ubs::fuzz {

struct Target {
  const char* name;
  void (*run)(std::span<const std::uint8_t> data);
  std::vector<std::string> (*seeds)();  // returns small valid inputs
};

std::span<const Target> targets();

}  // namespace ubs::fuzz
