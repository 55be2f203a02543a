// SPDX-License-Identifier: Apache-2.0
// ubs cameras: runs COLMAP on the CPU to find the cameras of a folder of photographs. Intermediate results
// stay in the folder `colmap` next to the photographs, so that the same command continues after an
// interruption.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <optional>
#include <regex>

#include "host/base/child_process.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/folder_lock.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/dataset/colmap.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/load_dataset.hpp"
#include "tools/commands.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/output.hpp"
#include "tools/common/progress.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct CamerasOptions {
  std::string photos, order = "auto", colmap, lens = "SIMPLE_RADIAL";
  bool dry_run = false, quiet = false;
};

constexpr std::size_t kAllPairs = 150;  // maximum number of images for matching all pairs by default
constexpr std::size_t kFewest = 3;      // minimum number of images

// The paths that this command uses. The images are in the given folder or in its subfolder `images`; ubs
// writes to the subfolder `colmap`.
struct Places {
  fs::path data, images, work, list, database, mapping, model;
  std::vector<fs::path> pictures;
};

Places places_of(const std::string& given) {
  if (!is_folder(given)) {
    const std::string hint = how_to_make_images(given);
    fail(ErrorKind::data, "{}: {}", given, hint.empty() ? "no such folder" : hint);
  }
  Places p;
  const fs::path folder = fs::absolute(given).lexically_normal();
  p.data = folder.has_filename() ? folder : folder.parent_path();
  p.images = p.data;
  p.pictures = pictures_in(p.images);
  if (p.pictures.empty()) {
    p.images = p.data / "images";
    p.pictures = pictures_in(p.images);
  } else if (p.data.filename() == "images") {
    p.data = p.data.parent_path();
  }
  if (const std::string there = camera_files_in(p.data); !there.empty())
    fail(ErrorKind::usage,
         "{}: cameras are already there ({}): train with 'ubs train {}', or move them elsewhere to estimate "
         "new ones",
         given, there, shell_word(p.data.string()));
  if (const std::string hint = how_to_make_images(p.data); p.pictures.size() < kFewest && !hint.empty())
    fail(ErrorKind::data, "{}: {}, then run 'ubs cameras {}' again", given, hint, shell_word(given));
  if (p.pictures.size() < kFewest)
    fail(ErrorKind::data,
         "{}: found {} images here and in its subfolder 'images', but COLMAP needs at least {}, taken from "
         "different positions",
         given, p.pictures.size(), kFewest);
  p.work = p.data / "colmap";
  p.list = p.work / "images.txt";
  p.database = p.work / "database.db";
  p.mapping = p.work / "mapping";
  p.model = p.work / "sparse" / "0";
  return p;
}

struct Step {
  // `progress` is a pattern that finds the number of completed items and the number of all items in the log.
  // If it is empty, the progress is the number of images for which COLMAP has found a camera.
  std::string name, progress;
  std::vector<std::string> arguments;
};

bool one_size(const Places& places) {
  const ImageSize first = image_file_info(places.pictures.front()).size;
  return std::ranges::all_of(places.pictures, [&](const fs::path& file) {
    const ImageSize size = image_file_info(file).size;
    return size.width == first.width && size.height == first.height;
  });
}

// ColmapNames contains the names of those options of COLMAP that differ between its versions. The defaults
// are the names before version 3.13, which renamed the GPU options.
struct ColmapNames {
  std::string gpu_of_features = "--SiftExtraction.use_gpu", gpu_of_matches = "--SiftMatching.use_gpu",
              image_size = "--SiftExtraction.max_image_size";
};

ColmapNames names_in(const std::string& help) {
  ColmapNames names;
  if (help.find("--FeatureExtraction.use_gpu") != std::string::npos)
    names = {"--FeatureExtraction.use_gpu", "--FeatureMatching.use_gpu", names.image_size};
  if (help.find("--FeatureExtraction.max_image_size") != std::string::npos)
    names.image_size = "--FeatureExtraction.max_image_size";
  return names;
}

std::vector<Step> steps_of(const CamerasOptions& options, const Places& places, const ColmapNames& names) {
  const bool sequence =
      options.order == "sequence" || (options.order == "auto" && places.pictures.size() > kAllPairs);
  const std::string database = places.database.string(), images = places.images.string();
  Step features{
      "features",
      R"(\[(\d+)/(\d+)\])",
      {"feature_extractor", "--database_path", database, "--image_path", images, "--image_list_path",
       places.list.string(), "--ImageReader.camera_model", options.lens, names.gpu_of_features, "0",
       // The time for matching grows with the square of the number of features. With these two
       // values, 50 photographs of 1080x1920 took 165 s on two cores. With twice as many features, they
       // took 294 s. In both cases COLMAP found a camera for each photograph, and training gave about
       // the same PSNR: 31.8 dB with these values, 31.6 dB with twice as many features. COLMAP's
       // defaults are 8192 features and 3200 pixels.
       "--SiftExtraction.max_num_features", "2048", names.image_size, "1600"}};
  // If all images have the same size, probably one camera took them. A lens that they share is estimated more
  // accurately.
  if (one_size(places))
    features.arguments.insert(features.arguments.end(), {"--ImageReader.single_camera", "1"});
  Step matches{"matches",
               R"(\[(\d+)/(\d+)(?:, (\d+)/\d+)?\] in)",  // printed when a block of pairs is done
               {sequence ? "sequential_matcher" : "exhaustive_matcher", "--database_path", database,
                names.gpu_of_matches, "0"}};
  if (!sequence)  // COLMAP prints progress per block, and a block of 50 images, its default, takes minutes
    matches.arguments.insert(matches.arguments.end(), {"--ExhaustiveMatching.block_size", "10"});
  const Step mapper{"cameras",
                    "",
                    {"mapper", "--database_path", database, "--image_path", images, "--output_path",
                     places.mapping.string()}};
  return {features, matches, mapper};
}

