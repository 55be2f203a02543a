// SPDX-License-Identifier: Apache-2.0
#include "tools/common/path_options.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/model/keyframes.hpp"
#include "tools/common/job.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kDefaultFov = 50;             // degrees
constexpr int kPicturesAround = 4;             // number of images if neither data nor --path are given
constexpr const char* kSuitable = "suitable";  // internal: ubs chooses the path from the cameras
constexpr int kMaxSize = 16384, kMaxFrames = 1000000;

// Returns the numbers in a string in which `separator` separates them. Returns no numbers if the string has
// any other form.
template <typename Number>
std::vector<Number> numbers(std::string_view text, char separator) {
  std::vector<Number> found;
  const char *at = text.data(), *end = at + text.size();
  while (true) {
    Number value{};
    const auto [next, error] = std::from_chars(at, end, value);
    if (error != std::errc{} || !std::isfinite(static_cast<double>(value))) return {};
    found.push_back(value);
    if (next == end) return found;
    if (*next != separator) return {};
    at = next + 1;
  }
}

double vertical_fov(double horizontal, const Canvas& canvas) {
  return 2 * std::atan(std::tan(horizontal / 2) * canvas.height / canvas.width);
}

double horizontal_fov(double degrees, std::span<const Camera> cameras, const Canvas& canvas) {
  if (degrees > 0) return degrees * kDegree;
  return cameras.empty() ? kDefaultFov * kDegree : fov_showing(cameras[0], canvas);
}

}  // namespace

ImageSize parse_size(const std::string& option, const std::string& text) {
  const std::vector<int> size = numbers<int>(text, 'x');
  if (size.size() != 2 || std::min(size[0], size[1]) < 1 || std::max(size[0], size[1]) > kMaxSize)
    fail(ErrorKind::usage, "{} {}: expected WIDTHxHEIGHT, such as 640x480, each at most {}", option, text,
         kMaxSize);
  return {size[0], size[1]};
}

Vec3 parse_vector(const std::string& option, const std::string& text) {
  const bool negative = text.starts_with('-');
  if (const std::size_t axis = std::string_view("xyz").find(text.substr(negative ? 1 : 0));
      text.size() == (negative ? 2u : 1u) && axis < 3) {
    Vec3 unit{};
    unit[axis] = negative ? -1 : 1;
    return unit;
  }
  const std::vector<double> v = numbers<double>(text, ',');
  if (v.size() != 3)
    fail(ErrorKind::usage, "{} {}: expected three numbers X,Y,Z, or an axis such as -y", option, text);
  return {v[0], v[1], v[2]};
}

FrameHints frame_hints(const LoadedModel& model) {
  FrameHints hints;
  if (model.notes.up) hints.up_without_floor = *model.notes.up;
  return hints;
}

PathOptions::PathOptions(CLI::App& app) {
  const auto add = [&](const char* name, auto& value, const char* help, const char* type) {
    CLI::Option* option = app.add_option(name, value, help)->type_name(type)->group("Camera path");
    options_.push_back(option);
    return option;
  };
  app.add_option("--path", path_,
                 "render along this path instead of the views of a split: orbit, spiral, train (along the "
                 "training cameras), or a file of keyframes (docs/view.md)")
      ->type_name("orbit|spiral|train|FILE.json")
      ->group("Camera path");
  app.add_option("--hold", hold_, "keep the camera at this view while time advances (instead of --path)")
      ->type_name("K")
      ->check(not_negative())
      ->excludes("--path")
      ->group("Camera path");
  frames_option_ = add("--path-frames", frames_,
                       "number of images along the path [120; 4 if neither data nor --path are given]", "N");
  frames_option_->check(from_to(1, kMaxFrames));
  app.add_option("--fps", fps_, "frames per second of the video [30]")
      ->type_name("NUMBER")
      ->check(from_to(0.01, 1000.0));
  size_option_ = add("--size", size_, "size of the images [as in the data, otherwise 800x600]", "WxH");
  add("--fov", fov_, "horizontal field of view in degrees [as in the data, otherwise 50]", "NUMBER")
      ->check(from_to(1.0, 170.0));
  CLI::Option* loops =
      add("--loops", loops_, "number of turns of an orbit or spiral; negative: in the other direction [1]",
          "NUMBER");
  app.add_option("--time", time_,
                 "time of all images (also without --path), or times of the first and the last image [times "
                 "of the keyframes, otherwise 0:1]")
      ->type_name("T|T0:T1")
      ->group("Camera path");
  CLI::Option* centre = add("--centre", centre_, "centre of the orbit [estimated]", "X,Y,Z");
  up_option_ = add("--up", up_, kUpHelp, "X,Y,Z|AXIS");
  CLI::Option* distance = add("--distance", distance_,
                              "distance of the orbit from its centre [median of the cameras of the data, "
                              "otherwise computed from the splats]",
                              "NUMBER")
                              ->check(positive());
  elevation_option_ =
      add("--elevation", elevation_,
          "elevation of the orbit in degrees [median of the cameras of the data, otherwise 20]", "NUMBER")
          ->check(from_to(-89.0, 89.0));
  turning_ = {loops, centre, distance, elevation_option_};
}

