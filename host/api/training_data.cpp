// SPDX-License-Identifier: Apache-2.0
#include "host/api/training_data.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "host/api/camera_rig.hpp"
#include "host/base/error.hpp"
#include "host/base/median.hpp"
#include "host/base/warning.hpp"
#include "host/data/align_cameras.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/data/triangulate.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/scene/choose_dim.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/initialise.hpp"
#include "host/scene/settings.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

// Setting noise_lr of static scenes if the unit is the depth of the scene. Relative to the size of the scene,
// the noise of the positions grows with the square of the unit. The published value of noise_lr is 1e6. It
// was chosen for scenes whose depth is about 4 units, so it corresponds to 4^2 * 1e6 if the unit is the
// depth.
constexpr double kNoiseOfDepth = 1.6e7;

// Ratio of the brightness of images above which training logs a warning. In measurements, the ratio was at
// most 1.03 for cameras with a fixed exposure, and 1.17 to 1.36 if the exposures differed by up to 0.8 stops
// from their mean (docs/results/2026-11-28-uneven-exposure.md).
constexpr double kUnevenBrightness = 1.1;

// Returns at most `most` of the points, chosen at even intervals from the list, so that dense regions stay
// dense.
PointCloud thinned(PointCloud points, std::size_t most) {
  const std::size_t all = points.positions.size();
  if (all <= most) return points;
  for (std::size_t i = 0; i < most; ++i) {
    points.positions[i] = points.positions[i * all / most];
    points.colours[i] = points.colours[i * all / most];
  }
  points.positions.resize(most);
  points.colours.resize(most);
  return points;
}

// Removes points closer than `room` to any camera, because they would cover its image: a point behind the
// scene for one camera can be just in front of a camera on the other side. Keeps all points if this would
// remove three quarters of them or more.
void leave_room(PointCloud& cloud, std::span<const View> views, double room) {
  PointCloud kept;
  for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
    const auto& p = cloud.positions[i];
    const bool close = std::ranges::any_of(views, [&](const View& view) {
      const auto c = view.camera.centre();
      return std::hypot(p[0] - c[0], p[1] - c[1], p[2] - c[2]) < room;
    });
    if (close) continue;
    kept.positions.push_back(p);
    kept.colours.push_back(cloud.colours[i]);
  }
  if (4 * kept.positions.size() > cloud.positions.size()) cloud = std::move(kept);
}

double median_pixels(const Split& train) {
  std::vector<double> pixels;
  for (const View& view : train.views) pixels.push_back(1.0 * view.camera.width * view.camera.height);
  return median(std::move(pixels));
}

// Adds a note if cap_max reduces the number of initial points or splats.
void note_cap(Dataset& data, const TrainSettings& settings) {
  const auto cap = static_cast<std::size_t>(settings.cap_max);
  if (data.points && data.points->positions.size() > cap) {
    data.report.notes.push_back(fmt::format("using {} of {} points, evenly spaced, because cap_max is {}",
                                            cap, data.points->positions.size(), cap));
  } else if (!data.points && settings.init_points > settings.cap_max) {
    data.report.note(fmt::format("using {} initial splats instead of {}, because cap_max is {}", cap,
                                 settings.init_points, cap));
  }
}

// Properties of the pixels of the training images.
struct Look {
  // True if almost all pixels at the borders of the images have the same colour, which is typical of images
  // that show a single object in front of a plain background.
  bool lone_object = false;
  std::array<double, 3> mean_colour{};  // 0 to 1, rounded to two decimal places
};

