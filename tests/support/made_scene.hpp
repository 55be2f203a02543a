// SPDX-License-Identifier: Apache-2.0
// put_scene() writes the same data set as the command `ubs synth SCENE --size S --views N --test-views M
// --supersampling 1`, but without starting a process. Tests use put_scene() if they need data but do not
// test this command.
#pragma once

#include "host/dataset/synthetic.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

inline void put_scene(const std::filesystem::path& out, int size, int views, int test_views,
                      const std::string& scene = "glossy") {
  export_synthetic({.scene = scene,
                    .width = size,
                    .height = size,
                    .train_views = views,
                    .test_views = test_views,
                    .supersampling = 1},
                   out);
}

}  // namespace ubs::test