std::string tail_of(const fs::path& log, std::size_t most) {
  const std::string text = path_exists(log) ? read_text_file(log) : "";
  return text.size() > most ? text.substr(text.size() - most) : text;
}

// Shows the latest progress that the log contains: the number of images with a camera or, for steps with a
// pattern, the completed share in percent.
void show(const Step& step, const fs::path& log, CountProgress& progress) {
  if (step.progress.empty()) {
    const std::string text = tail_of(log, std::size_t{16} << 20);
    std::size_t count = 0;
    for (std::size_t at = text.find("Registering image"); at != std::string::npos;
         at = text.find("Registering image", at + 1))
      ++count;
    return progress.update(count);
  }
  const std::string text = tail_of(log, 4096);
  const std::regex pattern(step.progress);
  std::size_t done = 0, all = 0;
  for (std::sregex_iterator it(text.begin(), text.end(), pattern), end; it != end; ++it) {
    done = std::stoul((*it)[1]);
    all = std::stoul((*it)[2]);
    if ((*it)[3].matched) done = (done - 1) * all + std::stoul((*it)[3]), all *= all;
  }
  if (all > 0) progress.update(100 * done / all);
}

std::string last_line(const fs::path& log) {
  std::string text = tail_of(log, 2048);
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
  return text.substr(text.rfind('\n') + 1);
}

void run_step(const Step& step, const fs::path& colmap, const Places& places, bool quiet,
              const InterruptGuard& guard) {
  const fs::path log = places.work / (step.name + ".log");
  std::vector<std::string> arguments{colmap.string()};
  arguments.insert(arguments.end(), step.arguments.begin(), step.arguments.end());
  CountProgress progress(step.progress.empty() ? places.pictures.size() : 100,
                         step.progress.empty() ? step.name : "% of " + step.name, quiet);
  Stopwatch watch;
  const ChildResult result = run_child(arguments, log, [&] {
    if (guard.interrupted()) return true;  // kills COLMAP, which has no other way to stop
    if (watch.seconds() > 1) {
      watch.restart();
      show(step, log, progress);
    }
    return false;
  });
  progress.finish();
  if (guard.interrupted()) return;
  if (result.code != 0 || result.signal != 0)
    fail(ErrorKind::data, "COLMAP's {} ended with {} {}: {} (complete log: {})", step.arguments.front(),
         result.signal ? "signal" : "code", result.signal ? result.signal : result.code, last_line(log),
         log.string());
}

std::string pictures_text(const CamerasOptions& options, const Places& places) {
  std::string text = options.lens + "\n";
  for (const fs::path& file : places.pictures)
    text += fmt::format("{} {}\n", file.filename().string(), fs::file_size(file));
  return text;
}

// Returns the files of earlier runs with other images or another lens model. They must be deleted, because
// COLMAP would also use the images that an old database contains.
std::vector<fs::path> stale_files(const CamerasOptions& options, const Places& places) {
  const fs::path print = places.work / "pictures.txt";
  if (!path_exists(print) || read_text_file(print) == pictures_text(options, places)) return {};
  return {places.database, places.work / "database.db-shm", places.work / "database.db-wal"};
}

void prepare_work(const CamerasOptions& options, const Places& places, const std::vector<fs::path>& stale) {
  make_folders(places.work);
  const fs::path print = places.work / "pictures.txt";
  for (const fs::path& file : {places.database, places.list})
    if (!path_exists(print) && path_exists(file))
      fail(ErrorKind::usage,
           "{}: ubs did not create this file and does not overwrite it: move the folder {} elsewhere",
           file.string(), places.work.string());
  for (const fs::path& file : stale) fs::remove(file);
  write_file_atomically(print, pictures_text(options, places));
  std::string names;
  for (const fs::path& file : places.pictures) names += file.filename().string() + "\n";
  write_file_atomically(places.list, names);
}

