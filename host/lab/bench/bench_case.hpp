// SPDX-License-Identifier: Apache-2.0
// BenchCase is a benchmark, with a name of the form <stage>.<scene>.<splats>.<width>x<height>. all_cases()
// lists all benchmarks, and select_cases() selects those that a command line requests.
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
// Parses a size such as "400x400/100K". Throws Error(usage).
SceneSize parse_scene_size(const std::string& text);
// Returns the count as text, such as "100K", "1M" or "138766".
std::string count_text(std::size_t count);

struct CaseOptions {
  std::vector<SceneSize> sizes;  // replace the standard sizes of each scene
  bool quick = false;            // one small size per scene
  // Sizes of the scenes that are read from files. They are omitted if `splats` is 0.
  SceneSize garden, model;
  // The model has splats of different dimensions, so only rendering can be measured.
  bool mixed_model = false;
};

// Returns the stages of a training step in their order.
const std::vector<std::string>& step_stages();

// Returns all cases, scene by scene.
std::vector<BenchCase> all_cases(const CaseOptions& options);
// Returns the cases whose name contains a match of the regular expression (ECMAScript). Throws Error(usage).
std::vector<BenchCase> select_cases(const std::vector<BenchCase>& cases, const std::string& regex);

}  // namespace ubs::bench
