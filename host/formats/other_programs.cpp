// SPDX-License-Identifier: Apache-2.0
// See other_programs.hpp.
#include "host/formats/other_programs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <fstream>

#include "host/base/paths.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Content = OtherProgram::Content;

constexpr std::size_t kStart = std::size_t{64} << 10;

// The poses of these files are easily written as transforms.json, by a program of the user.
constexpr std::string_view kToWorldForward =
    "write its poses to a transforms.json (docs/data.md): they are camera-to-world with z forward, so negate "
    "the second and third columns of each rotation to get 'transform_matrix'";
constexpr std::string_view kToCamera =
    "write its poses to a transforms.json (docs/data.md): they are world-to-camera with z forward, so invert "
    "them, then negate the second and third columns of each rotation to get 'transform_matrix'";
constexpr std::string_view kExportOther =
    "open it in the program that wrote it, and export the cameras as Metashape XML, Bundler or COLMAP";

// The first row that matches is used, so a row with more signs comes before one with fewer.
constexpr OtherProgram kPrograms[] = {
    // Cameras
    {Content::moments, "4DGaussians multipleview", "poses_bounds_multipleview.npy", "",
     "each folder belongs to one camera: rename {0} to poses_bounds.npy, then ubs "
     "reads {1} with '--layout llff'"},
    {Content::moments, "4DGaussians multipleview", "sparse_ cam*1/*1.*", "",
     "each folder belongs to one camera: create poses_bounds_multipleview.npy with "
     "multipleviewprogress.sh of 4DGaussians and rename it to poses_bounds.npy, then ubs reads {1} with "
     "'--layout llff'"},
    {Content::moments, "COLMAP, one model for each moment", "frame*1/sparse frame*2/sparse", "",
     "write one transforms.json for all of them, with a 'time' in each frame "
     "(docs/data.md), or pass one of the folders to train on one moment"},
    {Content::moments, "COLMAP, one model for each moment", "colmap_*1/sparse colmap_*2/sparse", "",
     "write one transforms.json for all of them, with a 'time' in each frame "
     "(docs/data.md), or pass one of the folders to train on one moment"},
    {Content::moments, "COLMAP, one model for each moment", "*1/sparse/0/cameras.* *2/sparse/0/cameras.*", "",
     "write one transforms.json for all of "
     "them, with a 'time' in each frame (docs/data.md); to train on one of them, pass its folder"},
    {Content::cameras, "OpenMVG", "sfm_data*.json", "\"sfm_data_version\"",
     "convert it: 'openMVG_main_openMVG2Colmap -i {0} -o sparse/0'"},
    {Content::cameras, "OpenMVG", "sfm_data*.bin", "",
     "convert it: 'openMVG_main_openMVG2Colmap -i {0} -o sparse/0'"},
    {Content::cameras, "Meshroom (AliceVision)", "*.sfm", "\"poses\"",
     "convert it: 'aliceVision_exportColmap -i {0} -o sparse'"},
    {Content::cameras, "Meshroom (AliceVision)", "*.abc", "",
     "convert it: 'aliceVision_exportColmap -i {0} -o sparse'"},
    {Content::cameras, "Meshroom (AliceVision)", "MeshroomCache/StructureFromMotion/*/cameras.sfm", "",
     "convert it: 'aliceVision_exportColmap -i {0} -o sparse'"},
    {Content::cameras, "Meshroom (AliceVision)", "*.mg", "\"pipelineVersion\"",
     "it only lists the steps: add the node ExportColmap after StructureFromMotion, or run "
     "'aliceVision_exportColmap -i MeshroomCache/StructureFromMotion/*/cameras.sfm -o sparse'"},
    {Content::cameras, "VisualSFM", "*.nvm", "NVM_V3",
     "open it in VisualSFM and save the model as bundle.out, which ubs reads with its list.txt"},
    {Content::cameras, "BlocksExchange (ContextCapture, iTwin Capture, DJI Terra)", "*.xml",
     "<BlocksExchange",
     "import it into Metashape or RealityScan, and export the cameras from there as XML or CSV"},
    {Content::cameras, "RealityScan", "*.csv", "#name,x,y",
     "this table has no focal lengths: export 'Internal/External camera parameters' instead"},
    {Content::cameras, "3DGS", "*cameras*.json", "\"img_name\"",
     "these are the cameras of a finished training, without lenses and image folders: pass the data folder "
     "that it was trained on (cfg_args names it); 'ubs render --path {0}' renders along these cameras"},
    {Content::cameras, "COLMAP", "*.db", "SQLite format 3",
     "this database has features and matches, but no cameras: run 'colmap mapper --database_path {0} "
     "--image_path images --output_path sparse', or 'ubs cameras {1}'"},
    {Content::cameras, "kapture", "sensors/sensors.txt", "",
     "convert it: 'kapture_export_colmap.py -i {1} -db colmap.db -txt sparse/0'"},
    {Content::cameras, "TUM RGB-D", "groundtruth.txt rgb*", "",
     "write its poses (position and quaternion x y z w, camera-to-world) to a transforms.json "
     "(docs/data.md), with the intrinsics of the sensor that the dataset's page lists"},
    {Content::cameras, "Stray Scanner", "odometry.csv camera_matrix.csv", "", kToWorldForward},
    {Content::cameras, "Stray Scanner", "odometry.csv rgb*", "", kToWorldForward},
    {Content::cameras, "NSVF", "intrinsics.txt pose/*.txt", "", kToWorldForward},
    {Content::cameras, "NSVF", "intrinsics.txt bbox.txt", "", kToWorldForward},
    {Content::cameras, "ScanNet", "pose/0.txt intrinsic*", "", kToWorldForward},
    {Content::cameras, "DTU (IDR, NeuS)", "cameras_sphere.npz", "",
     "decompose its projection matrices 'world_mat_*' and write them to a transforms.json (docs/data.md); "
     "SDFStudio's 'process_data' does this"},
    {Content::cameras, "DTU (IDR, NeuS)", "cameras.npz image*", "",
     "decompose its projection matrices 'world_mat_*' and write them to a transforms.json (docs/data.md); "
     "SDFStudio's 'process_data' does this"},
    {Content::cameras, "MVSNet", "cams*/*_cam.txt", "", kToCamera},
    {Content::cameras, "MVSNet", "Cameras/*_cam.txt", "", kToCamera},
    {Content::cameras, "Replica", "traj.txt", "", kToWorldForward},
    {Content::cameras, "Replica", "*/traj.txt", "", kToWorldForward},
    {Content::cameras, "HyperNeRF, Nerfies", "camera/*.json dataset.json", "",
     "write the poses of camera/*.json to a transforms.json (docs/data.md): 'orientation' is the "
     "world-to-camera rotation with z forward, 'position' is the position of the camera, and metadata.json "
     "has the time"},
    {Content::cameras, "HyperNeRF, Nerfies", "camera/*.json", "\"orientation\"",
     "write the poses of camera/*.json to a transforms.json (docs/data.md): 'orientation' is the "
     "world-to-camera rotation with z forward, 'position' is the position of the camera"},
    {Content::cameras, "EasyVolcap", "extri.yml intri.yml", "", kToCamera},
    {Content::cameras, "PanopticSports (Dynamic 3D Gaussians)", "train_meta.json", "\"w2c\"",
     "write its poses 'w2c' to a transforms.json (docs/data.md): they are world-to-camera with z forward, so "
     "invert them, then negate the second and third columns of each rotation; the index of the list is the "
     "'time'"},
    {Content::cameras, "PanopticSports (Dynamic 3D Gaussians)", "train_meta.json", "", kToCamera},
    {Content::cameras, "VGGT", "predictions.npz", "",
     "run demo_colmap.py of VGGT, which writes a COLMAP model"},
    {Content::cameras, "Pix4D", "*_calibrated_camera_parameters.txt", "",
     "export the project as COLMAP or Bundler (undistorted images), or open the images in another program"},
    {Content::cameras, "ARKitScenes", "lowres_wide.traj", "", kToCamera},
    {Content::cameras, "Metashape project", "*.psx", "",
     "open it in Metashape and export the cameras: File > Export > Export Cameras, Agisoft XML"},
    {Content::cameras, "RealityCapture project", "*.rcproj", "",
     "open it in RealityScan and export 'Internal/External camera parameters' (CSV)"},
    {Content::cameras, "RealityScan project", "*.rsproj", "",
     "open it in RealityScan and export 'Internal/External camera parameters' (CSV)"},
    {Content::cameras, "Record3D recording", "*.r3d", "",
     "it is a ZIP archive: unpack it ('unzip {0} -d scan') and pass the folder"},
    // Splats
    {Content::splats, "gsplat (PNG compression)", "meta.json means_l.png means_u.png quats.png", "\"mins\"",
     "decompress it with PngCompression.decompress of gsplat and export the splats as PLY "
     "(gsplat.export_splats)"},
    {Content::splats, "gsplat", "ckpts/ckpt_*.pt", "",
     "these are PyTorch checkpoints: train with '--save_ply', or export the splats as PLY "
     "(gsplat.export_splats)"},
    {Content::splats, "nerfstudio", "config.yml nerfstudio_models/*.ckpt", "",
     "export the splats: 'ns-export gaussian-splat --load-config {0} --output-dir splats', then pass "
     "splats/splat.ply"},
    {Content::splats, "XGRIDS Lixel CyberColor", "*.lcc", "",
     "export the splats as PLY or SPZ with LCC Studio, or convert them with 'splat-transform {0} out.ply'"},
    {Content::splats, "Spark", "*.rad", "",
     "it contains levels of detail for streaming: pass the PLY or SPZ file that it was made from"},
    {Content::splats, "Reall3D", "*.spx", "", "convert it: 'gsbox x2p -i {0} -o out.ply'"},
    {Content::splats, "Hierarchical 3D Gaussians", "*.hier", "",
     "it contains a hierarchy of splats: pass the point_cloud.ply of its chunks or scaffold"},
    {Content::splats, "GaussianSplats3D", "*.ksplat", "", "export the splats as PLY, SPZ or .splat"},
    // Output folders whose files ubs reads
    {Content::models, "3DGS", "point_cloud/iteration_*/point_cloud.ply", "", ""},
    {Content::models, "gsplat", "ply/point_cloud_*.ply", "", ""},
    {Content::models, "LichtFeld Studio", "splat_*.ply", "", ""},
    {Content::models, "LichtFeld Studio", "checkpoints/splat_*.ply", "", ""},
    {Content::models, "OpenSplat, nerfstudio", "splat.ply", "", ""},
    {Content::models, "OpenSplat", "splat_*.splat", "", ""},
    {Content::models, "Brush", "export_*.ply", "", ""},
};

