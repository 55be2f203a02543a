// SPDX-License-Identifier: Apache-2.0
// Tests that files are found if their names on the disk differ from those in the data
// (host/dataset/named_files.hpp), in every layout whose data contain file names. Also tests the notes of all
// readers of data folders about files that they do not use.
#include <filesystem>

#include "host/dataset/load_dataset.hpp"
#include "host/dataset/name_index.hpp"
#include "host/dataset/named_files.hpp"
#include "tests/support/data.hpp"
#include "tests/support/images.hpp"
#include "tests/support/llff.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
namespace fs = std::filesystem;

namespace {

const std::string kPoseOne = R"("transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]])";

std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) text += c == '\\' ? std::string("\\\\") : std::string(1, c);
  return text;
}

void put_json(const fs::path& file, const std::vector<std::string>& names, const std::string& head = "",
              const std::string& more = "") {
  std::string frames;
  for (const std::string& name : names)
    frames += fmt::format(R"({}{{"file_path": "{}", {}{}}})", frames.empty() ? "" : ",", escaped(name),
                          kPoseOne, more);
  put(file, fmt::format(R"({{"w": 16, "h": 12, "fl_x": 20, {} "frames": [{}]}})", head, frames));
}

void put_model(const fs::path& folder, const std::vector<std::string>& names) {
  put(folder / "cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    text += fmt::format("{} 1 0 0 0 {} 0 0 1 {}\n\n", i + 1, i, names[i]);
  put(folder / "images.txt", text);
}

// Writes a PLY file of points with a column and an element that no reader uses.
void put_points(const fs::path& file) {
  put(file,
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property int label\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
      "1 2 3 0 255 0 0 7\n4 5 6 0 0 255 0 8\n3 0 1 1\n");
}

// The result of opening a data folder. `notes` also contains the skipped images, and has one note per line.
struct Opened {
  std::size_t views = 0;
  std::string notes, error;
};

Opened opened(const fs::path& path, const DatasetOptions& options = {.read = {.test_every = 0}}) {
  Opened result;
  result.error = message_of([&] {
    const Dataset data = load_dataset(path, options);
    for (const Split& split : data.splits) result.views += split.views.size();
    for (const std::string& note : data.report.notes) result.notes += note + "\n";
    for (const auto& s : data.report.skipped)
      result.notes += fmt::format("{} skipped: {} ({})\n", s.count, s.why, fmt::join(s.examples, ", "));
  });
  return result;
}

// Creates and opens a data folder in each of the layouts that contain file names. `stated` are the names in
// the data, and `disk` are the names on the disk.
std::vector<Opened> in_all_layouts(const std::vector<std::string>& stated,
                                   const std::vector<std::string>& disk) {
  std::vector<Opened> results;
  for (const std::string layout : {"nerfstudio", "blender", "colmap"}) {
    const TempFolder folder;
    for (std::size_t i = 0; i < disk.size(); ++i) put_image(folder / disk[i], 16, 12, static_cast<int>(i));
    if (layout == "nerfstudio") put_json(folder / "transforms.json", stated);
    if (layout == "blender") put_json(folder / "transforms_train.json", stated);
    if (layout == "colmap") {
      std::vector<std::string> names;
      for (const std::string& name : stated)
        names.push_back(name.starts_with("images/") || name.starts_with("images\\") ? name.substr(7) : name);
      put_model(folder / "sparse/0", names);
    }
    results.push_back(opened(
        folder.path(), layout == "blender" ? DatasetOptions{} : DatasetOptions{.read = {.test_every = 0}}));
  }
  return results;
}

}  // namespace

