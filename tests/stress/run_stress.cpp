// SPDX-License-Identifier: Apache-2.0
#define CATCH_CONFIG_RUNNER
#include "tests/stress/run_stress.hpp"

#include <catch2/catch.hpp>
#include <memory>

#include "host/base/error.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

constexpr int kFailureExitCode = 9;

}  // namespace

int run_stress(int argc, char** argv) {
  Catch::Session session;
  StressOptions options;
  using Catch::clara::Opt;
  session.cli(session.cli() |
              Opt(options.device, "DEVICE")["--device"]("device to test: index, type, back end or name") |
              Opt(options.raster, "KIND")["--raster"]("kind of kernels: auto, cpu or gpu [auto]") |
              Opt(options.seed, "S")["--seed"]("seed of the random cases [1]") |
              Opt(options.first, "K")["--first"]("number of the first random case [0]") |
              Opt(options.cases, "N")["--cases"]("number of random cases [3000]"));
  if (session.applyCommandLine(argc, argv) != 0) return exit_code(ErrorKind::usage);
  const auto& chosen = session.configData();
  if (chosen.showHelp || chosen.listTests || chosen.listTags || chosen.listReporters) {
    session.run();  // some versions return the number of listed entries
    return 0;
  }
  for (const auto& [name, value] :
       {std::pair{"--seed", options.seed}, {"--first", options.first}, {"--cases", options.cases}})
    if (value < 0) fail(ErrorKind::usage, "{}: expected a number of 0 or more, not {}", name, value);

  const std::unique_ptr<Device> device = open_device(options.device);
  DeviceRunner runner(*device, raster_kind(options.raster, device->info()));
  Row::use(runner, options);
  const bool failed = session.run() != 0;
  if (Row::started() == 0) fail(ErrorKind::usage, "no test case was run: --list-tests shows their names");
  return failed ? kFailureExitCode : 0;
}

}  // namespace ubs::stress
