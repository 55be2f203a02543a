// SPDX-License-Identifier: Apache-2.0
// What can be measured: cases named <stage>.<scene>.<splats>.<width>x<height>, and which of them a command
// line asks for.
#pragma once

#include <string>
#include <vector>

namespace ubs::bench {

struct BenchCase {
  std::string stage, scene;
  std::size_t splats = 0;
  int width = 0, height = 0;

  std::string name() const;  // "adam.synthetic.30K.200x200"
  bool operator==(const BenchCase&) const = default;
};

struct SceneSize {
  std::size_t splats = 0;
  int width = 0, height = 0;
};
// "400x400/100K". Throws Error(usage).
SceneSize parse_scene_size(const std::string& text);
// "100K", "1M", "138766".
std::string count_text(std::size_t count);

struct CaseOptions {
  std::vector<SceneSize> sizes;  // instead of the usual ones of each scene
  bool quick = false;            // one small size of each
  // Scenes that come from files, with what these hold; left out where splats is 0.
  SceneSize garden, model;
  bool mixed_model = false;  // of several dimensions: drawing is all that can be measured of it
};

// The stages of a training step in their order.
const std::vector<std::string>& step_stages();

// All cases, scene by scene.
std::vector<BenchCase> all_cases(const CaseOptions& options);
// Those whose name contains a match of the regular expression (ECMAScript). Throws Error(usage).
std::vector<BenchCase> select_cases(const std::vector<BenchCase>& cases, const std::string& regex);

}  // namespace ubs::bench
