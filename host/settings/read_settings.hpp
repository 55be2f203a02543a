// SPDX-License-Identifier: Apache-2.0
// ReadSettings holds the settings for reading data (docs/data.md). Each setting has a member in this struct
// and a row in read_fields(), and is used in host/dataset.
#pragma once

#include <string>
#include <vector>

#include "host/base/index_range.hpp"
#include "host/settings/field.hpp"

namespace ubs {

enum class PrincipalPoint { as_given, centre };

struct ReadSettings {
  std::string layout = "auto";  // layout of the data (host/dataset/load_dataset.cpp); auto: recognised
  std::string images = "auto";  // name of the image folder in COLMAP and LLFF data; auto: `images`
  // Name of the folder in sparse/ that contains the COLMAP model; auto: the model with the most images.
  std::string colmap_model = "auto";
  std::string cache_folder;  // for undistorted images and video frames; empty: they are not stored
  int downscale = 1;         // width and height of images are reduced by this factor
  // For all data except Blender and N3V: every n-th view is a test view; 0: no test views; auto: see
  // split_views() in host/dataset/split_views.hpp.
  int test_every = kAutoInt;
  int image_cache_mb = 4096;         // memory for decoded images [MB]; others are decoded when needed
  PrincipalPoint principal_point{};  // as in the data, or the centre of the image as published
  IndexRange frames;                 // frames of videos that are used
  // Whether links, absolute paths and .. in the data may refer to files outside of the data folder.
  bool allow_outside = false;
  bool operator==(const ReadSettings&) const = default;
};

// Returns the fields of ReadSettings, for the table of fields of settings S that inherit from ReadSettings.
template <typename S>
std::vector<Field<S>> read_fields() {
  constexpr auto used = &with_uses<S>;
  return {
      used(kOfReading | kSetFirst,
           {"downscale", "load images with width and height reduced by this factor", &S::downscale, 1, 64}),
      used(kOfReading,
           {"layout", "layout of the data (docs/data.md); auto: recognised by their contents", &S::layout}),
      used(kOfReading,
           {"images", "name of the image folder in COLMAP and LLFF data; auto: 'images'", &S::images}),
      used(
          kOfReading,
          {"colmap_model",
           "name of the folder in sparse/ that contains the COLMAP model; auto: the one with the most images",
           &S::colmap_model}),
      used(kOfReading,
           {"principal_point",
            "principal point of the cameras: as in the data (true), or the centre of the image (centre), as "
            "in the published code",
            &choice<S, &S::principal_point>, -1, 1, false, "true|centre"}),
      used(kOfReading | kSetFirst, {"test_every",
                                    "use every n-th view in the order of names as a test view (not for "
                                    "Blender and N3V data); 0: no test views; auto: every 8th view, or "
                                    "with fewer than 24 images, views that are chosen by their camera poses "
                                    "(docs/data.md)",
                                    &S::test_every, 0, 1'000'000, true}),
      used(kFreeOnResume, {"image_cache_mb",
                           "memory for decoded images [MB]; images that do not fit are decoded when needed",
                           &S::image_cache_mb, 1, 1 << 20}),
      used(kFreeOnResume | kOfReading | kOfUser,
           {"cache_folder", "folder in which undistorted images and video frames are kept; empty: none",
            &S::cache_folder}),
      used(kFreeOnResume | kOfReading | kOfUser,
           {"allow_outside",
            "allow links, absolute paths and .. in the data to refer to files outside of the data folder",
            &S::allow_outside}),
      used(kOfReading,
           {"frames", "frames of videos to use, FIRST:END:STEP, such as 0:300 or 0:300:2; empty: all",
            &S::frames, 0, 10'000'000, true}),
  };
}

}  // namespace ubs
