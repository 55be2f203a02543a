// SPDX-License-Identifier: Apache-2.0
// What is fuzzed: each target takes a block of bytes as the content of a file and opens it. An Error is a
// correct answer; anything else that leaves a target, and every finding of a sanitizer, is a defect.
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
  std::vector<std::string> (*seeds)();  // small valid files, made here
};

std::span<const Target> targets();

}  // namespace ubs::fuzz
