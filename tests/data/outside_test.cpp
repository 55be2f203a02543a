// SPDX-License-Identifier: Apache-2.0
// Tests that opening a data set reads no file outside of its folder, whatever paths and links the data
// contain, unless the user allows this (host/dataset/data_root.hpp).
#include <filesystem>

#include "host/dataset/data_root.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/npy.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

constexpr const char* kPose = R"("transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]])";
constexpr const char* kPoints =
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    "end_header\n1 2 3\n";

// Creates data/, and next to it secret/ with an image and a point cloud.
struct Scene {
  TempFolder folder;
  Scene() {
    put_image(folder / "secret/x.png", 16, 12);
    put(folder / "secret/p.ply", kPoints);
    fs::create_directories(folder / "data");
  }
  fs::path data() const { return folder / "data"; }

  // Checks that the data are rejected without --allow-outside, with a message that contains this option and
  // the text `what`. Also checks that the data are opened with the option.
  void check_outside(const fs::path& opened, const std::string& what) const {
    CHECK_THAT(message_of([&] { load_dataset(opened); }),
               Contains(what) && Contains("outside of the folder") && Contains("--allow-outside"));
    CHECK_NOTHROW(load_dataset(opened, {.read = {.allow_outside = true}}));
  }
};

void put_nerfstudio(const fs::path& folder, const std::string& image, const std::string& more = "",
                    const std::string& head = "") {
  put(folder / "transforms.json",
      fmt::format(R"({{"w": 16, "h": 12, "fl_x": 20, {} "frames": [{{"file_path": "{}", {}{}}}]}})", head,
                  image, kPose, more));
}

void put_blender(const fs::path& folder, const std::string& image) {
  put(folder / "transforms_train.json",
      fmt::format(R"({{"camera_angle_x": 0.9, "frames": [{{"file_path": "{}", {}}}]}})", image, kPose));
}

