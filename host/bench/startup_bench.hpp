// SPDX-License-Identifier: Apache-2.0
// What a user waits for before training moves: a new process that loads data, opens the device, builds its
// kernels, does one iteration and writes its model.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/base/statistics.hpp"
#include "host/base/temporary_folder.hpp"

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

class StartupBench {
 public:
  explicit StartupBench(StartupOptions options);  // makes the data

  // Milliseconds from starting the process to its end. Cold: with an empty folder as cache of compiled
  // kernels (POCL_CACHE_DIR, CUDA_CACHE_PATH, UBS_KERNEL_CACHE) each time; warm: with the folder of an
  // earlier start.
  Summary measure(bool cold);

 private:
  double milliseconds(const std::string& cache) const;

  StartupOptions options_;
  TemporaryFolder folder_;
  int caches_ = 0;  // that starts have filled
};

}  // namespace ubs::bench
