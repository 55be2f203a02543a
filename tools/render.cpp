// SPDX-License-Identifier: Apache-2.0
// ubs render: renders a model from the views of a split or along a camera path, to one file per view and
// channel or to a video.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <set>
#include <span>

#include "host/base/error.hpp"
#include "host/dataset/grey_png.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/lens_image.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/video_writer.hpp"
#include "host/model/picture.hpp"
#include "host/run/open_data.hpp"
#include "tools/commands.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/job.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/path_options.hpp"
#include "tools/common/progress.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

struct RenderOptions : ModelOptions {
  explicit RenderOptions(CLI::App& app) : ModelOptions(app, drawing_keys()), path(app) {}
  PathOptions path;
  std::string out, video, format = "png", lens;
  std::vector<int> views;
  std::vector<std::string> channels{"rgb"};
  bool overwrite = false;
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

std::string file_name(const RenderOptions& options, const std::string& channel, const std::string& view) {
  return view + (channel == "rgb" ? "" : "_" + channel) + "." + options.format;
}

// Checks the output files. Returns a lock of the output folder if there is one; the caller holds it until the
// end.
std::unique_ptr<FolderLock> take_outputs(const RenderOptions& options, const Split& split) {
  Paths names;
  std::set<std::string> seen;  // --views may list a view several times
  for (const View& view : split.views)
    if (seen.insert(view.name).second)
      for (const std::string& channel : options.channels)
        names.push_back(file_name(options, channel, view.name));
  auto held = lock_output_folder(options.out, names, {options.data}, options.overwrite);
  // The video may be in the output folder, so it is checked after lock_output_folder() has created this
  // folder.
  check_output_files({options.video}, {options.model, options.data}, options.overwrite);
  return held;
}

void save_channel(const RenderOptions& options, const std::string& channel, const std::string& name,
                  const RenderedView& view) {
  const fs::path path = fs::path(options.out) / file_name(options, channel, name);
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
    say("{}: values 0 to 65535 are depths from {:.6g} to {:.6g}\n", path.string(), range.low, range.high);
  }
}

void check(const RenderOptions& options) {
  if (options.out.empty() && options.video.empty())
    fail(ErrorKind::usage, "no output given: pass --out DIR for images or --video FILE for a video");
  options.path.check_unused(!options.lens.empty());
  if (!options.video.empty() && options.channels.size() != 1)
    fail(ErrorKind::usage, "--video: a video can show only one channel, not {}",
         fmt::join(options.channels, ","));
}

// Returns the views of the data, or those along a path. A path is derived from the cameras of the training
// views or of the split that was chosen with --split. Without data, it is derived from the cameras that the
// model lists.
Split wanted_views(const RenderOptions& options, const LoadedModel& model, const TrainSettings& settings,
                   const std::optional<OpenedData>& opened) {
  std::string name = options.split;
  if (options.path.wanted() && !options.path.holds() && !options.split_given()) name = "train";
  Split split;
  if (!options.data.empty()) {
    split = open_split_for(model.offset, options.data, name, settings, Images::skip, opened);
    check_apart_from_images(options.out, split);
  }
  if (options.path.wanted()) {
    const std::vector<Camera> cameras =
        options.data.empty() ? noted_cameras(model.model, model.notes.cameras) : cameras_of(split);
    split = options.path.views(model, cameras, !options.video.empty());
  } else if (const std::optional<double> time = options.path.single_time(model.model)) {
    for (View& view : split.views) view.camera.time = *time;
  }
  Split wanted{.name = split.name};
  for (const std::size_t i : chosen_views(options.views, split)) wanted.views.push_back(split.views[i]);
  return wanted;
}

// ChosenLens is the lens that the user chose with --lens, and the size of its images.
struct ChosenLens {
  ImageSize size;
  LensImage image;
};
std::optional<ChosenLens> lens_of(const RenderOptions& options) {
  if (options.lens.empty()) return std::nullopt;
  const bool panorama = options.lens == "equirectangular";
  const ImageSize size =
      options.path.size().value_or(panorama ? ImageSize{2048, 1024} : ImageSize{1024, 1024});
  LensImage image(wide_lens(options.lens, size.width, size.height), "--lens");
  image.check_complete();
  return ChosenLens{size, std::move(image)};
}