void put_colmap(const fs::path& folder, const std::string& image) {
  put(folder / "sparse/0/cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
  put(folder / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 in.png\n\n2 1 0 0 0 1 0 0 1 " + image + "\n\n");
  put_image(folder / "images/in.png", 16, 12);
}

}  // namespace

TEST_CASE("outside: paths in JSON files that lead out of the folder are rejected", "[outside]") {
  const Scene scene;
  const fs::path absolute = scene.folder / "secret/x.png";
  put_image(scene.data() / "in.png", 16, 12);
  for (const std::string& path :
       {std::string("../secret/x.png"), absolute.string(), std::string("./a/../../secret/x.png")}) {
    put_nerfstudio(scene.data(), path);
    fs::create_directories(scene.data() / "a");
    scene.check_outside(scene.data(), "frame 0");
    scene.check_outside(scene.data() / "transforms.json", "frame 0");
  }
  put_nerfstudio(scene.data(), "in.png", R"(, "mask_path": "../secret/x.png")");
  scene.check_outside(scene.data(), "frame 0");
  put_nerfstudio(scene.data(), "in.png", "", R"("ply_file_path": "../secret/p.ply",)");
  scene.check_outside(scene.data(), "p.ply");
  put_nerfstudio(scene.data(), "../data/in.png");  // leads back into the folder
  CHECK_NOTHROW(load_dataset(scene.data()));
  fs::remove(scene.data() / "transforms.json");
  put_blender(scene.data(), "../secret/x");
  scene.check_outside(scene.data(), "frame 0");
  put_blender(scene.data(), "in");
  CHECK_NOTHROW(load_dataset(scene.data()));
}

TEST_CASE("outside: symbolic links that lead out of the folder are rejected", "[outside]") {
  const Scene scene;
  fs::create_symlink(scene.folder / "secret", scene.data() / "linked");
  put_nerfstudio(scene.data(), "linked/x.png");
  scene.check_outside(scene.data(), "frame 0");
  fs::create_symlink(scene.folder / "secret/x.png", scene.data() / "x.png");
  put_nerfstudio(scene.data(), "x.png");
  scene.check_outside(scene.data(), "frame 0");

  put_image(scene.data() / "in.png", 16, 12);
  fs::create_symlink("in.png", scene.data() / "alias.png");  // a link that stays inside
  put_nerfstudio(scene.data(), "alias.png");
  CHECK_NOTHROW(load_dataset(scene.data()));
  fs::create_directory_symlink("data", scene.folder / "link");  // the data folder itself is a link
  CHECK_NOTHROW(load_dataset(scene.folder / "link"));

  fs::rename(scene.data() / "transforms.json", scene.folder / "secret/t.json");
  fs::create_symlink(scene.folder / "secret/t.json", scene.data() / "transforms.json");
  CHECK_THAT(message_of([&] { load_dataset(scene.data()); }), Contains("--allow-outside"));
  CHECK_NOTHROW(load_dataset(scene.data() / "transforms.json"));  // the user passed this path
  fs::remove(scene.data() / "transforms.json");
  fs::create_symlink("loop", scene.data() / "loop");
  put_nerfstudio(scene.data(), "loop/a.png");
  CHECK_THAT(message_of([&] { load_dataset(scene.data()); }), Contains("Too many levels of symbolic links"));
}

TEST_CASE("outside: splits and points of the Blender layout must be in the folder", "[outside]") {
  const Scene scene;
  put_image(scene.data() / "in.png", 16, 12);
  put_blender(scene.data(), "in");
  fs::create_symlink(scene.folder / "secret/p.ply", scene.data() / "points3d.ply");
  scene.check_outside(scene.data(), "points3d.ply");
  fs::remove(scene.data() / "points3d.ply");
  fs::rename(scene.data() / "transforms_train.json", scene.folder / "secret/t.json");
  fs::create_symlink(scene.folder / "secret/t.json", scene.data() / "transforms_train.json");
  scene.check_outside(scene.data(), "transforms_train.json");
}

TEST_CASE("outside: images, masks and model files of COLMAP must be in the folder", "[outside]") {
  const Scene scene;
  for (const std::string& name :
       {std::string("../../secret/x.png"), (scene.folder / "secret/x.png").string()}) {
    put_colmap(scene.data(), name);
    scene.check_outside(scene.data(), "image '" + name);
  }
  put_colmap(scene.data(), "in.png");
  CHECK_NOTHROW(load_dataset(scene.data()));
  fs::create_directories(scene.data() / "masks");
  fs::create_symlink(scene.folder / "secret/x.png", scene.data() / "masks/in.png");
  scene.check_outside(scene.data(), "masks");
  fs::remove_all(scene.data() / "masks");
  fs::rename(scene.data() / "sparse/0/cameras.txt", scene.folder / "secret/cameras.txt");
  fs::create_symlink(scene.folder / "secret/cameras.txt", scene.data() / "sparse/0/cameras.txt");
  scene.check_outside(scene.data(), "cameras.txt");
  // An image folder that the user passes may be anywhere, and its content is allowed.
  put_colmap(scene.folder / "named", "in.png");
  fs::rename(scene.folder / "named/images", scene.folder / "elsewhere");
  fs::create_symlink(scene.folder / "elsewhere", scene.folder / "named/images");
  CHECK_THAT(message_of([&] { load_dataset(scene.folder / "named"); }), Contains("--allow-outside"));
  CHECK_NOTHROW(load_dataset(scene.folder / "named", {.read = {.images = "../elsewhere"}}));
  // An image folder that a file of a run names must be in the folder, also if it is a link.
  for (const char* name : {"../elsewhere", "images"})
    CHECK_THAT(message_of([&] {
                 load_dataset(scene.folder / "named", {.read = {.images = name}, .images_from_user = false});
               }),
               Contains("--allow-outside"));
}

TEST_CASE("outside: images, frames and poses of LLFF and N3V must be in the folder", "[outside]") {
  const Scene scene;
  const std::vector<float> row{0, 1, 0, 0, 12, -1, 0, 0, 0, 16, 0, 0, 1, 0, 20, 2, 9};
  std::vector<float> rows = row;
  rows.insert(rows.end(), row.begin(), row.end());
  write_npy(scene.data() / "poses_bounds.npy", std::vector<std::size_t>{2, 17}, rows);
  put_image(scene.data() / "images/a.png", 16, 12);
  fs::create_symlink(scene.folder / "secret/x.png", scene.data() / "images/b.png");
  scene.check_outside(scene.data(), "b.png");
  put_image(scene.folder / "named/a.png", 16, 12);
  put_image(scene.folder / "named/b.png", 16, 12);
  CHECK_NOTHROW(load_dataset(scene.data(), {.read = {.images = "../named"}}));
  CHECK_THAT(message_of([&] {
               load_dataset(scene.data(), {.read = {.images = "../named"}, .images_from_user = false});
             }),
             Contains("--allow-outside"));
  fs::remove_all(scene.data() / "images");
  put_image(scene.data() / "cam00/0.png", 16, 12);
  fs::create_symlink(scene.folder / "secret", scene.data() / "cam01");
  scene.check_outside(scene.data(), "cam01");
  fs::rename(scene.data() / "poses_bounds.npy", scene.folder / "secret/p.npy");
  fs::create_symlink(scene.folder / "secret/p.npy", scene.data() / "poses_bounds.npy");
  scene.check_outside(scene.data(), "poses_bounds.npy");
}

TEST_CASE("outside: a folder whose name starts with the name of the data folder is outside", "[outside]") {
  const TempFolder folder;
  put(folder / "data2/x", "x");
  put(folder / "data/y", "y");
  const DataRoot root(folder / "data", false);
  CHECK_NOTHROW(root.check(folder / "data/y"));
  CHECK_NOTHROW(root.check(folder / "data/../data/y"));
  CHECK_THAT(message_of([&] { root.check(folder / "data/../data2/x"); }), Contains("outside"));
  CHECK_NOTHROW(root.check(folder / "data2/none"));  // this file does not exist, so it cannot be read
  CHECK_NOTHROW(DataRoot(folder / "data", true).check(folder / "data2/x"));
}
