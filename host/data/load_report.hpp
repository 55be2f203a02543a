// SPDX-License-Identifier: Apache-2.0
// What a loader found, left out and decided on its own, for the end of its work: printed by the tools
// and kept in their JSON.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <map>
#include <string>
#include <vector>

namespace ubs {

struct LoadReport {
  struct Skipped {
    std::string why;
    std::size_t count = 0;
    std::vector<std::string> examples;  // the first few
  };

  std::string layout, folder;
  std::vector<Skipped> skipped;
  std::vector<std::string> notes;                   // each once
  std::vector<std::string> differences;             // those of the notes that every command prints
  std::map<std::int64_t, std::string> undistorted;  // by pixels, of the smallest and the largest result

  std::size_t wide_images = 0, wide_views = 0;  // images that became several views, and these views

  void skip(const std::string& what, const std::string& why) { add({why, 1, {what}}); }

  void add(const Skipped& more) {
    constexpr std::size_t kExamples = 3;
    for (Skipped& s : skipped)
      if (s.why == more.why) {
        s.count += more.count;
        for (const std::string& example : more.examples)
          if (s.examples.size() < kExamples) s.examples.push_back(example);
        return;
      }
    skipped.push_back(more);
  }

  void undistort(std::int64_t pixels, const std::string& text) {
    undistorted.emplace(pixels, text);
    if (undistorted.size() > 2) undistorted.erase(std::next(undistorted.begin()));
  }

  void note(const std::string& text) {
    for (const std::string& known : notes)
      if (known == text) return;
    notes.push_back(text);
  }

  // For what is left out or taken from another place than stated: every command that opens the data says it.
  void note_difference(const std::string& text) {
    note(text);
    for (const std::string& known : differences)
      if (known == text) return;
    differences.push_back(text);
  }
};

}  // namespace ubs
