// SPDX-License-Identifier: Apache-2.0
// ubs pack: writes a data set to one file that loads fast, even on machines without an image library.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/dataset/packed.hpp"
#include "host/run/open_data.hpp"
#include "tools/commands.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/settings_options.hpp"

namespace ubs::tools {
namespace {

std::vector<std::string_view> pack_keys() {
  std::vector<std::string_view> keys = keys_used(kOfReading);
  keys.emplace_back("background");  // transparent images are composited on this colour
  return keys;
}

struct PackOptions {
  explicit PackOptions(CLI::App& app) : settings(app, pack_keys()) {}
  SettingsOptions settings;
  std::string data, out;
  bool json = false, overwrite = false;
};

std::size_t image_count(const Split& split) {
  std::size_t count = 0;
  for (const View& view : split.views) count += view.has_image();
  return count;
}

int run(const PackOptions& options) {
  files_before_output();
  check_output_files({options.out}, {options.data}, options.overwrite);
  check_extension(options.out, "a packed data set", {".ubsd"});
  const TrainSettings settings = options.settings.resolve();
  Dataset set = open_dataset(options.data, {}, settings, Images::load);
  warn_skipped(set.report);
  const PackedData data{std::move(set.splits),
                        std::move(set.points),
                        settings.background.colour,
                        settings.downscale,
                        set.offset,
                        std::move(set.depth_bounds)};
  write_packed(options.out, data);

  const auto bytes = std::filesystem::file_size(options.out);
  Json splits = Json::object();
  std::string text;
  for (const Split& split : data.splits) {
    splits[split.name] = {{"views", split.views.size()}, {"images", image_count(split)}};
    text += fmt::format("{}{} {} views", text.empty() ? "" : ", ", split.views.size(), split.name);
  }
  if (options.json) {
    print_json({{"out", options.out},
                {"bytes", bytes},
                {"splits", splits},
                {"points", data.points ? Json(data.points->positions.size()) : Json(nullptr)}});
    return 0;
  }
  say("{} in {} ({:.1f} MiB)\n", text, options.out, static_cast<double>(bytes) / (1 << 20));
  return 0;
}

}  // namespace

Command add_pack(CLI::App& root) {
  CLI::App* app = root.add_subcommand("pack", "Write a data set as one file that can be passed as --data");
  const auto options = std::make_shared<PackOptions>(*app);
  app->add_option("data", options->data, "data folder of any layout that 'ubs train' reads")
      ->required()
      ->type_name("DATA");
  app->add_option("--out", options->out, "file to write, usually with the extension .ubsd")
      ->required()
      ->type_name("FILE");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