TEST_CASE("names: differences in case, Unicode form of accents and separators are ignored", "[names]") {
  CHECK(folded_name("IMG_1.JPG") == "img_1.jpg");
  CHECK(folded_name("caf\u00e9.png") == folded_name("cafe\u0301.PNG"));
  CHECK(folded_name("\u1ec7") == folded_name("e\u0323\u0302"));                               // two accents
  CHECK(folded_name("\ud55c\uae00") == folded_name("\u1112\u1161\u11ab\u1100\u1173\u11af"));  // Korean
  CHECK(folded_name("\u0411\u0419") == folded_name("\u0431\u0438\u0306"));
  CHECK(folded_name("f\u00fcr") != folded_name("f\u00e4r"));
  CHECK(folded_name("a\xff\\b") == "a\xff/b");
  CHECK(path_components(R"(C:\data\.\x\..\im.png)") == std::vector<std::string>{"data", "im.png"});
}

TEST_CASE("names: files are found by the common part of the names, and counted in a note", "[names]") {
  struct Row {
    std::vector<std::string> stated, disk;
  };
  const std::vector<Row> rows{
      {{"images/a1.jpg", "images/a2.jpg"}, {"images/A1.JPG.png", "images/A1.png", "images/A2.PNG"}},
      {{"images/caf\u00e9.png"}, {"images/cafe\u0301.png"}},
      {{"images/a1.JPG", "images/a2.JPG"}, {"images/a1.png", "images/a2.png"}},
      {{"images/a1.png", "images/a2.png"}, {"images/scan/day1/a1.png", "images/scan/day1/a2.png"}},
      {{"images/cam0/a1.png", "images/cam0/a2.png"}, {"images/a1.png", "images/a2.png"}},
      {{"images/rgb/a1.png"}, {"Images/RGB/a1.png"}},
      {{R"(images\cam0\a1.png)"}, {"images/cam0/a1.png"}},
      {{"/home/u/scan/images/a1.png", "/home/u/scan/images/a2.png"}, {"images/a1.png", "images/a2.png"}},
      {{R"(C:\Users\u\scan\images\a1.png)"}, {"images/a1.png"}},
      {{"../../elsewhere/images/a1.png"}, {"images/a1.png"}},
      // The end of the path selects one of several files with the same name.
      {{"/home/u/cam0/a.png", "/home/u/cam1/a.png"}, {"images/cam0/a.png", "images/cam1/a.png"}},
      {{"/home/u/rgb/a1.png"}, {"images/a1.png", "masks/a1.png"}},
  };
  for (const Row& row : rows)
    for (const Opened& found : in_all_layouts(row.stated, row.disk)) {
      INFO(row.stated.front() << " as " << row.disk.front() << ": " << found.error << found.notes);
      CHECK(found.views == row.stated.size());
      CHECK_THAT(found.notes,
                 Contains(fmt::format("{} images found under slightly different names, such as '",
                                      row.stated.size())));
    }
  for (const Opened& exact : in_all_layouts({"images/a1.png"}, {"images/a1.png"}))
    CHECK(exact.notes.find("different names") == std::string::npos);
}

TEST_CASE("names: a name that matches no file or several files is not guessed", "[names]") {
  for (const Opened& none : in_all_layouts({"images/im1.png"}, {"images/im2.png"}))
    CHECK_THAT(none.error, Contains("none of the 1 images") && Contains("im1.png") &&
                               Contains("searched in") && Contains("nearest name there is 'images/im2.png'"));
  for (const Opened& both : in_all_layouts({"/x/a.png"}, {"images/l/a.png", "images/r/a.png"}))
    CHECK_THAT(both.error, Contains("2 files have this name"));
  // A file is not used for two names, and a deleted image is not replaced by an image of another folder.
  for (const Opened& shared : in_all_layouts({"/x/l/a.png", "/x/r/a.png"}, {"images/a.png"}))
    CHECK_THAT(shared.error, Contains("none of the 2 images"));
  const std::vector<Opened> deleted =
      in_all_layouts({"images/a.png", "images/b.png"}, {"images/a.png", "images_4/b.png", "masks/b.png"});
  for (const std::size_t layout : {0, 1, 2}) {
    CHECK(deleted[layout].views == 1);
    CHECK_THAT(deleted[layout].notes, Contains(layout == 2 ? "1 skipped: no such file in images"
                                                           : "1 skipped: the image does not exist"));
  }
  // Neither files outside of the data folder nor links to them are used.
  const TempFolder folder;
  put_image(folder / "secret/a.png", 16, 12);
  fs::create_directories(folder / "data");
  fs::create_directory_symlink(folder / "secret", folder / "data/images");
  put_json(folder / "data/transforms.json", {"/x/a.png"});
  CHECK_THAT(opened(folder / "data").error, Contains("none of the 1 images exists"));
  CHECK(opened(folder / "data", {.read = {.test_every = 0, .allow_outside = true}}).views == 1);
}