// Drawing renders the views of a split. A view with --lens is composed of the images of several cameras.
class Drawing {
 public:
  // With a lens, the cameras of `split` get the size of the images.
  Drawing(std::optional<ChosenLens> lens, const RenderOptions& options, const LoadedModel& model,
          const TrainSettings& settings, Split& split, bool depth)
      : lens_(std::move(lens)),
        session_(device_of_rank(options.device), model.model, cameras_behind(split), settings, depth) {}

  RenderedView draw(std::size_t view) {
    if (!lens_) return draw_camera(view);
    std::vector<RenderedView> faces;
    for (std::size_t i = 0; i < lens_->image.face_count(); ++i)
      faces.push_back(draw_camera(view * lens_->image.face_count() + i));
    return lens_->image.compose(faces);
  }

 private:
  Split cameras_behind(Split& split) {
    if (!lens_) return split;
    Split faces{.name = split.name};
    for (View& view : split.views) {
      for (const Camera& camera : lens_->image.faces(view.camera)) faces.views.emplace_back().camera = camera;
      view.camera.width = lens_->size.width, view.camera.height = lens_->size.height;
    }
    return faces;
  }
  RenderedView draw_camera(std::size_t camera) {
    session_.renderer().forward(session_.model().view(), static_cast<std::uint32_t>(camera),
                                session_.settings(), false);
    return session_.renderer().download();
  }

  std::optional<ChosenLens> lens_;
  ModelSession session_;
};

// Collects one rendered view from each rank of a job, but not more than there are `views`. The first rank
// receives all of them; without a job the result is {own}.
std::vector<RenderedView> gather(RenderedView own, std::span<const View> views) {
  if (ranks().size() == 1) return {std::move(own)};
  std::vector<std::vector<float>> pieces(static_cast<std::size_t>(ranks().size()));
  for (const auto* values : {&own.rgb, &own.alpha, &own.depth})
    pieces[0].insert(pieces[0].end(), values->begin(), values->end());
  std::vector<RenderedView> all;
  for (const Bytes& come : exchange_values(ranks(), pieces)) {
    if (come.empty()) continue;
    const std::span<const float> values = as_values<float>(come);
    const auto part = [&](std::size_t first, std::size_t count) {
      const std::span<const float> numbers = values.subspan(first, count);
      return std::vector<float>(numbers.begin(), numbers.end());
    };
    const Camera& camera = views[all.size()].camera;
    const auto n = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    all.push_back(
        {camera.width, camera.height, part(0, 3 * n), part(3 * n, n), part(4 * n, values.size() - 4 * n)});
  }
  return all;
}

// Returns one depth range for all views, so that a depth has the same colour in every view. The range is that
// of a few of the views.
DepthRange common_range(Drawing& drawing, std::size_t views) {
  constexpr std::size_t kSamples = 8;
  DepthRange range;
  for (std::size_t i = 0; i < std::min(views, kSamples); ++i)
    range = united(range, depth_range(drawing.draw(i * views / std::min(views, kSamples))));
  return range;
}

class Outputs {
 public:
  Outputs(const RenderOptions& options, Drawing& drawing, const Split& split)
      : options_(options), channels_(options.channels.begin(), options.channels.end()) {
    if (options.video.empty()) return;
    const Camera& first = split.views.front().camera;
    for (const View& view : split.views)
      if (view.camera.width != first.width || view.camera.height != first.height)
        fail(ErrorKind::usage,
             "--video: view '{}' has {}x{} pixels, but the first one has {}x{}: pass --path, or choose views "
             "of one size with --views",
             view.name, view.camera.width, view.camera.height, first.width, first.height);
    video_ = std::make_unique<VideoWriter>(options.video, first.width, first.height, options.path.fps());
    if (channels_.contains("depth")) range_ = common_range(drawing, split.views.size());
  }

  void add(const View& view, const RenderedView& drawn) {
    if (!options_.out.empty() && saved_.insert(view.name).second)
      for (const std::string& channel : channels_) save_channel(options_, channel, view.name, drawn);
    if (!video_) return;
    const std::string& name = *channels_.begin();
    video_->write(picture(drawn,
                          name == "rgb"     ? Channel::rgb
                          : name == "alpha" ? Channel::alpha
                                            : Channel::depth,
                          range_));
  }

