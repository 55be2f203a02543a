// SPDX-License-Identifier: Apache-2.0
// Rows of the list of extreme cases that are not run here, with the reason and the place that covers them.
#include "host/stress/row.hpp"

namespace ubs::stress {

std::vector<Row> rows_elsewhere() {
  return {
      {"10.lists", "count and emission of lists agree", nullptr,
       "both take the rectangle that the projection stored; tests/stages/lists_test.cpp compares the lists"},
      {"13.buffers", "more than 2^31 elements, buffers above the largest allocation", nullptr,
       "refused before they are allocated: row 11.too_many"},
      {"26.nan_alpha", "NaN must not become an opaque alpha", nullptr,
       "row 09.poison puts NaN into every parameter"},
      {"27.images", "16-bit PNG, alpha in half the images, one-pixel masks", nullptr,
       "no device takes part: tests/data/image_test.cpp, nerfstudio_test.cpp and the fuzz targets"},
      {"30.resume", "interrupted runs, damaged checkpoints, a full disk", nullptr,
       "files and processes, no numbers: tests/cli, tests/data/file_test.cpp"},
      {"31.loader", "an image that fails to decode in the middle of a run", nullptr,
       "no device takes part: tests/data/image_pool_test.cpp"},
      {"32.devices", "two devices give the same image", nullptr, "needs two devices: ubs compare"},
      {"p1.convex", "pixels within background and colours", nullptr, "asked of every case of every row"},
      {"p2.gradients", "finite, zero where culled, those of float64", nullptr,
       "asked of every case of every row"}};
}

}  // namespace ubs::stress