TEST_CASE("names: masks, points and lists of files are found in the same way as images", "[names]") {
  const TempFolder folder;
  for (const char* name : {"images/a.png", "images/b.png", "masks/a.png", "masks/b.png"})
    put_image(folder / name, 16, 12);
  put(folder / "sub/p.ply",
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\n1 2 3\n");
  put(folder / "transforms.json",
      fmt::format(R"({{"w": 16, "h": 12, "fl_x": 20, "ply_file_path": "C:\\d\\sub\\P.PLY",
        "train_filenames": ["images\\a.png", "images/none.png"], "test_filenames": ["/d/images/B.png"],
        "frames": [{{"file_path": "images\\a.png", "mask_path": "MASKS\\a.PNG", {0}}},
                   {{"file_path": "images\\b.png", "mask_path": "/d/masks/b.png", {0}}}]}})",
                  kPoseOne));
  const Dataset data = load_dataset(folder.path());
  REQUIRE(data.find("train"));
  REQUIRE(data.find("test"));
  CHECK(data.find("train")->views.at(0).name == "a");
  CHECK(data.find("test")->views.at(0).name == "b");
  CHECK(data.find("test")->views.at(0).masked);
  REQUIRE(data.points);
  const Opened said = opened(folder.path());
  CHECK_THAT(said.notes, Contains("2 masks found under slightly different names") &&
                             Contains("1 files of points found") && Contains("1 names of 'test_filenames'") &&
                             Contains("1 skipped: listed in 'train_filenames'"));
}

TEST_CASE("names: masks of COLMAP folders are found under several names", "[names]") {
  for (const std::string mask :
       {"masks/a.jpg", "Mask/A.png", "masks/a_mask.png", "masks/a.png.jpg", "masks/s/a.png"}) {
    const TempFolder folder;
    put_model(folder / "sparse/0", {"a.png", "b.png"});
    for (const char* name : {"images/a.png", "images/b.png"}) put_image(folder / name, 16, 12);
    put_image(folder / mask, 16, 12);
    put_image(folder / fs::path(mask).parent_path() / "other.png", 16, 12);
    INFO(mask);
    const Dataset data = load_dataset(folder.path(), {.read = {.test_every = 0}});
    CHECK(data.splits[0].views[0].masked);
    CHECK(!data.splits[0].views[1].masked);
    CHECK_THAT(opened(folder.path()).notes,
               Contains("1 masks in '") && Contains("belong to no image") && Contains("other.png"));
  }
}

