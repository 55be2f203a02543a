// SPDX-License-Identifier: Apache-2.0
// See case.hpp. Raw values are stored as the bits of their floats: NaN and denormals come back as they were.
#include "host/stress/case.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/philox.hpp"
#include "host/data/ply.hpp"
#include "host/scene/camera_json.hpp"

namespace ubs::stress {
namespace {

namespace fs = std::filesystem;

// Camera to world in OpenGL axes, as Blender files have it.
Json blender_frame(const Camera& c, double time) {
  const std::array<double, 3> centre = c.centre();
  Json matrix = Json::array();
  for (std::size_t row = 0; row < 3; ++row)
    matrix.push_back({c.rotation[row], -c.rotation[3 + row], -c.rotation[6 + row], centre[row]});
  matrix.push_back({0, 0, 0, 1});
  return {{"file_path", "view"}, {"time", time}, {"transform_matrix", matrix}};
}

void write_blender(const Case& c, const fs::path& folder) {
  const Camera& camera = c.camera;
  const auto file = [&](Json frames) {
    return Json{{"w", camera.width}, {"h", camera.height}, {"fl_x", camera.fx},          {"fl_y", camera.fy},
                {"cx", camera.cx},   {"cy", camera.cy},    {"frames", std::move(frames)}};
  };
  // Times are normalised over the training frames: with 0 and 1 there, the time of the case stays what it is.
  Json bounds = {blender_frame(camera, 0), blender_frame(camera, 1)};
  bounds[1]["file_path"] = "end";
  write_file_atomically(folder / "transforms_train.json", file(bounds).dump(1) + "\n");
  write_file_atomically(folder / "transforms_test.json",
                        file({blender_frame(camera, camera.time)}).dump(1) + "\n");
}

}  // namespace

std::vector<float> pixel_weights(const Case& c) {
  const std::uint64_t width = static_cast<std::uint64_t>(c.camera.width),
                      height = static_cast<std::uint64_t>(c.camera.height);
  const CounterRandom random(c.seed, 0x57656967u);
  std::vector<float> weights(3 * width * height);
  for (std::uint64_t y = 0; y < height; ++y)
    for (std::uint64_t x = 0; x < width; ++x) {
      const std::uint64_t item = y << 32 | x;
      for (std::uint32_t channel = 0; channel < 3; ++channel)
        weights[channel * width * height + y * width + x] =
            static_cast<float>(random.uniform(item, channel, -1, 1));
    }
  return weights;
}

void save_case(const Case& c, const fs::path& folder) {
  make_folders(folder);
  std::vector<std::uint32_t> bits;
  for (const float v : c.model.values) bits.push_back(std::bit_cast<std::uint32_t>(v));
  const Json json{{"name", c.name},
                  {"seed", c.seed},
                  {"dim", c.model.dim},
                  {"variant", variant_numbers(c.model.variant)},
                  {"splats", c.model.count},
                  {"query_grad", c.query_grad},
                  {"exact", c.exact},
                  {"near", c.settings.projection.near_plane},
                  {"far", c.settings.projection.far_plane},
                  {"eps2d", c.settings.projection.eps2d},
                  {"background", c.settings.background},
                  {"camera", camera_json(c.camera)},
                  {"raw_bits", bits}};
  write_blender(c, folder);
  if (std::ranges::all_of(c.model.values, [](float v) { return std::isfinite(v); })) {
    write_splat_ply(folder / "model.ply", c.model);
  } else {
    remove_path(folder / "model.ply");
  }
  write_file_atomically(folder / "case.json", json_text(json, 1) + "\n");
}

Case load_case(const fs::path& folder) {
  const fs::path path = folder / "case.json";
  const std::string text = read_text_file(path);
  try {
    const Json json = parse_own_json(text, path.string());
    Case c;
    json.at("name").get_to(c.name);
    json.at("seed").get_to(c.seed);
    const auto& numbers = json.at("variant");
    if (numbers.size() != kVariantSwitches.size())
      fail(ErrorKind::data, "{}: the case knows {} switches of the method, this program {}", path.string(),
           numbers.size(), kVariantSwitches.size());
    const auto values = numbers.get<std::array<int, kVariantSwitches.size()>>();
    for (std::size_t i = 0; i < values.size(); ++i)
      if (values[i] < 0 || values[i] > std::ranges::count(std::string_view(kVariantSwitches[i].values), '|'))
        fail(ErrorKind::data, "{}: {} is no value of {}", path.string(), values[i], kVariantSwitches[i].key);
    const ModelVariant variant = variant_from_numbers(values);
    const int dim = json.at("dim").get<int>();
    if (dim < kMinDim || dim > kMaxDim) fail(ErrorKind::data, "{}: dim {}", path.string(), dim);
    const auto splats = json.at("splats").get<std::size_t>();
    const auto bits = json.at("raw_bits").get<std::vector<std::uint32_t>>();
    const auto rows = static_cast<std::size_t>(ParameterLayout(dim, variant).count);
    if (bits.size() % rows != 0 || bits.size() / rows != splats)
      fail(ErrorKind::data, "{}: raw_bits has {} values, not {} of each of {} splats", path.string(),
           bits.size(), rows, splats);
    c.model = SplatModel(dim, splats, variant);
    for (std::size_t i = 0; i < bits.size(); ++i) c.model.values[i] = std::bit_cast<float>(bits[i]);
    json.at("query_grad").get_to(c.query_grad);
    json.at("exact").get_to(c.exact);
    json.at("near").get_to(c.settings.projection.near_plane);
    json.at("far").get_to(c.settings.projection.far_plane);
    json.at("eps2d").get_to(c.settings.projection.eps2d);
    json.at("background").get_to(c.settings.background);
    c.camera = camera_of(json.at("camera"));
    check_camera(c.camera, path.string());
    return c;
  } catch (const Json::exception& error) {
    fail(ErrorKind::data, "{}: not a stress case: {}", path.string(), error.what());
  }
}

}  // namespace ubs::stress
