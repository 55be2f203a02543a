// SPDX-License-Identifier: Apache-2.0
// Test runner: Catch2 with options of ours: --device, to test on one device instead of all; --optional, with
// which a device that is not there skips the tests visibly (exit code 77) instead of failing; --cuda-on-host,
// to test the CUDA back end on the host (tests/cuda).
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdlib>

namespace ubs::test {

// support/device_fixture.cpp; a program without the internals (tests/library) has its own.
int use_device(const std::string& request, bool optional, bool cuda_on_host);

}  // namespace ubs::test

int main(int argc, char** argv) {
  Catch::Session session;
  std::string device;
  bool optional = false, cuda_on_host = false;
  using Catch::clara::Opt;
  session.cli(session.cli() | Opt(device, "device")["--device"]("device to test on (default: all)") |
              Opt(optional)["--optional"]("skip when the device is not there") |
              Opt(cuda_on_host)["--cuda-on-host"]("test the CUDA back end on the host"));
  if (const int code = session.applyCommandLine(argc, argv); code != 0) return code;
  // What somebody has tuned on this machine is not what is tested.
  setenv("UBS_TUNING", "off", 1);
  // Nor do the many commands that tests start prove a device each: tests compare it with float64 themselves.
  setenv("UBS_CHECK", "off", 0);
  if (const int code = ubs::test::use_device(device, optional, cuda_on_host); code != 0) return code;
  return session.run();
}
