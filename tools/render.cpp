// SPDX-License-Identifier: Apache-2.0
// ubs render: draws a model from the views of a split, or from around it, into one file per view and channel.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <set>

#include "host/base/error.hpp"
#include "host/data/grey_png.hpp"
#include "host/data/image.hpp"
#include "host/data/npy.hpp"
#include "host/scene/framing.hpp"
#include "tools/commands.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct Options : ModelOptions {
  explicit Options(CLI::App& app) : ModelOptions(app, drawing_keys()) {}
  std::string out, format = "png", up = "auto";
  int around = 4;
  std::vector<int> size{800, 600};
  std::vector<int> views;
  std::vector<std::string> channels{"rgb"};
};

std::vector<std::size_t> chosen_views(const std::vector<int>& wanted, const Split& split) {
  std::vector<std::size_t> views;
  for (const int view : wanted) {
    if (view < 0 || static_cast<std::size_t>(view) >= split.views.size())
      fail(ErrorKind::usage, "--views {}: split '{}' has the views 0 to {}", view, split.name,
           split.views.size() - 1);
    views.push_back(static_cast<std::size_t>(view));
  }
  if (wanted.empty())
    for (std::size_t i = 0; i < split.views.size(); ++i) views.push_back(i);
  return views;
}

void save_npy(const fs::path& path, const RenderedView& view, std::span<const float> pixels,
              std::size_t channels) {
  std::vector<std::size_t> shape{static_cast<std::size_t>(view.height), static_cast<std::size_t>(view.width)};
  if (channels > 1) shape.push_back(channels);
  write_npy(path, shape, pixels);
}

void save_channel(const Options& options, const std::string& channel, const std::string& name,
                  const RenderedView& view) {
  const std::string suffix = channel == "rgb" ? "" : "_" + channel;
  const fs::path path = fs::path(options.out) / (name + suffix + "." + options.format);
  const std::vector<float>& pixels = channel == "rgb"     ? view.rgb
                                     : channel == "alpha" ? view.alpha
                                                          : view.depth;
  if (options.format == "npy") {
    save_npy(path, view, pixels, channel == "rgb" ? 3 : 1);
  } else if (channel == "rgb") {
    save_png_interleaved(path, pixels, view.width, view.height);
  } else if (channel == "alpha") {
    save_png_grey8(path, pixels, view.width, view.height);
  } else {
    const GreyRange range = save_png_grey16(path, pixels, view.width, view.height);
    fmt::print("{}: depth {:.6g} to {:.6g} stands for 0 to 65535\n", path.string(), range.low, range.high);
  }
}

// Without data: from around the model. Other tools have y downwards, as cameras do, unless a floor says otherwise;
// models of ours have the axes of their data, mostly z up.
Split views_around(const Options& options, const LoadedModel& loaded) {
  const bool foreign = loaded.format != SplatFormat::ubs;
  const std::array<double, 3> up = options.up == "auto"
                                       ? guess_up(loaded.model, parse_axis(foreign ? "-y" : "z"))
                                       : parse_axis(options.up);
  Split split{"around", {}};
  for (const Camera& camera : framing_cameras(frame_model(loaded.model, up), static_cast<std::size_t>(options.around),
                                              options.size[0], options.size[1]))
    split.views.push_back({fmt::format("around_{}", split.views.size()), camera, {}, nullptr});
  fmt::print("up ({}, {}, {}): another axis with --up\n", up[0], up[1], up[2]);
  return split;
}

int run(const Options& options) {
  const TrainSettings settings = options.settings.resolve();
  const LoadedModel loaded = open_model(options.model, options.import.options());
  const MixedModel& model = loaded.model;
  const Split split = options.data.empty()
                          ? views_around(options, loaded)
                          : open_split_for(loaded.offset, options.data, options.split, settings, Images::skip);
  const std::vector<std::size_t> views = chosen_views(options.views, split);
  const std::set<std::string> channels(options.channels.begin(), options.channels.end());
  ModelSession session(options.device, model, split, settings, channels.contains("depth"));
  std::error_code error;
  fs::create_directories(options.out, error);
  if (error) fail(ErrorKind::data, "{}: cannot make the folder: {}", options.out, error.message());
  for (const std::size_t i : views) {
    session.renderer().forward(session.model().view(), static_cast<std::uint32_t>(i), session.settings(),
                               false);
    const RenderedView view = session.renderer().download();
    for (const std::string& channel : channels) save_channel(options, channel, split.views[i].name, view);
  }
  fmt::print("{} views of '{}' in {}\n", views.size(), split.name, options.out);
  return 0;
}

}  // namespace

Command add_render(CLI::App& root) {
  CLI::App* app = root.add_subcommand("render", "Draw a model from the cameras of a data folder, or from around it");
  const auto options = std::make_shared<Options>(*app);
  app->get_option("--data")->required(false);
  app->add_option("--around", options->around, "without --data: number of views around the model [4]")
      ->check(CLI::Range(1, 100'000))
      ->type_name("COUNT");
  app->add_option("--size", options->size, "without --data: width and height [800,600]")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::Range(1, 16384))
      ->type_name("W,H");
  app->add_option("--up", options->up,
                  "without --data: axis that points up, x to -z [auto: away from a floor, else -y for files of other "
                  "tools, z for ours]")
      ->type_name("AXIS");
  app->add_option("--out", options->out, "folder for one file per view, named after the frame")
      ->required()
      ->type_name("DIR");
  app->add_option("--format", options->format,
                  "png (rgb and alpha 8 bit, depth 16 bit of its range) or npy (float32, not clamped) [png]")
      ->check(CLI::IsMember({"png", "npy"}))
      ->type_name("png|npy");
  app->add_option("--views", options->views, "numbers of views, such as 0,3,5 [all]")
      ->delimiter(',')
      ->type_name("K,K,...");
  app->add_option("--channels", options->channels,
                  "of rgb,alpha,depth; alpha and depth files get the suffix _alpha, _depth [rgb]")
      ->delimiter(',')
      ->check(CLI::IsMember({"rgb", "alpha", "depth"}))
      ->type_name("LIST");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
