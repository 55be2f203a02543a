// SPDX-License-Identifier: Apache-2.0
// Makes the cameras, samples and files of the procedural data sets; see synthetic.hpp.
#include "host/dataset/synthetic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/parallel.hpp"
#include "host/base/paths.hpp"
#include "host/base/philox.hpp"
#include "host/dataset/image.hpp"
#include "host/scene/synthetic_scene.hpp"

namespace ubs::synthetic {
namespace {

namespace fs = std::filesystem;

struct SplitPlan {
  const char* name;
  int views;
  std::uint32_t stream;
};

std::array<SplitPlan, 3> plan(const SyntheticOptions& o) {
  return {{{"train", o.train_views, 0}, {"test", o.test_views, 1}, {"val", o.val_views, 2}}};
}

// Pose is a camera-to-world pose with OpenGL axes.
struct Pose {
  Vec3 right, up, back, centre;
  double time = 0;
};

// Returns camera i of a split. The views are spread evenly over the upper hemisphere by the two-dimensional
// golden-ratio sequence, with a random shift per split. The steps of this sequence are the first two powers
// of 1 / 1.3247..., where 1.3247... is the root of x^3 = x + 1 (Roberts 2018). The first views of the
// sequence are spread evenly too, so that time and position are not correlated in a dynamic scene.
Pose place_camera(const SplitPlan& split, int i, std::uint64_t seed, const Scene& scene) {
  const CounterRandom random(seed, split.stream);
  const auto sequence = [&](std::uint32_t lane, double step) {
    const double x = random.uniform(0, lane) + step * i;
    return x - std::floor(x);
  };
  const double height = 0.10 + 0.85 * sequence(0, 0.7548776662466927);  // sine of the elevation
  const double azimuth = 2 * std::numbers::pi * sequence(1, 0.5698402909980532);
  const double flat = std::sqrt(1 - height * height);
  Pose pose;
  pose.back = {flat * std::cos(azimuth), flat * std::sin(azimuth), height};
  pose.right = normalize(Vec3(0, 0, 1).cross(pose.back));
  pose.up = pose.back.cross(pose.right);
  pose.centre = pose.back * kSyntheticDistance + Vec3(0, 0, scene.focus_height());
  if (!scene.dynamic()) return pose;
  // Training views are at both ends of the time from 0 to 1 and at equal steps between them. The views of the
  // other splits are at the midpoints of equal intervals, so that their times usually differ from the
  // training times.
  const bool training = split.stream == 0;
  pose.time = training ? static_cast<double>(i) / std::max(1, split.views - 1) : (i + 0.5) / split.views;
  return pose;
}

std::uint8_t to_byte(double x) { return static_cast<std::uint8_t>(std::clamp(x, 0.0, 1.0) * 255.0 + 0.5); }

Sample sample_pixel(const Scene& scene, const Pose& pose, const SyntheticOptions& o, int x, int y) {
  const double focal = o.width / (2 * std::tan(kSyntheticAngleX / 2));
  Sample sum;
  for (int k = 0; k < o.supersampling * o.supersampling; ++k) {
    const double u = (k % o.supersampling + 0.5) / o.supersampling,
                 v = (k / o.supersampling + 0.5) / o.supersampling;
    const Vec3 direction = pose.right * ((x + u - o.width / 2.0) / focal) +
                           pose.up * ((o.height / 2.0 - y - v) / focal) - pose.back;
    const Sample s = scene.trace({pose.centre, normalize(direction)}, pose.time, u, v);
    sum.colour += s.colour;
    sum.alpha += s.alpha;
  }
  const double rays = o.supersampling * o.supersampling;
  return {sum.colour * (1 / rays), sum.alpha / rays};
}

// Renders 8-bit RGBA with straight alpha; fully transparent pixels are black.
std::vector<std::uint8_t> render(const Scene& scene, const Pose& pose, const SyntheticOptions& o) {
  std::vector<std::uint8_t> rgba;
  rgba.reserve(static_cast<std::size_t>(o.width) * static_cast<std::size_t>(o.height) * 4);
  for (int y = 0; y < o.height; ++y)
    for (int x = 0; x < o.width; ++x) {
      const Sample s = sample_pixel(scene, pose, o, x, y);
      const double scale = s.alpha > 0 ? 1 / s.alpha : 0;
      for (int c = 0; c < 3; ++c) rgba.push_back(to_byte(s.colour[c] * scale));
      rgba.push_back(to_byte(s.alpha));
    }
  return rgba;
}

std::string image_name(int i) { return fmt::format("r_{:03}", i); }

Json transforms_json(const SplitPlan& split, const SyntheticOptions& o, const Scene& scene) {
  Json json{{"camera_angle_x", kSyntheticAngleX}, {"w", o.width}, {"h", o.height}, {"frames", Json::array()}};
  for (int i = 0; i < split.views; ++i) {
    const Pose p = place_camera(split, i, o.seed, scene);
    Json rows = Json::array();
    for (int r = 0; r < 3; ++r) rows.push_back({p.right[r], p.up[r], p.back[r], p.centre[r]});
    rows.push_back({0.0, 0.0, 0.0, 1.0});
    Json frame{{"file_path", fmt::format("./{}/{}", split.name, image_name(i))}};
    if (scene.dynamic()) frame["time"] = p.time;
    frame["transform_matrix"] = std::move(rows);
    json["frames"].push_back(std::move(frame));
  }
  return json;
}

std::unique_ptr<Scene> make_scene(const SyntheticOptions& o) {
  if (o.scene == "glossy") return make_glossy();
  if (o.scene == "orbit") return make_orbit();
  if (o.scene == "cloud") return make_cloud(o.seed);
  fail(ErrorKind::usage, "unknown synthetic scene '{}': choose one of {}", o.scene,
       fmt::join(synthetic_scene_names(), ", "));
}

void check_options(const SyntheticOptions& o) {
  const auto check = [](const char* name, int value, int low, int high) {
    if (value < low || value > high)
      fail(ErrorKind::usage, "synthetic scene: {} = {} must be from {} to {}", name, value, low, high);
  };
  check("width", o.width, 1, 8192);
  check("height", o.height, 1, 8192);
  check("train_views", o.train_views, 1, 100000);
  check("test_views", o.test_views, 0, 100000);
  check("val_views", o.val_views, 0, 100000);
  check("supersampling", o.supersampling, 1, 16);
}

fs::path transforms_file(const fs::path& out, const SplitPlan& split) {
  return out / fmt::format("transforms_{}.json", split.name);
}

// Returns all files that the export may write or replace.
std::vector<fs::path> files_of(const SyntheticOptions& o, const fs::path& out) {
  std::vector<fs::path> files;
  for (const SplitPlan& split : plan(o)) {
    files.push_back(transforms_file(out, split));
    for (int i = 0; i < split.views; ++i) files.push_back(out / split.name / (image_name(i) + ".png"));
  }
  return files;
}

// Removes the JSON files of an earlier export first, so that the folder is not a valid data set until the new
// ones are written.
void prepare_folder(const SyntheticOptions& o, const fs::path& out) {
  if (path_exists(out) && !is_folder(out)) fail(ErrorKind::usage, "{}: this is not a folder", out.string());
  for (const fs::path& file : files_of(o, out)) {
    check_ordinary(file);
    if (!o.overwrite && path_exists(file))
      fail(ErrorKind::usage, "{}: already exists: choose another folder, or pass --overwrite to replace it",
           file.string());
  }
  make_folders(out);
  for (const SplitPlan& split : plan(o)) fs::remove(transforms_file(out, split));
}

void render_split(const Scene& scene, const SplitPlan& split, const SyntheticOptions& o,
                  const fs::path& out) {
  make_folders(out / split.name);
  parallel_for(static_cast<std::size_t>(split.views), [&](std::size_t i) {
    const int view = static_cast<int>(i);
    const auto rgba = render(scene, place_camera(split, view, o.seed, scene), o);
    save_png_rgba(out / split.name / (image_name(view) + ".png"), rgba, o.width, o.height);
  });
}

}  // namespace
}  // namespace ubs::synthetic

namespace ubs {

std::vector<std::string> synthetic_scene_names() { return {"glossy", "orbit", "cloud"}; }

void export_synthetic(const SyntheticOptions& options, const std::filesystem::path& out) {
  using namespace synthetic;
  check_options(options);
  const std::unique_ptr<Scene> scene = make_scene(options);
  prepare_folder(options, out);
  for (const SplitPlan& split : plan(options))
    if (split.views > 0) render_split(*scene, split, options, out);
  for (const SplitPlan& split : plan(options))
    if (split.views > 0)
      write_file_atomically(transforms_file(out, split),
                            transforms_json(split, options, *scene).dump(1) + "\n");
}

}  // namespace ubs