// Determines these properties from a few of the training images. Ignores pixels whose mask is 0.
Look look_at(const Split& train) {
  constexpr std::size_t kPictures = 8;
  constexpr double kPlain = 0.9;  // minimum share of the border pixels that must have the same colour
  constexpr int kSame = 2;        // maximum difference of equal colours, per channel, of 255
  std::array<std::uint8_t, 3> first{};
  std::array<double, 3> sum{};
  std::size_t same = 0, outermost = 0, all = 0;
  const std::size_t step = std::max<std::size_t>(1, train.views.size() / kPictures);
  for (std::size_t v = 0; v < train.views.size(); v += step) {
    const Image8 image = train.views[v].load_image();
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x) {
        const std::ptrdiff_t at = y * image.width + x;
        if (!image.mask.empty() && image.mask[static_cast<std::size_t>(at)] == 0) continue;
        const auto pixel = image.rgb.begin() + 3 * at;
        ++all;
        for (std::ptrdiff_t c = 0; c < 3; ++c) sum[static_cast<std::size_t>(c)] += pixel[c];
        if (x > 0 && x < image.width - 1 && y > 0 && y < image.height - 1) continue;
        if (outermost++ == 0) std::copy_n(pixel, 3, first.begin());
        same += std::equal(first.begin(), first.end(), pixel,
                           [](int a, int b) { return std::abs(a - b) <= kSame; });
      }
  }
  Look look;
  look.lone_object = outermost > 0 && static_cast<double>(same) >= kPlain * static_cast<double>(outermost);
  if (all > 0)
    for (std::size_t c = 0; c < 3; ++c)
      look.mean_colour[c] = std::round(100 * sum[c] / (255.0 * static_cast<double>(all))) / 100;
  return look;
}

// Throws Error(data) if the masks exclude all pixels of all training images.
void require_pixels(const Split& train) {
  for (const View& view : train.views) {
    if (!view.masked) return;
    const std::vector<std::uint8_t> mask = view.load_image().mask;
    if (mask.empty() || std::ranges::any_of(mask, [](std::uint8_t m) { return m != 0; })) return;
  }
  fail(ErrorKind::data,
       "the masks exclude all pixels of all {} training images: in a mask, the pixels to use must be white "
       "and the pixels to ignore must be black",
       train.views.size());
}

InitialSpace space_for(const Split& train) {
  return initial_space(cameras_of(train), look_at(train).lone_object);
}

// Points are triangulated from one image for every kPointsAnImage points that are wanted (setting
// find_points), but from at least kLeastCompared and at most kMostCompared images
// (docs/results/2026-11-29-time-before-training.md).
constexpr double kPointsAnImage = 600, kLeastCompared = 40, kMostCompared = 120;

// Triangulates points from the images of a static scene and adds them to the points of the data
// (docs/results/2026-11-22-placed-points.md). Does nothing if the user has set init_extent, init_points or
// find_points = 0.
void place_points(Dataset& data, const Split& train, const TrainSettings& settings) {
  constexpr std::size_t kMinCorners = 500;
  constexpr double kPixelsAPoint = 4;  // pixels of an image per pixel that gets a depth, at least
  if (settings.init_extent != kAuto || settings.init_points != kAutoInt || settings.find_points == 0) return;
  const double wanted = settings.find_points;
  const auto images =
      static_cast<std::size_t>(std::clamp(wanted / kPointsAnImage, kLeastCompared, kMostCompared));
  const auto between = static_cast<std::size_t>(std::min(wanted, median_pixels(train) / kPixelsAPoint));
  const Triangulation found = triangulate(train.views, images, between, settings.seed);
  if (found.brightness_ratio > kUnevenBrightness && settings.appearance == Appearance::none)
    warn(
        "the exposure of the images differs (many show the same points {:.2f} times as bright as a "
        "neighbouring image): --appearance gain compensates for this",
        found.brightness_ratio);
  if (found.corners < kMinCorners) return;
  if (!data.points) data.points.emplace();
  std::ranges::copy(found.points.positions, std::back_inserter(data.points->positions));
  std::ranges::copy(found.points.colours, std::back_inserter(data.points->colours));
  data.report.notes.push_back(
      fmt::format("initial points found by comparing images: {} at keypoints, {} at pixels between them (to "
                  "disable: --set find_points=0)",
                  found.corners, found.points.positions.size() - found.corners));
}