void PathOptions::look_around(bool video) {
  if (wanted()) return;
  path_ = kSuitable;
  if (!video && frames_option_->count() == 0) frames_ = kPicturesAround;
}

std::optional<ImageSize> PathOptions::size() const {
  if (size_.empty()) return std::nullopt;
  return parse_size("--size", size_);
}

void PathOptions::check_unused(bool sized) const {
  if (!path_.empty()) return;
  for (const CLI::Option* option : options_)
    if (option->count() > 0 && !(holds() && option == frames_option_) && !(sized && option == size_option_))
      fail(ErrorKind::usage, "{} requires --path", option->get_name());
}

void PathOptions::check_no_turn() const {
  for (const CLI::Option* option : turning_)
    if (option->count() > 0)
      fail(ErrorKind::usage, "{} only applies to --path orbit and --path spiral", option->get_name());
}

FrameHints PathOptions::hints(const LoadedModel& model, double fov) const {
  FrameHints hints = frame_hints(model);
  hints.fov = fov;
  if (!centre_.empty()) hints.centre = parse_vector("--centre", centre_) - model.offset;
  if (!up_.empty()) {
    hints.up = parse_vector("--up", up_);
    if (!(length(*hints.up) > 1e-9)) fail(ErrorKind::usage, "--up {}: the vector has no direction", up_);
  }
  if (distance_ > 0) hints.distance = distance_;
  if (elevation_option_->count() > 0) hints.elevation = elevation_ * kDegree;
  return hints;
}

std::unique_ptr<CameraPath> PathOptions::path(const LoadedModel& model, std::span<const Camera> cameras,
                                              const SceneFrame& frame, double fov) const {
  if (!std::isfinite(loops_) || loops_ == 0) fail(ErrorKind::usage, "--loops {}: must not be 0", loops_);
  const bool suitable = path_ == kSuitable;
  const bool turns = std::ranges::any_of(turning_, [](const CLI::Option* o) { return o->count() > 0; });
  if (path_ == "orbit" || (suitable && (turns || frame.around || cameras.empty()))) {
    if (!cameras.empty() && !frame.around && ranks().first())
      remark("ubs: the orbit shows sides that no camera saw; --path train follows the cameras\n");
    return orbit_path(frame, fov, loops_);
  }
  if (path_ == "spiral") return spiral_path(frame, fov, loops_);
  if (path_ == "train" || suitable) {
    if (cameras.empty())
      fail(ErrorKind::usage,
           "--path train: the model does not list its training cameras: pass the data folder");
    check_no_turn();
    if (up_option_->count() > 0)
      fail(ErrorKind::usage,
           "--up does not apply to this path, which follows the orientation of existing cameras");
    return walk_path(cameras, fov);
  }
  if (!path_.ends_with(".json"))
    fail(ErrorKind::usage, "--path {}: choose orbit, spiral, train or a file of keyframes (*.json)", path_);
  check_no_turn();
  KeyframeFile file = read_keyframes(path_, {.up = frame.up, .fov = fov, .offset = model.offset});
  return keyframe_path(std::move(file.poses), file.closed, file.has_time);
}