  void finish(const Split& split) {
    const std::size_t n = split.views.size();
    if (!options_.out.empty()) say("{} views of '{}' in {}\n", saved_.size(), split.name, options_.out);
    if (!video_) return;
    video_->commit();
    const Camera& camera = split.views.front().camera;
    say("{} frames of {}x{}, {:.2f} s at {} frames per second, {}, in {}\n", n, camera.width, camera.height,
        static_cast<double>(n) / options_.path.fps(), options_.path.fps(), video_->codec(), options_.video);
  }

 private:
  const RenderOptions& options_;
  std::set<std::string> channels_;
  std::set<std::string> saved_;  // names of the views whose images are written
  std::unique_ptr<VideoWriter> video_;
  DepthRange range_;
};

int run(RenderOptions& options) {
  files_before_output();
  if (options.data.empty()) options.path.look_around(!options.video.empty());
  check(options);
  auto lens = lens_of(options);
  const LoadedModel loaded = options.load();
  RunData run;
  if (!options.data.empty()) run = use_run_data(options.model, options.data, options.settings.resolve());
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  Split split = wanted_views(options, loaded, settings, run.opened);
  const bool writes = ranks().first();
  const auto held = writes ? take_outputs(options, split) : nullptr;
  const bool depth = std::ranges::find(options.channels, "depth") != options.channels.end();
  Drawing drawing(std::move(lens), options, loaded, settings, split, depth);
  std::optional<Outputs> outputs;
  if (writes) outputs.emplace(options, drawing, split);
  const InterruptGuard guard;
  CountProgress progress(split.views.size(), "views", !writes);
  const auto together = static_cast<std::size_t>(ranks().size());
  for (std::size_t i = 0; i < split.views.size(); i += together) {
    if (on_any_rank(guard.interrupted())) {
      progress.finish();
      warn("interrupted after {} of {} views{}", i, split.views.size(),
           options.video.empty() ? "" : "; no video is written");
      return kInterruptedExitCode;
    }
    const std::size_t own = i + static_cast<std::size_t>(ranks().rank());
    const std::vector<RenderedView> drawn = gather(
        own < split.views.size() ? drawing.draw(own) : RenderedView{}, std::span(split.views).subspan(i));
    if (held) held->check_place();
    for (std::size_t k = 0; writes && k < drawn.size(); ++k) {
      outputs->add(split.views[i + k], drawn[k]);
      progress.update(i + k + 1);
    }
  }
  progress.finish();
  if (outputs) outputs->finish(split);
  return 0;
}

}  // namespace

Command add_render(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "render",
      "Render a model from the cameras of a data folder, from cameras around the scene, or along a path");
  const auto options = std::make_shared<RenderOptions>(*app);
  app->add_option("--out", options->out, "output folder for the images: one file per view and channel")
      ->type_name("DIR");
  app->add_option("--video", options->video,
                  fmt::format("video of the views: {}", fmt::join(video_extensions(), ", ")))
      ->type_name("FILE");
  app->add_option("--format", options->format,
                  "png (rgb and alpha with 8 bits, depth with 16 bits over its range) or npy (float32, not "
                  "clamped) [png]")
      ->check(CLI::IsMember({"png", "npy"}))
      ->type_name("png|npy");
  app->add_option(
         "--lens", options->lens,
         "render through this lens instead of a pinhole: equirectangular (360-degree panorama) or "
         "fisheye:DEGREES [180]; without --size, a panorama has 2048x1024 pixels and a fisheye image has "
         "1024x1024; the depth of a pixel is its distance from the camera")
      ->type_name("LENS");
  app->add_option("--views", options->views, "indices of the views to render, such as 0,3,5 [all]")
      ->delimiter(',')
      ->type_name("K,K,...");
  app->add_option(
         "--channels", options->channels,
         "channels to write: rgb, alpha, depth; alpha and depth files get the suffix _alpha and _depth [rgb]")
      ->delimiter(',')
      ->check(CLI::IsMember({"rgb", "alpha", "depth"}))
      ->type_name("LIST");
  app->get_option("--split")->description("split: train, val or test [test, or train if --path is given]");
  app->get_option("--format")->needs("--out");
  app->get_option("--fps")->needs("--video");
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
