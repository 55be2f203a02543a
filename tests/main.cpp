// SPDX-License-Identifier: Apache-2.0
// Test runner: Catch2 with one option of ours, --device, to test on one device instead of all.
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdlib>

#include "tests/support/device_fixture.hpp"

int main(int argc, char** argv) {
  Catch::Session session;
  std::string device;
  session.cli(session.cli() | Catch::clara::Opt(device, "device")["--device"]("device to test on (default: all)"));
  if (const int code = session.applyCommandLine(argc, argv); code != 0) return code;
  // What somebody has tuned on this machine is not what is tested.
  setenv("UBS_TUNING", "off", 1);
  ubs::test::select_device(device);
  return session.run();
}
