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

  std::string name() const;  // returns, for example, "adam.synthetic.30K.200x200"
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
  // Sizes of the scenes that are not read from files. If this list is empty, these scenes have their standard
  // sizes, or a single small size if `quick` is true.
  std::vector<SceneSize> sizes;
  bool quick = false;
  // Sizes of the two scenes that are read from files. A scene is omitted if its `splats` is 0.
  SceneSize garden, model;
  // If this is true, the model has splats of different dimensions, so only rendering can be measured.
  bool mixed_model = false;
};

// Returns the names of the stages of a training step in the order in which they run.
const std::vector<std::string>& step_stages();

// Returns all cases, scene by scene.
std::vector<BenchCase> all_cases(const CaseOptions& options);
// Returns the cases whose name contains a match of the regular expression (ECMAScript). Throws Error(usage).
std::vector<BenchCase> select_cases(const std::vector<BenchCase>& cases, const std::string& regex);

}  // namespace ubs::bench
