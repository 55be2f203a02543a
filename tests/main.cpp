// SPDX-License-Identifier: Apache-2.0
// Test runner: Catch2 with three additional options. --device tests one device instead of all. With
// --optional, a missing device does not make the program fail: it exits with 77, which CTest shows as
// skipped. --cuda-on-host tests the CUDA back end on the host (tests/cuda).
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdlib>

namespace ubs::test {

// Defined in support/device_fixture.cpp. Programs that are not linked with the internal code (tests/library)
// define their own.
int use_device(const std::string& request, bool optional, bool cuda_on_host);

}  // namespace ubs::test

int main(int argc, char** argv) {
  Catch::Session session;
  std::string device;
  bool optional = false, cuda_on_host = false;
  using Catch::clara::Opt;
  session.cli(session.cli() | Opt(device, "device")["--device"]("device to test on (default: all)") |
              Opt(optional)["--optional"]("skip the tests if the device does not exist") |
              Opt(cuda_on_host)["--cuda-on-host"]("test the CUDA back end on the host"));
  if (const int code = session.applyCommandLine(argc, argv); code != 0) return code;
  // Tests must not use constants that were tuned on this machine.
  setenv("UBS_TUNING", "off", 1);
  // The many commands that tests start do not check the device, because the tests themselves compare results
  // of the device with float64. A value of UBS_CHECK that the user has set is kept.
  setenv("UBS_CHECK", "off", 0);
  if (const int code = ubs::test::use_device(device, optional, cuda_on_host); code != 0) return code;
  return session.run();
}
