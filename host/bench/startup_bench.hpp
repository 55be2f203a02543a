// SPDX-License-Identifier: Apache-2.0
// What a user waits for before training moves: a new process that loads data, opens the device, builds its
// kernels, does one iteration and writes its model.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/base/statistics.hpp"

namespace ubs::bench {

struct StartupOptions {
  std::filesystem::path executable;  // this project's command line tool
  std::string device;                // as --device takes it
  std::string raster = "auto";
  int dim = 6;
  std::size_t splats = 30'000;
  int width = 200, height = 200;
  std::vector<std::string> settings;  // "key=value" as --set takes them
  int repetitions = 5;                // of warm starts; cold ones are repeated twice at most
};

// Milliseconds from starting the process to its end. Cold: with an empty folder as cache of the driver
// (POCL_CACHE_DIR, CUDA_CACHE_PATH) each time; warm: with the folder of an earlier start.
Summary measure_startup(const StartupOptions& options, bool cold);

}  // namespace ubs::bench
