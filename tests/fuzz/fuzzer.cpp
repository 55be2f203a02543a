// SPDX-License-Identifier: Apache-2.0
// Defines the entry points of libFuzzer for the target with the number UBS_FUZZ_TARGET. If the environment
// variable UBS_FUZZ_SEEDS contains a folder, the program writes the seeds to this folder when it starts.
#include <cstdlib>
#include <fstream>

#include "tests/fuzz/targets.hpp"

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  if (const char* folder = std::getenv("UBS_FUZZ_SEEDS")) {
    int number = 0;
    for (const std::string& seed : ubs::fuzz::targets()[UBS_FUZZ_TARGET].seeds())
      std::ofstream(std::string(folder) + "/seed" + std::to_string(number++), std::ios::binary) << seed;
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ubs::fuzz::targets()[UBS_FUZZ_TARGET].run({data, size});
  return 0;
}