// Returns whether the scene counts as static: all views have the same time.
bool still(const Split& train) {
  return std::ranges::all_of(train.views,
                             [&](const View& v) { return v.camera.time == train.views[0].camera.time; });
}

// Aligns the cameras before they are refined during training, using keypoints in the images.
void align(Dataset& data, Split& train) {
  require_images(train);
  const Alignment found = align_cameras(train.views);
  if (train.views.size() > kMaxAlignedViews)
    data.report.note(
        fmt::format("none of the {} cameras is aligned before training, because at most {} can be aligned",
                    train.views.size(), kMaxAlignedViews));
  if (found.aligned == 0) return;
  for (const auto& views : views_by_image(train.views)) {
    std::vector<Camera> given, aligned;
    for (const std::uint32_t v : views)
      given.push_back(train.views[v].camera), aligned.push_back(found.cameras[v]);
    if (views.size() > 1) aligned = moved_together(given, aligned);
    for (std::size_t k = 0; k < views.size(); ++k) train.views[views[k]].camera = aligned[k];
  }
  data.report.notes.push_back(
      fmt::format("aligned {} of {} cameras with {} points found in their images: the reprojection error "
                  "fell to {:.2f} pixels from {:.2f}",
                  found.aligned, train.views.size(), found.points, found.after, found.before));
}

// Returns the depth of the scene, which docs/method.md defines in section 4.4.
double typical_depth(const Dataset& data, const Split& train) {
  const std::vector<Camera> cameras = cameras_of(train);
  if (const auto depth = data.points ? median_depth(cameras, *data.points) : std::nullopt) return *depth;
  if (data.depth_bounds.size() == train.views.size()) {
    std::vector<double> middles;
    for (const auto& [near, far] : data.depth_bounds) middles.push_back(std::sqrt(near * far));
    if (const double middle = median(std::move(middles)); middle > 0) return middle;
  }
  return initial_space(cameras, false).depth;
}

void choose_unit(Dataset& data, const Split& train, TrainSettings& settings) {
  const bool free = has_free_unit(settings.variant);
  if (settings.unit == kAuto) {
    settings.unit = free ? typical_depth(data, train) : 1;
    if (free) {
      data.report.notes.push_back(
          fmt::format("training divides all lengths of the data by {:.4g} (--unit)", settings.unit));
      if (settings.noise_lr == kAuto && !has_time(settings.dim)) settings.noise_lr = kNoiseOfDepth;
    }
  } else if (settings.unit != 1 && !free) {
    fail(ErrorKind::usage,
         "cov_param = skew_nd can only be trained in the unit of the data: choose unit = 1");
  }
  // Checks the near and the far plane again, because their automatic values depend on the unit.
  validate(settings);
}

bool has_wide_images(const Split& train) {
  return std::ranges::any_of(train.views, [](const View& view) { return !view.part_of.empty(); });
}

void settle_background(Dataset& data, const Split& train, TrainSettings& settings) {
  Background& behind = settings.background;
  const bool learnt = behind.learnt != Background::Learnt::no;
  const bool colour = !learnt && behind.harmonics.empty();
  const auto transparent = std::ranges::find(train.views, false, &View::opaque);
  const bool opaque = transparent == train.views.end();
  if (!opaque && (!colour || settings.random_background == RandomBackground::on))
    fail(
        ErrorKind::data,
        "{}: the image may be transparent, but a background that is learnt or random requires opaque images: "
        "choose --background R,G,B and --random-background off",
        transparent->name);
  const bool free = opaque && behind.automatic;
  behind.automatic = false;
  if (learnt || free) behind.colour = look_at(train).mean_colour;
  if (settings.random_background == RandomBackground::automatic)
    settings.random_background = opaque && colour ? RandomBackground::on : RandomBackground::off;
  if (free)
    data.report.notes.push_back(fmt::format("background {}: the mean colour of the images (--background){}",
                                            fmt::join(behind.colour, ","),
                                            settings.random_background == RandomBackground::on
                                                ? ", and random colours during training (--random-background)"
                                                : ""));
}