TEST_CASE("names: each of 40 000 files is found", "[names]") {
  NameIndex index;
  for (int i = 0; i < 40'000; ++i) index.add(fmt::format("images/scan/IMG_{:05}.JPG", i));
  for (int i = 0; i < 40'000; ++i) {
    const auto match =
        index.find(fmt::format("C:\\d\\scan\\img_{:05}.png", i), [](std::size_t) { return true; });
    REQUIRE(match);
    REQUIRE(match->number == static_cast<std::size_t>(i));
  }
}

TEST_CASE("names: links to missing files are missing images", "[names]") {
  for (const bool one : {true, false}) {
    const TempFolder folder;
    put_model(folder / "sparse/0", {"a.png", "b.png"});
    fs::create_directories(folder / "images");
    for (const char* name : {"a.png", "b.png"})
      fs::create_symlink("/nowhere/x.png", folder / "images" / name);
    fs::create_symlink("loop", folder / "images/loop");
    if (one) fs::remove(folder / "images/a.png"), put_image(folder / "images/a.png", 16, 12);
    const Opened found = opened(folder.path());
    INFO(found.error << found.notes);
    CHECK(found.views == (one ? 1 : 0));
    if (one)
      CHECK_THAT(found.notes, Contains("1 skipped: no such file in images"));
    else
      CHECK_THAT(found.error, Contains("none of the 2 images of the model exists: for example, '") &&
                                  Contains("images/a.png' is a symbolic link to a file that does not exist"));
    const TempFolder blender;
    put_json(blender / "transforms_train.json", {"train/a"});
    fs::create_directories(blender / "train");
    fs::create_symlink("/nowhere/x.png", blender / "train/a.png");
    CHECK_THAT(opened(blender.path(), {}).error, Contains("none of the 1 images exists"));
  }
}

TEST_CASE("names: hidden files of macOS are not used as images", "[names]") {
  for (const Opened& found : in_all_layouts({"images/a1.png"}, {"images/a1.png", "images/._a1.png"})) {
    INFO(found.error << found.notes);
    CHECK(found.views == 1);
    CHECK(found.notes.find("belong to no camera") == std::string::npos);
  }
  for (const Opened& found :
       in_all_layouts({"images/a1.jpg", "images/a2.jpg"}, {"images/a1.png", "images/._a2.jpg"})) {
    INFO(found.error << found.notes);
    CHECK(found.views == 1);
    CHECK_THAT(found.notes + found.error, Contains("a2.jpg"));
  }
}

// Tests every reader of data folders with inputs that contain unused parts. The reader of packed files is not
// tested, because a packed file cannot contain unused parts.
TEST_CASE("notes: every reader reports the parts of the data that it does not use", "[names]") {
  struct Row {
    std::string what, words;
    void (*put_in)(const fs::path& folder);
  };
  const std::vector<Row> rows{
      {"an image without a camera (nerfstudio)", "1 images in 'images' belong to no camera",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_image(f / "images/b.png", 16, 12);
         put_json(f / "transforms.json", {"images/a.png"});
       }},
      {"an image without a camera (blender)", "1 images in 'train' belong to no camera",
       [](const fs::path& f) {
         put_image(f / "train/a.png", 16, 12), put_image(f / "train/b.png", 16, 12);
         put_json(f / "transforms_train.json", {"train/a"});
       }},
      {"an image without a camera (colmap)", "1 images in 'images' belong to no camera",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_image(f / "images/b.png", 16, 12);
         put_model(f / "sparse/0", {"a.png"});
       }},
      {"a missing image (nerfstudio)", "1 skipped: the image does not exist (images/b.png)",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12);
         put_json(f / "transforms.json", {"images/a.png", "images/b.png"});
       }},
      {"a missing image (blender)", "1 skipped: the image does not exist (test/b)",
       [](const fs::path& f) {
         put_image(f / "train/a.png", 16, 12), put_image(f / "test/a.png", 16, 12);
         put_json(f / "transforms_train.json", {"train/a"});
         put_json(f / "transforms_test.json", {"test/a", "test/b"});
       }},
      {"a split without images", "no test split: none of the 1 images of transforms_test.json exists",
       [](const fs::path& f) {
         put_image(f / "train/a.png", 16, 12);
         put_json(f / "transforms_train.json", {"train/a"});
         put_json(f / "transforms_test.json", {"test/a"});
       }},
      {"a mask that the JSON file does not list (nerfstudio)", "1 masks in 'masks' belong to no image",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_image(f / "masks/a.png", 16, 12);
         put_json(f / "transforms.json", {"images/a.png"});
       }},
      {"points that do not exist", "'ply_file_path': 'p.ply' does not exist",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12);
         put_json(f / "transforms.json", {"images/a.png"}, R"("ply_file_path": "p.ply",)");
       }},
      {"an unused column and unused faces (nerfstudio)",
       "p.ply: properties of element 'vertex' that are not used: label; element 'face' (1 rows) is not used",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_points(f / "p.ply");
         put_json(f / "transforms.json", {"images/a.png"}, R"("ply_file_path": "p.ply",)");
       }},
      {"an unused column (blender)", "points3d.ply: properties of element 'vertex' that are not used: label",
       [](const fs::path& f) {
         put_image(f / "train/a.png", 16, 12), put_points(f / "points3d.ply");
         put_json(f / "transforms_train.json", {"train/a"});
       }},
      {"an unused column (colmap)", "points3D.ply: properties of element 'vertex' that are not used: label",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_model(f / "sparse/0", {"a.png"});
         put_points(f / "sparse/0/points3D.ply");
       }},
      {"an unused column (llff)", "points3d.ply: properties of element 'vertex' that are not used: label",
       [](const fs::path& f) {
         put_rows(f, 1), put_image(f / "images/a.png", 128, 96), put_points(f / "points3d.ply");
       }},
      {"another model", "2 COLMAP models: sparse/0 (1 images), sparse/1 (2 images); using sparse/1",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_image(f / "images/b.png", 16, 12);
         put_model(f / "sparse/0", {"a.png"});
         put_model(f / "sparse/1", {"a.png", "b.png"});
       }},
      {"a pose that is not finite", "1 skipped: its pose or camera in the model is not finite (b.png)",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12);
         put_model(f / "sparse/0", {"a.png"});
         put(f / "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n2 -nan(ind) 0 0 0 nan 0 0 1 b.png\n\n");
       }},
      {"a fisheye image of more than 180 degrees", "1 wide images were split into 6 pinhole views",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 160, 120);
         put_model(f / "sparse/0", {"a.png"});
         put(f / "sparse/0/cameras.txt", "1 OPENCV_FISHEYE 160 120 40 40 80 60 0 0 0 0\n");
       }},
      {"the rim of a fisheye image", "% of the image is lost",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12);
         put_model(f / "sparse/0", {"a.png"});
         put(f / "sparse/0/cameras.txt", "1 OPENCV_FISHEYE 16 12 5 5 8 6 0 0 0 0\n");
       }},
      {"a video next to the images (llff)", "1 videos are not used, because poses_bounds.npy has 2 rows",
       [](const fs::path& f) {
         put_rows(f, 2), put(f / "walk.mp4", "");
         put_image(f / "images/a.png", 128, 96), put_image(f / "images/b.png", 128, 96);
       }},
      {"a folder that is no camera (llff)",
       "1 folders of images whose names start with 'cam' are not used, because poses_bounds.npy has 2 rows",
       [](const fs::path& f) {
         put_rows(f, 2), put_image(f / "camera_path/preview.png", 16, 12);
         put_image(f / "images/a.png", 128, 96), put_image(f / "images/b.png", 128, 96);
       }},
      {"a mask without an image (llff)", "1 masks in 'masks' belong to no image (the first: 'masks/b.png')",
       [](const fs::path& f) {
         put_rows(f, 1), put_image(f / "images/a.png", 128, 96);
         put_image(f / "masks/a.png", 128, 96), put_image(f / "masks/b.png", 128, 96);
       }},
      {"a frame that only one camera has (n3v)",
       "cam00 has 1 frames, but cam01 has 2: frames from 1 on are not used",
       [](const fs::path& f) {
         put_rows(f, 2);
         for (const char* name : {"cam00/0.png", "cam01/0.png", "cam01/1.png"}) put_image(f / name, 128, 96);
       }},
      {"cameras of another layout",
       "the folder also has poses_bounds.npy (LLFF, N3V): not used (to use it instead: --layout llff",
       [](const fs::path& f) {
         put_image(f / "images/a.png", 16, 12), put_rows(f, 1);
         put_json(f / "transforms.json", {"images/a.png"});
       }},
  };
  for (const Row& row : rows) {
    const TempFolder folder;
    row.put_in(folder.path());
    const bool has_splits = fs::exists(folder / "transforms_train.json") || fs::exists(folder / "cam00");
    const Opened said =
        opened(folder.path(), has_splits ? DatasetOptions{} : DatasetOptions{.read = {.test_every = 0}});
    INFO(row.what << ": " << said.error << "\n" << said.notes);
    CHECK_THAT(said.notes, Contains(row.words));
  }
}
