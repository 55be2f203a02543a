// SPDX-License-Identifier: Apache-2.0
// ubs-stress: the stress run as an executable.
#include <cstdio>
#include <cstdlib>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"
#include "tests/stress/run_stress.hpp"

int main(int argc, char** argv) {
  ubs::keep_driver_caches([](const char* name, const char* value) { setenv(name, value, 1); });
  try {
    return ubs::stress::run_stress(argc, argv);
  } catch (const ubs::Error& error) {
    std::fprintf(stderr, "ubs-stress: error: %s\n", error.what());
    return ubs::exit_code(error.kind());
  }
}