// Adds a note about the initial positions of the splats, for data without points.
void describe_start(Dataset& data, const Split& train, const TrainSettings& settings) {
  std::string where = data.depth_bounds.size() == train.views.size()
                          ? "within the depth range given by the data"
                      : settings.init_extent != kAuto
                          ? fmt::format("within {} of the origin along each axis", settings.init_extent)
                          : space_for(train).text;
  data.report.notes.push_back(fmt::format(
      "the data have no points: splats start at random positions {} (--init-points, --init-extent)", where));
}

}  // namespace

// The number of random splats is a third of the number of pixels of an image, because small images cannot
// determine the positions of many splats. It is at least 100 and at most 100 000. Images with 548 x 548 or
// more pixels get 100 000 splats, which is the published number.
int random_points(const Split& train, const TrainSettings& settings) {
  if (settings.init_points != kAutoInt) return settings.init_points;
  return static_cast<int>(std::clamp(median_pixels(train) / 3, 100.0, 1e5));
}

PictureFacts picture_facts(const Split& train, const TrainSettings& settings) {
  constexpr std::size_t kFewPhotographs = 24;
  const Look look = look_at(train);
  PictureFacts facts{static_cast<std::size_t>(random_points(train, settings)), look.lone_object};
  facts.few_photographs = !look.lone_object && std::ranges::all_of(train.views, &View::opaque) &&
                          train.views.size() <= kFewPhotographs;
  facts.wide_images = has_wide_images(train);
  facts.views = train.views.size();
  facts.pixels = median_pixels(train);
  return facts;
}

std::size_t first_splats(const Dataset& data, const Split& train, const TrainSettings& settings) {
  const std::size_t all =
      data.points ? data.points->positions.size() : static_cast<std::size_t>(random_points(train, settings));
  return std::min(all, static_cast<std::size_t>(settings.cap_max));
}

Split take_train(Dataset& data, TrainSettings& settings, bool begins) {
  const Split* found = data.find("train");
  if (settings.test_every == 1 && (!found || found->views.empty()))
    fail(ErrorKind::usage,
         "{}: --test-every 1 makes every image a test image, so none is left for training: choose 2 or more, "
         "or 0 for no test images",
         data.report.folder);
  Split train = take_split(data, "train");
  if (settings.refine_cameras != RefineCameras::none && still(train)) align(data, train);
  settle_training(train, data, settings, begins);
  return train;
}

void settle_training(const Split& train, Dataset& data, TrainSettings& settings, bool begins) {
  require_images(train);
  require_pixels(train);
  settle_background(data, train, settings);
  if (settings.dim == kAutoInt) {
    const DimChoice choice = choose_dim(train.views);
    settings.dim = choice.dim;
    // Direct conditioning is better for dynamic scenes: it increased the PSNR of five of them by 0.5 to 2.4
    // dB (docs/results/2026-11-22-direct.md).
    const bool direct =
        settings.conditioning_auto && has_time(choice.dim) && settings.variant == ModelVariant{};
    if (direct) settings.variant.conditioning = Conditioning::direct;
    validate(settings);
    data.report.notes.push_back(fmt::format(
        "dim auto: N = {}, {}{}", choice.dim, choice.reason,
        direct ? "; direct conditioning (for the published variant: --conditioning covariance)" : ""));
  }
  settings.conditioning_auto = false;
  if (has_wide_images(train) && !settings.chosen.contains("opacity_reg")) {
    settings.opacity_reg = kWideOpacityReg;
    data.report.notes.push_back(
        "training without opacity penalty, because wide images were split into several views (to use a "
        "penalty: --set opacity_reg=NUMBER)");
  }
  check_query(train, settings.dim);
  if (has_time(settings.dim) && still(train))
    warn(
        "all training views have the same time, so N = {} cannot learn motion: use --dim {} for a static "
        "scene",
        settings.dim, settings.dim >= 6 ? 6 : 3);
  if (at_one_place(cameras_of(train)))
    warn(
        "all training cameras have the same position, so the depth of what they see cannot be learnt: check "
        "the camera poses");
  if (!has_time(settings.dim) && !still(train))
    warn(
        "the training views have different times, but N = {} has no time dimension, so moving objects will "
        "be blurred: use --dim {}",
        settings.dim, settings.dim == 3 ? 4 : 7);
  if (begins && still(train)) place_points(data, train, settings);
  choose_unit(data, train, settings);
  if (!begins) return;
  note_cap(data, settings);
  if (!data.points) describe_start(data, train, settings);
}

