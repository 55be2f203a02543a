// SPDX-License-Identifier: Apache-2.0
#include "host/run/run_cameras.hpp"

#include <map>
#include <set>

#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/dataset/frames_json.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

std::string view_in_split(const std::string& split, const std::string& view) {
  return fmt::format("{}/{}", split, view);
}

// Returns the path of the view's image file relative to `folder`. The path is empty if there is no image file
// that fits the camera of the view.
std::string image_in_folder(const View& view, const std::filesystem::path& folder) {
  if (view.file.empty() || view.resampled) return {};
  return std::filesystem::absolute(view.file).lexically_normal().lexically_relative(folder).string();
}

Json number_row(const Camera& c, const Vec3& centre, std::size_t row) {
  // Camera axes in transforms.json: x right, y up, z backward.
  return {c.rotation[row], -c.rotation[3 + row], -c.rotation[6 + row], centre[row]};
}

Json frame_of(const std::string& file, const std::string& view, const FittedCamera& fitted,
              const Vec3& offset) {
  const Camera& c = fitted.camera;
  const Vec3 centre = c.centre() + offset;
  return {{"file_path", file},
          {"view", view},
          {"transform_matrix",
           {number_row(c, centre, 0), number_row(c, centre, 1), number_row(c, centre, 2), {0, 0, 0, 1}}},
          {"fl_x", c.fx},
          {"fl_y", c.fy},
          {"cx", c.cx},
          {"cy", c.cy},
          {"w", c.width},
          {"h", c.height},
          {"time", c.time},
          {"turn_deviation", fitted.deviation.turn},
          {"centre_deviation", fitted.deviation.centre}};
}

std::map<std::string, Camera> cameras_in(const std::filesystem::path& folder, const Vec3& offset) {
  const std::filesystem::path path = folder / "transforms.json";
  const Json json = frames::parse_file(path, "frames");
  std::map<std::string, Camera> found;
  for (std::size_t i = 0; i < json["frames"].size(); ++i) {
    const frames::Node frame = frames::frame_node(json, i, path.string());
    Camera c;
    frames::set_pose(c, frame);
    c.translation = -1.0 * rotated(c.rotation, c.centre() - offset);
    c.fx = frame.number("fl_x"), c.fy = frame.number("fl_y");
    c.cx = frame.number("cx"), c.cy = frame.number("cy");
    // Files of earlier versions have no member "view", and "file_path" is SPLIT/VIEW.png.
    std::filesystem::path file = decode_text(frame.text("file_path"));
    found.emplace(frame.has("view") ? decode_text(frame.text("view")) : file.replace_extension().string(), c);
  }
  return found;
}

}  // namespace

void write_run_cameras(const std::filesystem::path& folder, std::span<const RunCameras> splits,
                       const std::array<double, 3>& offset, const std::filesystem::path& data) {
  make_folders(folder);
  const std::filesystem::path data_folder =
      std::filesystem::absolute(is_folder(data) ? data : folder_of(data)).lexically_normal();
  std::set<std::string> named;
  Json json{{"camera_model", "PINHOLE"}, {"frames", Json::array()}};
  std::string cameras = "# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n";
  std::string images = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and an empty line\n";
  int id = 0;
  for (const RunCameras& part : splits) {
    Json& names = json[part.split.name + "_filenames"] = Json::array();
    for (std::size_t i = 0; i < part.cameras.size(); ++i) {
      const std::string view = view_in_split(part.split.name, part.split.views[i].name);
      std::string file = image_in_folder(part.split.views[i], data_folder);
      // If a training view and a test view have the same image, only the first one gets its name.
      if (file.empty() || !named.insert(file).second) file = view + ".png";
      Json frame = frame_of(file, view, part.cameras[i], offset);
      const Camera& c = part.cameras[i].camera;
      const Quaternion q = quaternion(c.rotation);
      const Vec3 t = c.translation - rotated(c.rotation, offset);
      cameras +=
          fmt::format("{} PINHOLE {} {} {} {} {} {}\n", ++id, c.width, c.height, c.fx, c.fy, c.cx, c.cy);
      images += fmt::format("{} {} {} {} {} {} {} {} {} {}\n\n", id, q.w, q.x, q.y, q.z, t[0], t[1], t[2], id,
                            file);
      names.push_back(file);
      json["frames"].push_back(std::move(frame));
    }
  }
  write_file_atomically(folder / "cameras.txt", cameras);
  write_file_atomically(folder / "images.txt", images);
  write_file_atomically(folder / "points3D.txt", "# none\n");
  write_file_atomically(folder / "transforms.json", json_text(json, 1) + "\n");
}

void use_run_cameras(const std::filesystem::path& folder, Split& split, const std::array<double, 3>& offset) {
  const auto found = cameras_in(folder, offset);
  for (View& view : split.views) {
    const auto at = found.find(view_in_split(split.name, view.name));
    if (at == found.end()) continue;
    copy_intrinsics(view.camera, at->second);
    if (split.name != "train") continue;
    view.camera.rotation = at->second.rotation;
    view.camera.translation = at->second.translation;
  }
}

std::vector<Camera> run_cameras(const std::filesystem::path& folder, const Split& split,
                                const std::array<double, 3>& offset) {
  const auto found = cameras_in(folder, offset);
  std::vector<Camera> cameras = cameras_of(split);
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const auto at = found.find(view_in_split(split.name, split.views[i].name));
    if (at == found.end()) return {};
    copy_intrinsics(cameras[i], at->second);
    cameras[i].rotation = at->second.rotation;
    cameras[i].translation = at->second.translation;
  }
  return cameras;
}

}  // namespace ubs
