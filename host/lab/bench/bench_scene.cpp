// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/bench_scene.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/dataset/blender.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/synthetic.hpp"
#include "host/scene/initialise.hpp"
#include "host/scene/pose.hpp"
#include "host/train/trainer.hpp"

namespace ubs::bench {
namespace {

constexpr int kTrainingSize = 100;  // maximum width and height of the images for training [px]

// Returns a camera that looks at the origin from 30 degrees above the horizon. The z axis of the world points
// up.
Camera orbit_camera(double azimuth, int width, int height) {
  const double elevation = std::numbers::pi / 6;
  const Vec3 centre{kSyntheticDistance * std::cos(elevation) * std::cos(azimuth),
                    kSyntheticDistance * std::cos(elevation) * std::sin(azimuth),
                    kSyntheticDistance * std::sin(elevation)};
  Pose pose = look_at(centre, {0, 0, 0}, {0, 0, 1});
  pose.fov = kSyntheticAngleX;
  return camera_at(pose, {width, height, std::vector<double>(8)});
}

Plan short_training(const TrainedOptions& options) {
  TrainSettings settings;
  settings.schedule = ScheduleKind::published;
  settings.dim = options.dim;
  settings.iterations = options.iterations;
  settings.init_points = settings.cap_max = static_cast<int>(options.splats);
  settings.raster = options.raster;
  settings.variant = options.variant;
  return settle(settings);
}

std::vector<float> garden_array(const std::filesystem::path& folder, const char* name, std::size_t columns) {
  const std::filesystem::path file = folder / fmt::format("{}.npy", name);
  NpyArray array = read_npy(file);
  if (array.values.empty() || array.values.size() % columns != 0)
    fail(ErrorKind::data, "{}: {} values are not enough, or not a multiple of the number of columns",
         file.string(), array.values.size());
  return std::move(array.values);
}

Camera garden_camera(const float* view, const float* k, int width, int height) {
  Camera camera;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) camera.rotation[3 * r + c] = view[4 * r + c];
    camera.translation[r] = view[4 * r + 3];
  }
  camera.fx = k[0];
  camera.cx = k[2];
  camera.fy = k[4];
  camera.cy = k[5];
  camera.width = width;
  camera.height = height;
  camera.extra.assign(8, 0.0);
  return camera;
}

}  // namespace

Image8 made_up_image(int width, int height) {
  Image8 image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  std::size_t at = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double u = 2.0 * x / width - 1, v = 2.0 * y / height - 1;
      const bool object = u * u / 0.64 + v * v / 0.3 < 1 || (u - 0.2) * (u - 0.2) / 0.12 + v * v / 0.72 < 1;
      for (const double phase : {0.0, 2.0, 4.0})
        image.rgb[at++] =
            object ? static_cast<std::uint8_t>(127 + 100 * std::sin(9 * u + phase) * std::cos(7 * v)) : 255;
    }
  return image;
}

BenchScene random_start(int dim, std::size_t splats, int width, int height, const ModelVariant& variant) {
  InitOptions start{.variant = variant};
  if (!row_of(variant.kernel).scale_is_support) {  // as in 3DGS
    start.opacity = 0.1;
    start.initial_ratio = 1;
  }
  BenchScene scene{initialise_random(dim, splats, 42, start), {"train", {}}, {1, 1, 1}};
  for (int v = 0; v < 8; ++v)
    scene.views.views.push_back({fmt::format("view_{}", v),
                                 orbit_camera(v * std::numbers::pi / 4, width, height),
                                 made_up_image(width, height)});
  return scene;
}

BenchScene trained_scene(Device& device, const std::string& scene, const TrainedOptions& options) {
  const TemporaryFolder folder;
  const auto load = [&](int width, int height, int views, const std::string& name) {
    export_synthetic({.scene = scene,
                      .width = width,
                      .height = height,
                      .train_views = views,
                      .test_views = 0,
                      .supersampling = 1},
                     folder.path() / name);
    return load_blender_split(folder.path() / name, "train");
  };
  const int training = std::min(kTrainingSize, std::max(options.width, options.height));
  const Split small = load(training, training, 24, "training"), none{"test", {}};
  Trainer trainer(device, short_training(options), small, none,
                  initialise_random(options.dim, options.splats, 42, {.variant = options.variant}));
  trainer.run([](const StepReport&) { return true; });
  return {trainer.model(), load(options.width, options.height, 4, "views"), {0, 0, 0}};
}

SceneSize garden_size(const std::filesystem::path& folder) {
  const float width = garden_array(folder, "width", 1)[0], height = garden_array(folder, "height", 1)[0];
  if (!(width >= 1 && height >= 1 && width <= 16384 && height <= 16384))
    fail(ErrorKind::data, "{}: the image size {} x {} is not supported", folder.string(), width, height);
  return {garden_array(folder, "means3d", 3).size() / 3, static_cast<int>(width), static_cast<int>(height)};
}

BenchScene garden_scene(const std::filesystem::path& folder, int dim, const ModelVariant& variant) {
  const SceneSize size = garden_size(folder);
  const std::vector<float> means = garden_array(folder, "means3d", 3),
                           colours = garden_array(folder, "colors", 3),
                           views = garden_array(folder, "viewmats", 16),
                           intrinsics = garden_array(folder, "Ks", 9);
  const std::size_t points = size.splats, cameras = views.size() / 16;
  if (colours.size() != means.size() || intrinsics.size() != 9 * cameras)
    fail(ErrorKind::data, "{}: the sizes of the arrays do not match", folder.string());
  std::vector<std::array<float, 3>> positions(points);
  std::vector<std::array<std::uint8_t, 3>> rgb(points);
  for (std::size_t i = 0; i < 3 * points; ++i) {
    positions[i / 3][i % 3] = means[i];
    const double colour = checked_input(colours[i], "a colour of colors.npy");
    rgb[i / 3][i % 3] = static_cast<std::uint8_t>(std::clamp(colour, 0.0, 255.0));
  }
  BenchScene scene{
      initialise_from_points(dim, positions, rgb, 42, {.variant = variant}), {"train", {}}, {0, 0, 0}};
  for (std::size_t v = 0; v < cameras; ++v) {
    const Camera camera = garden_camera(&views[16 * v], &intrinsics[9 * v], size.width, size.height);
    check_camera(camera, fmt::format("{}: camera {}", folder.string(), v));
    scene.views.views.push_back({fmt::format("view_{}", v), camera, made_up_image(size.width, size.height)});
  }
  return scene;
}

}  // namespace ubs::bench
