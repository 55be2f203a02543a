// SPDX-License-Identifier: Apache-2.0
// add_stated_views() converts images whose names, cameras and lenses a data set states to views. The loaders
// of COLMAP and of other photogrammetry programs use it, so that they find images and masks in the same way
// and print the same messages.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/dataset/data_root.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/lens.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/named_files.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

struct StatedView {
  StatedName image;  // name of the image file, relative to the image folder
  Camera pose;       // only its rotation and translation are used
  // Size that the data state. If there is none, the image file must exist.
  std::optional<ImageSize> size;
  std::function<Lens(ImageSize)> lens;  // returns the lens for an image of this size
};

// ImageFolder is where the images of a data set are searched for.
struct ImageFolder {
  std::filesystem::path path;  // folder that the names are relative to
  std::string name;            // as in the option --images
  bool chosen = false;         // by --images: images elsewhere in the data folder are not considered
};
// Returns the folder that --images selects, or the first of the candidates that has the image `first`, or the
// first candidate that exists.
ImageFolder find_image_folder(const std::filesystem::path& folder, const DatasetOptions& options,
                              DataRoot& root, const std::string& first,
                              const std::vector<std::string>& candidates);

// Returns the views of the images. Images that do not exist are skipped and counted in the report; if none of
// them exists, throws Error(data) with a message that ends in `hint`.
std::vector<View> make_stated_views(const std::filesystem::path& folder, const ImageFolder& images,
                                    const std::vector<StatedView>& stated, const DataRoot& root,
                                    const DatasetOptions& options, LoadReport& report,
                                    std::string_view hint = {});

// Splits the views by name (split_views()) and adds them to the scene. `stated` is the result of a loader.
void add_stated_views(LoadedScene& scene, const std::filesystem::path& folder, const ImageFolder& images,
                      const std::vector<StatedView>& stated, const DataRoot& root,
                      const DatasetOptions& options);

// Directions of the axes of a camera: x is to the right.
enum class CameraAxes { y_down_z_forward, y_up_z_backward };
// Returns the camera with this position and this row-major rotation from camera to world.
Camera pose_from_world(std::array<double, 9> to_world, const std::array<double, 3>& position, CameraAxes axes,
                       const std::string& where);
// Returns the camera with this row-major rotation from world to camera and this translation.
Camera pose_from_camera(std::array<double, 9> to_camera, std::array<double, 3> translation, CameraAxes axes,
                        const std::string& where);

// Returns a lens with the given model (lens.hpp), focal lengths and principal point [px]. Its coefficients
// are 0, and can be set with Lens::set().
Lens make_lens(std::string_view model, ImageSize size, double fx, double fy, double cx, double cy);

// Returns the number in the text, which must be finite and may be surrounded by blanks.
double number_in(std::string_view text, const std::string& where);
// Returns the numbers in a text in which blanks separate them. Throws Error(data) unless there are `count`.
std::vector<double> numbers_in(std::string_view text, std::size_t count, const std::string& where);

}  // namespace ubs
