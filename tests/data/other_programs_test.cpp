// SPDX-License-Identifier: Apache-2.0
// Tests that files and folders of other programs are named, with the file and the way to convert it, and that
// the output folders of other trainers are opened.
#include "host/formats/other_programs.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/initialise.hpp"
#include "tests/support/images.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using test::put;
using test::put_image;
using test::TempFolder;

std::string refusal(const fs::path& path) {
  try {
    load_dataset(path);
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::data);
    return error.what();
  }
  FAIL("no error");
  return {};
}

// A folder of a program, with one file that has contents and others that are empty.
struct OfProgram {
  const char* program;
  std::vector<std::string> files;
  const char* contents;  // of the first file
};

const std::vector<OfProgram> kFolders{
    {"4DGaussians multipleview: several moments", {"poses_bounds_multipleview.npy", "cam01/0001.jpg"}, "x"},
    {"4DGaussians multipleview: several moments",
     {"sparse_/cameras.txt", "sparse_/images.txt", "cam01/frame_00001.jpg"},
     ""},
    {"one model for each moment: several moments",
     {"frame000001/sparse/0/cameras.txt", "frame000001/sparse/0/images.txt",
      "frame000002/sparse/0/images.txt"},
     ""},
    {"OpenMVG (sfm_data.json)", {"sfm_data.json"}, R"({"sfm_data_version": "0.3"})"},
    {"Meshroom (AliceVision) (cameras.sfm)", {"cameras.sfm"}, R"({"views": [], "poses": []})"},
    {"VisualSFM (scan.nvm)", {"scan.nvm"}, "NVM_V3 \n"},
    {"BlocksExchange", {"export.xml"}, "<?xml version=\"1.0\"?>\n<BlocksExchange version=\"2.1\">"},
    {"3DGS (cameras.json)", {"cameras.json"}, R"([{"id": 0, "img_name": "a", "rotation": []}])"},
    {"COLMAP (database.db)", {"database.db"}, "SQLite format 3"},
    {"kapture (sensors/sensors.txt)", {"sensors/sensors.txt"}, "#"},
    {"TUM RGB-D (groundtruth.txt)", {"groundtruth.txt", "rgb.txt"}, "#"},
    {"NSVF (intrinsics.txt)", {"intrinsics.txt", "pose/0000.txt"}, "1"},
    {"DTU (IDR, NeuS) (cameras_sphere.npz)", {"cameras_sphere.npz", "image/000.png"}, "PK"},
    {"MVSNet", {"cams/00000000_cam.txt", "pair.txt"}, "extrinsic"},
    {"Replica (traj.txt)", {"traj.txt", "results/frame000000.jpg"}, "1 0 0 0"},
    {"HyperNeRF, Nerfies", {"camera/0.json", "dataset.json"}, R"({"orientation": []})"},
    {"EasyVolcap (extri.yml)", {"extri.yml", "intri.yml"}, "%YAML:1.0"},
    {"PanopticSports", {"train_meta.json"}, R"({"w": 640, "w2c": []})"},
    {"Stray Scanner (odometry.csv)", {"odometry.csv", "camera_matrix.csv", "rgb.mp4"}, "timestamp"},
    {"gsplat (PNG compression) (meta.json)",
     {"meta.json", "means_l.png", "means_u.png", "quats.png"},
     R"({"means": {"mins": []}, "quats": {}})"},
    {"nerfstudio (config.yml)", {"config.yml", "nerfstudio_models/step-1.ckpt"}, "!!python"},
};

TEST_CASE("dataset: a folder with cameras or splats of another program names the program and the file",
          "[dataset]") {
  for (const OfProgram& of : kFolders) {
    INFO(of.program);
    const TempFolder folder;
    for (const std::string& file : of.files) put(folder / file, "");
    put(folder / of.files[0], of.contents);
    // The advice to find the cameras with COLMAP would be given for these images.
    put_image(folder / "images/a.png", 8, 6), put_image(folder / "images/b.png", 8, 6);
    const std::string message = refusal(folder.path());
    CHECK_THAT(message, Contains(of.program) && Contains(": "));
    CHECK_THAT(message, !Contains("no cameras: find") && !Contains("none of:"));
    CHECK(message.find('\n') == std::string::npos);
  }
}