// Copies the COLMAP model with the most cameras to the data folder. This is the last step.
ColmapModel keep_best(const Places& places) {
  ColmapModel best;
  fs::path from;
  if (is_folder(places.mapping))
    for (const fs::path& folder : folder_entries(places.mapping))
      if (path_exists(folder / "images.bin")) {
        ColmapModel model = read_colmap_model(folder);
        if (model.images.size() > best.images.size()) best = std::move(model), from = folder;
      }
  if (from.empty())
    fail(ErrorKind::data,
         "COLMAP found no cameras: the images must be sharp, overlap, and be taken from different positions "
         "(logs: {})",
         places.work.string());
  make_folders(places.model);
  for (const char* name : {"points3D.bin", "images.bin", "cameras.bin"})
    write_file_atomically(places.model / name, read_file(from / name));
  return best;
}

void print_lines(const fs::path& colmap, const std::vector<Step>& steps, const Places& places,
                 const std::vector<fs::path>& stale) {
  for (const fs::path& file : stale) say("rm -f {}\n", shell_word(file.string()));
  say("mkdir -p {}\nprintf '%s\\n'", shell_word(places.mapping.string()));
  for (const fs::path& file : places.pictures) say(" {}", shell_word(file.filename().string()));
  say(" >{}\n", shell_word(places.list.string()));
  for (const Step& step : steps) {
    std::string line = shell_word(colmap.empty() ? "colmap" : colmap.string());
    for (const std::string& argument : step.arguments) line.append(" ").append(shell_word(argument));
    say("{}\n", line);
  }
}

int run(const CamerasOptions& options) {
  files_before_output();
  const Places places = places_of(options.photos);
  const fs::path colmap = find_program(options.colmap.empty() ? "colmap" : options.colmap);
  if (colmap.empty() && !options.dry_run)
    fail(ErrorKind::data,
         "COLMAP is not installed{}: install it (Debian, Ubuntu: sudo apt-get install colmap; conda: conda "
         "install -c conda-forge colmap), then run 'ubs cameras {}' again",
         options.colmap.empty() ? "" : " at " + options.colmap, shell_word(options.photos));
  // Without this variable, COLMAP does not start on a machine without a display.
  setenv("QT_QPA_PLATFORM", "offscreen", 0);
  ColmapNames names;
  std::optional<FolderLock> lock;  // a dry run writes nothing to the photographs' folder
  if (!options.dry_run) lock.emplace(places.work);
  if (!colmap.empty()) {
    const TemporaryFolder temporary;
    const fs::path help = temporary.path() / "help.log";
    run_child({colmap.string(), "feature_extractor", "-h"}, help, [] { return false; });
    names = names_in(read_text_file(help));
  }
  const std::vector<fs::path> stale = stale_files(options, places);
  const std::vector<Step> steps = steps_of(options, places, names);
  if (options.dry_run) {
    print_lines(colmap, steps, places, stale);
    return 0;
  }
  prepare_work(options, places, stale);
  if (!options.quiet)
    say("photos   {} in {}\ncolmap   {}, on the CPU; logs in {}\n", places.pictures.size(),
        places.images.string(), steps[1].arguments[0], places.work.string());
  flush_out();
  const InterruptGuard guard;
  for (const Step& step : steps) {
    if (step.name == "cameras") {
      fs::remove_all(places.mapping);
      make_folders(places.mapping);
    }
    run_step(step, colmap, places, options.quiet, guard);
    if (guard.interrupted()) {
      warn("interrupted: run the same command again to continue");
      return kInterruptedExitCode;
    }
  }
  lock->check_place();
  const ColmapModel model = keep_best(places);
  fs::remove_all(places.mapping);
  if (model.images.size() < places.pictures.size())
    warn("{} of {} images have a camera; the others are not used", model.images.size(),
         places.pictures.size());
  if (!options.quiet)
    say("cameras  {} of {} images, {} points, in {}\nnext     ubs train {}\n", model.images.size(),
        places.pictures.size(), model.points.positions.size(), places.model.string(),
        shell_word(places.data.lexically_proximate(fs::current_path()).string()));
  return 0;
}

}  // namespace

Command add_cameras(CLI::App& root) {
  CLI::App* app = root.add_subcommand("cameras", "Estimate the cameras of images with COLMAP");
  const auto options = std::make_shared<CamerasOptions>();
  app->add_option("photos", options->photos, "folder of images, or a folder with a subfolder 'images'")
      ->required()
      ->type_name("DIR");
  app->add_option("--order", options->order,
                  "which images are matched: all pairs, or neighbours in file name order (for video frames) "
                  "[all pairs for up to 150 images]")
      ->check(CLI::IsMember({"auto", "all", "sequence"}))
      ->type_name("all|sequence");
  app->add_option("--lens", options->lens,
                  "COLMAP's camera model, such as OPENCV for wide lenses [SIMPLE_RADIAL]")
      ->type_name("MODEL");
  app->add_option("--colmap", options->colmap, "path of the COLMAP program [colmap in PATH]")
      ->type_name("FILE");
  app->add_flag("--dry-run", options->dry_run, "print the commands without running them");
  app->add_flag("--quiet", options->quiet, "print errors and warnings only");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