Split take_test(Dataset& data, const TrainSettings& settings) {
  if (!data.find("test")) {
    warn("{} has no test split: nothing is measured, and no renders are written", data.report.folder);
    return {"test", {}};
  }
  Split test = take_split(data, "test");
  check_query(test, settings.dim);
  const std::size_t all = test.views.size();
  std::erase_if(test.views, [](const View& view) { return !view.has_image(); });
  if (test.views.size() < all)
    warn("{} of {} test views have no image and are not used", all - test.views.size(), all);
  return test;
}

void divide_by_unit(Dataset& data, std::span<Split* const> splits, double unit) {
  if (unit == 1) return;
  if (data.points) scale_lengths(*data.points, 1 / unit);
  for (auto& [near, far] : data.depth_bounds) near /= unit, far /= unit;
  for (Split* split : splits) scale_lengths(*split, 1 / unit);
}

ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras) {
  TrainSettings copy = settings;
  copy.near_plane = planes_of(settings).near;
  copy.far_plane = planes_of(settings).far;
  std::vector<std::pair<std::string, std::string>> drawing;
  for (const FieldValue& field : bind_fields(copy, train_fields()))
    if (field.uses & kOfDrawing) drawing.emplace_back(field.key, field_text(field));
  return make_notes(std::move(drawing), cameras);
}

std::vector<std::string> model_comments(const Dataset& data, const TrainSettings& settings,
                                        std::span<const Camera> cameras) {
  std::vector<std::string> comments;
  if (data.offset != std::array<double, 3>{}) comments.push_back(make_offset_comment(data.offset));
  std::ranges::copy(comments_of(notes_for(settings, cameras)), std::back_inserter(comments));
  return comments;
}

SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& s) {
  InitOptions init = init_options(s);
  const std::size_t points = first_splats(data, train, s);
  const auto from = [&](const PointCloud& cloud) {
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  };
  if (data.points) return from(thinned(*data.points, static_cast<std::size_t>(s.cap_max)));
  if (data.depth_bounds.size() == train.views.size())
    return from(sample_frusta(train.views, data.depth_bounds, points, s.seed));
  if (s.init_extent != kAuto) return initialise_random(s.dim, points, s.seed, init);
  const InitialSpace space = space_for(train);
  if (space.half > 0) {
    init.centre = space.centre;
    init.box = space.half;
    return initialise_random(s.dim, points, s.seed, init);
  }
  // Maximum number of views that random points are placed in, because the images of these views must be
  // decoded.
  constexpr std::size_t kViews = 256;
  const std::size_t step = train.views.size() / kViews + 1;
  std::vector<View> some;  // copies of every `step`-th view; empty if all views are used
  for (std::size_t v = 0; step > 1 && v < train.views.size(); v += step) some.push_back(train.views[v]);
  const std::span<const View> views = step > 1 ? some : train.views;
  const std::vector<std::array<double, 2>> bounds(views.size(), {space.near, space.far});
  PointCloud cloud = sample_frusta(views, bounds, 2 * points, s.seed, PointColours::pixels);
  leave_room(cloud, views, space.near);
  return from(thinned(std::move(cloud), points));
}

}  // namespace ubs