TEST_CASE("dataset: signs of another program in another file are no signs", "[dataset]") {
  const TempFolder folder;
  put(folder / "export.xml", "<other/>");
  put(folder / "cameras.json", "{}");
  put(folder / "groundtruth.txt", "#");
  put_image(folder / "images/a.png", 8, 6), put_image(folder / "images/b.png", 8, 6);
  CHECK_THAT(refusal(folder.path()), Contains("2 images but no cameras"));
}

TEST_CASE("dataset: cameras of another program in UTF-16, in a subfolder, or alone are named", "[dataset]") {
  const TempFolder folder;
  std::string text = "\xff\xfe";
  for (const char c : std::string("<BlocksExchange>")) text += c, text += '\0';
  put(folder / "a/b/export.xml", text);
  CHECK_THAT(refusal(folder.path()), Contains("BlocksExchange"));
  CHECK_THAT(refusal(folder / "a/b/export.xml"), Contains("BlocksExchange"));
  put(folder / "c/my_cameras.json", R"([{"img_name": "a"}])");
  CHECK_THAT(refusal(folder / "c/my_cameras.json"), Contains("3DGS"));
}

TEST_CASE("dataset: cameras of another program in a folder matter more than a data set in the folder above",
          "[dataset]") {
  const TempFolder folder;
  put(folder / "transforms.json", "{}");
  put(folder / "scan/traj.txt", "1 0 0 0");
  CHECK_THAT(refusal(folder / "scan"), Contains("Replica (traj.txt)"));
}

TEST_CASE("formats: the last file in the output folder of another trainer is opened", "[formats]") {
  const TempFolder folder;
  const std::string ply = [&] {
    write_splat_ply(folder / "m.ply", initialise_random(3, 4, 1));
    return test::get(folder / "m.ply");
  }();
  const auto chosen = [&](const std::vector<std::string>& files) {
    const TempFolder output;
    for (const std::string& file : files) put(output / file, ply);
    const fs::path model = find_splat_model(output.path());
    return model.empty() ? std::string() : model.lexically_relative(output.path()).string();
  };
  CHECK(chosen({"ply/point_cloud_6999.ply", "ply/point_cloud_29999.ply"}) == "ply/point_cloud_29999.ply");
  CHECK(chosen({"splat_7000.ply", "splat_30000.ply"}) == "splat_30000.ply");
  CHECK(chosen({"export_30000.ply", "export_5000.ply"}) == "export_30000.ply");
  CHECK(chosen({"splat.ply"}) == "splat.ply");
  CHECK(
      chosen({"point_cloud/iteration_7000/point_cloud.ply", "point_cloud/iteration_30000/point_cloud.ply"}) ==
      "point_cloud/iteration_30000/point_cloud.ply");
  CHECK(chosen({"frame_00000.ply", "frame_00001.ply"}).empty());
  put(folder / "sequence/frame_0.ply", ply), put(folder / "sequence/frame_1.ply", ply);
  CHECK_THAT(refusal(folder / "sequence"), Contains("2 splat files (frame_0.ply to frame_1.ply)"));
}

TEST_CASE("formats: splat files of other programs are named", "[formats]") {
  const TempFolder folder;
  for (const auto& [file, program] :
       {std::pair{"a.lcc", "XGRIDS"}, {"a.rad", "Spark"}, {"a.spx", "Reall3D"}, {"a.hier", "Hierarchical"}}) {
    put(folder / file, "\1\2\3\4");
    CHECK_THAT(describe_file(folder / file), Contains(program));
  }
}

}  // namespace
}  // namespace ubs
