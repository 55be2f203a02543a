// SPDX-License-Identifier: Apache-2.0
// ubs metrics: computes PSNR, SSIM and LPIPS of image files: of one pair, or of two folders with the same
// file names.
#include <CLI/CLI.hpp>
#include <map>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/model/image_comparison.hpp"
#include "host/run/verified_device.hpp"
#include "host/train/evaluate.hpp"
#include "tools/commands.hpp"
#include "tools/common/lpips_options.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/program_version.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct MetricsOptions {
  explicit MetricsOptions(CLI::App& app) : lpips(app) {}
  std::string truth, image, device, out;
  LpipsOptions lpips;
  bool json = false, overwrite = false;
};

struct Pair {
  std::string name;
  fs::path truth, image;
};

std::map<std::string, fs::path> images_in(const fs::path& folder) {
  std::map<std::string, fs::path> images;  // by name without extension
  for (const fs::path& entry : pictures_in(folder))
    if (const auto [first, fresh] = images.emplace(entry.stem().string(), entry); !fresh)
      fail(ErrorKind::data,
           "{} and {} have the same name without extension, but images are paired by these names: move one "
           "of them elsewhere",
           first->second.string(), entry.string());
  return images;
}

std::vector<Pair> pairs_of(const fs::path& truth, const fs::path& image) {
  for (const fs::path& path : {truth, image})
    if (!path_exists(path)) fail(ErrorKind::data, "{}: no such file or folder", path.string());
  if (is_folder(truth) != is_folder(image))
    fail(ErrorKind::usage, "'{}' and '{}': pass two images or two folders", truth.string(), image.string());
  if (!is_folder(truth)) return {{image.stem().string(), truth, image}};
  const auto truths = images_in(truth), images = images_in(image);
  std::vector<Pair> pairs;
  for (const auto& [name, path] : truths)
    if (const auto found = images.find(name); found != images.end())
      pairs.push_back({name, path, found->second});
  if (pairs.empty())
    fail(ErrorKind::data, "'{}' and '{}' have no images of the same name", truth.string(), image.string());
  if (const std::size_t alone = truths.size() + images.size() - 2 * pairs.size(); alone > 0)
    warn("{} images have no counterpart in the other folder and are not measured", alone);
  return pairs;
}

ViewMetrics measure(ImageComparison& comparison, const Pair& pair) {
  const Image8 truth = load_image(pair.truth), image = load_image(pair.image);
  if (truth.width != image.width || truth.height != image.height)
    fail(ErrorKind::data, "{} has {} x {} pixels, but {} has {} x {}", pair.truth.string(), truth.width,
         truth.height, pair.image.string(), image.width, image.height);
  return comparison.measure(pair.name, truth, image);
}

int run(const MetricsOptions& options) {
  check_output_files({options.out}, {options.truth, options.image}, options.overwrite);
  check_extension(options.out, "JSON", {".json"});
  const LpipsRequest request = options.lpips.request();
  const std::vector<Pair> pairs = pairs_of(options.truth, options.image);
  const std::unique_ptr<Device> device =
      open_verified_device(options.device, comparing_use(options.lpips.wanted()));
  ImageComparison comparison(*device, request);
  Metrics metrics;
  for (const Pair& pair : pairs) {
    metrics.views.push_back(measure(comparison, pair));
    if (!options.json) say("{:<24} {}\n", pair.name, metrics_text(metrics.views.back()));
  }
  add_mean(metrics);
  Json json{{"version", version()},
            {"build", build_id()},
            {"truth", options.truth},
            {"images", options.image},
            {"device", device_json(device->info())}};
  json.update(metrics_json(metrics));
  if (!options.out.empty()) write_file_atomically(options.out, json_file_text(json));
  if (options.json)
    print_json(json);
  else if (pairs.size() > 1)
    say("{:<24} {}\n", fmt::format("mean of {}", pairs.size()), metrics_text(metrics.mean));
  return 0;
}

}  // namespace

Command add_metrics(CLI::App& root) {
  CLI::App* app = root.add_subcommand("metrics", "Measure images against reference images");
  const auto options = std::make_shared<MetricsOptions>(*app);
  app->add_option("A", options->truth, "reference: an image, or a folder of images")
      ->required()
      ->type_name("FILE|DIR");
  app->add_option("B", options->image, "image or folder to measure; files of a folder are paired by name")
      ->required()
      ->type_name("FILE|DIR");
  add_device_option(*app, options->device);
  app->add_option("--out", options->out, "write the measurements to this JSON file")->type_name("FILE");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