void warn_of_other_times(const std::string& text, std::span<const double> times) {
  if (std::ranges::all_of(times, [](double time) { return time >= 0 && time <= 1; })) return;
  warn(
      "--time {}: the model was trained on times from 0 to 1, so the data do not determine its images at "
      "other times",
      text);
}

// Returns the first and the last time, or a single time; empty if the model does not depend on time.
std::vector<double> PathOptions::time_range(const MixedModel& model) const {
  if (!model.has_time()) {
    if (!time_.empty()) fail(ErrorKind::usage, "--time {}: the model does not depend on time", time_);
    return {};
  }
  const std::vector<double> range = time_.empty() ? std::vector{0.0, 1.0} : numbers<double>(time_, ':');
  if (range.empty() || range.size() > 2) fail(ErrorKind::usage, "--time {}: expected T or T0:T1", time_);
  warn_of_other_times(time_, range);
  return range;
}

std::optional<double> PathOptions::single_time(const MixedModel& model) const {
  if (time_.empty()) return {};
  const std::vector<double> range = time_range(model);
  if (range.size() != 1)
    fail(ErrorKind::usage, "--time {}: a range of times requires --path or --hold", time_);
  return range[0];
}

void PathOptions::set_times(std::vector<Pose>& poses, bool from_path, const MixedModel& model) const {
  const std::vector<double> range = time_range(model);
  if (range.empty() || (from_path && time_.empty())) return;
  const std::vector<double> moments = path_moments(static_cast<int>(poses.size()), false);
  for (std::size_t i = 0; i < poses.size(); ++i)
    poses[i].time = range.front() + moments[i] * (range.back() - range.front());
}

Canvas PathOptions::canvas(std::span<const Camera> cameras, bool even) const {
  Canvas canvas;
  if (!cameras.empty()) canvas = {cameras[0].width, cameras[0].height, {}};
  if (const auto wanted = size()) return {wanted->width, wanted->height, {}};
  if (even) {
    canvas.width -= canvas.width % 2;
    canvas.height -= canvas.height % 2;
  }
  return canvas;
}

Split PathOptions::held(const MixedModel& model, std::span<const Camera> cameras) const {
  if (static_cast<std::size_t>(hold_) >= cameras.size())
    fail(ErrorKind::usage, "--hold {}: choose a view below {}", hold_, cameras.size());
  const std::vector<double> range = time_range(model);
  if (range.empty()) fail(ErrorKind::usage, "--hold {}: the model does not depend on time", hold_);
  Split split{.name = "path"};
  for (const double u : path_moments(frames_, false)) {
    View& view = split.views.emplace_back(View{.name = fmt::format("frame_{:04}", split.views.size())});
    view.camera = cameras[static_cast<std::size_t>(hold_)];
    view.camera.time = range.front() + u * (range.back() - range.front());
  }
  return split;
}

Split PathOptions::views(const LoadedModel& model, std::span<const Camera> cameras, bool even) const {
  if (holds()) return held(model.model, cameras);
  Canvas image = canvas(cameras, even);
  const double fov = horizontal_fov(fov_, cameras, image);
  const SceneFrame frame =
      scene_frame(model.model, cameras, hints(model, std::min(fov, vertical_fov(fov, image))));
  image.extra = frame.extra;
  const std::unique_ptr<CameraPath> along = path(model, cameras, frame, fov);
  std::vector<Pose> poses;
  for (const double u : path_moments(frames_, along->closed())) poses.push_back(along->at(u));
  set_times(poses, along->has_time(), model.model);

  Split split{.name = "path"};
  for (const Pose& pose : poses) {
    View view{.name = fmt::format("frame_{:04}", split.views.size())};
    view.camera = camera_at(pose, image);
    split.views.push_back(std::move(view));
  }
  return split;
}

}  // namespace ubs::tools
