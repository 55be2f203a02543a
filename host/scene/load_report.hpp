// SPDX-License-Identifier: Apache-2.0
// LoadReport lists what a loader found, skipped and decided on its own. The tools print it and store it in
// their JSON output.
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
    std::vector<std::string> examples;  // names of the first skipped objects, at most three
  };

  std::string layout, folder;
  std::vector<Skipped> skipped;
  std::vector<std::string> notes;        // without duplicates
  std::vector<std::string> differences;  // the notes that every command prints
  // Descriptions of one undistorted image of the smallest size and one of the largest size. The key is the
  // number of pixels.
  std::map<std::int64_t, std::string> undistorted;

  // Number of images that were split into several views, and number of these views.
  std::size_t wide_images = 0, wide_views = 0;

  // Records that the object called `what` was skipped for the reason `why`.
  void skip(const std::string& what, const std::string& why) { add({why, 1, {what}}); }

  // Adds skipped objects to those that were skipped for the same reason.
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

  // Records the description of an undistorted image with this number of pixels.
  void undistort(std::int64_t pixels, const std::string& text) {
    undistorted.emplace(pixels, text);
    if (undistorted.size() > 2) undistorted.erase(std::next(undistorted.begin()));
  }

  void note(const std::string& text) {
    for (const std::string& known : notes)
      if (known == text) return;
    notes.push_back(text);
  }

  // Adds a note about data that are used in another way than the files state, for example because data were
  // skipped, found in another place or undistorted. Every command that opens the data prints such notes.
  void note_difference(const std::string& text) {
    note(text);
    for (const std::string& known : differences)
      if (known == text) return;
    differences.push_back(text);
  }
};

}  // namespace ubs