// Returns whether the pattern, which may contain several '*', matches the whole name.
bool matches(std::string_view name, std::string_view pattern) {
  const std::size_t star = pattern.find('*');
  if (star == std::string_view::npos) return name == pattern;
  if (!name.starts_with(pattern.substr(0, star))) return false;
  name.remove_prefix(star);
  pattern.remove_prefix(star + 1);
  for (std::size_t skipped = 0; skipped <= name.size(); ++skipped)
    if (matches(name.substr(skipped), pattern)) return true;
  return false;
}

// Replaces {0} and {1} in the advice of a row.
std::string advice(const OtherProgram& row, const fs::path& file, const fs::path& folder) {
  return fmt::format(fmt::runtime(row.advice), shell_word(file.string()), shell_word(folder.string()));
}

std::string sentence(const OtherProgram& row, const fs::path& file, const fs::path& folder) {
  const std::string name = file.lexically_relative(folder).string();
  return row.content == Content::moments
             ? fmt::format("{}: several moments ({}): {}", row.program, name, advice(row, file, folder))
             : fmt::format("{} ({}), which ubs does not read: {}", row.program, name,
                           advice(row, file, folder));
}

std::vector<std::string_view> patterns_of(const OtherProgram& row) {
  std::vector<std::string_view> patterns;
  for (std::string_view rest = row.files; !rest.empty();) {
    const std::size_t end = std::min(rest.find(' '), rest.size());
    patterns.push_back(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return patterns;
}

bool has_key(const OtherProgram& row, const fs::path& file) {
  return row.key.empty() || start_of_file(file).find(row.key) != std::string::npos;
}

// Returns the first file that belongs to the row, or an empty path.
fs::path file_in_folder(const OtherProgram& row, const fs::path& folder) {
  const std::vector<std::string_view> patterns = patterns_of(row);
  const std::vector<fs::path> found = matching_paths(folder, patterns[0]);
  if (found.empty()) return {};
  for (std::size_t i = 1; i < patterns.size(); ++i)
    if (matching_paths(folder, patterns[i]).empty()) return {};
  const auto file = std::ranges::find_if(found, [&](const fs::path& f) { return has_key(row, f); });
  return file == found.end() ? fs::path() : *file;
}

}  // namespace

std::span<const OtherProgram> other_programs() { return kPrograms; }

std::vector<fs::path> matching_paths(const fs::path& folder, std::string_view pattern) {
  std::vector<fs::path> found{folder};
  while (!pattern.empty()) {
    const std::size_t end = std::min(pattern.find('/'), pattern.size());
    const std::string_view part = pattern.substr(0, end);
    std::vector<fs::path> next;
    for (const fs::path& path : found) {
      if (part.find('*') == std::string_view::npos) {
        if (path_exists(path / part)) next.push_back(path / part);
        continue;
      }
      if (!is_folder(path)) continue;
      try {
        for (const fs::path& entry : folder_entries(path))
          if (const std::string name = entry.filename().string();
              !name.starts_with('.') && matches(name, part))
            next.push_back(entry);
      } catch (const std::exception&) {  // a folder that cannot be read matches nothing
      }
    }
    found = std::move(next);
    pattern.remove_prefix(std::min(end + 1, pattern.size()));
  }
  // A number with more digits is larger, because the names differ only in their numbers.
  std::ranges::stable_sort(found, [](const fs::path& a, const fs::path& b) {
    const std::string &left = a.native(), &right = b.native();
    return left.size() != right.size() ? left.size() < right.size() : left < right;
  });
  return found;
}

std::string start_of_file(const fs::path& path) {
  if (!is_regular(path)) return {};
  std::ifstream stream(path, std::ios::binary);
  std::string text(kStart, '\0');
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff")) std::erase(text.erase(0, 2), '\0');
  return text;
}

std::string describe_other_program(const fs::path& path, Content content) {
  for (const OtherProgram& row : kPrograms) {
    if (row.content != content) continue;
    if (is_folder(path)) {
      if (const fs::path file = file_in_folder(row, path); !file.empty()) return sentence(row, file, path);
      continue;
    }
    const std::vector<std::string_view> patterns = patterns_of(row);
    const std::string_view name = patterns[0].substr(patterns[0].rfind('/') + 1);
    if (!matches(path.filename().string(), name)) continue;
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    if (patterns.size() == 1 ? has_key(row, path) : file_in_folder(row, folder).filename() == path.filename())
      return sentence(row, path, folder);
  }
  return {};
}

TrainerOutput trainer_output(const fs::path& folder) {
  for (const OtherProgram& row : kPrograms)
    if (row.content == Content::models)
      if (std::vector<fs::path> found = matching_paths(folder, row.files); !found.empty())
        return {row.program, std::move(found)};
  return {};
}

}  // namespace ubs
