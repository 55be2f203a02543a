// SPDX-License-Identifier: Apache-2.0
#include "host/run/facts_of.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "host/base/error.hpp"
#include "host/base/median.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/align_cameras.hpp"
#include "host/dataset/triangulate.hpp"
#include "host/run/open_data.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/scene/camera_rig.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/settle.hpp"

namespace ubs {
namespace {

// Ratio of the brightness of images above which training logs a warning. In measurements, the ratio was at
// most 1.03 for cameras with a fixed exposure, and 1.17 to 1.36 if the exposures differed by up to 0.8 stops
// from their mean (docs/results/2026-11-28-uneven-exposure.md).
constexpr double kUnevenBrightness = 1.1;

// At most this many photographs count as few.
constexpr std::size_t kFewPhotographs = 24;

double median_pixels(const Split& train) {
  std::vector<double> pixels;
  for (const View& view : train.views) pixels.push_back(1.0 * view.camera.width * view.camera.height);
  return median(std::move(pixels));
}

// Properties of the pixels of the training images.
struct Look {
  // True if almost all pixels at the borders of the images have the same colour, which is typical of images
  // that show a single object in front of a plain background.
  bool plain_background = false;
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
  look.plain_background =
      outermost > 0 && static_cast<double>(same) >= kPlain * static_cast<double>(outermost);
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

// Returns whether the scene counts as dynamic: the views have different times.
bool moves(const Split& train) {
  return std::ranges::any_of(train.views,
                             [&](const View& v) { return v.camera.time != train.views[0].camera.time; });
}

// Points are triangulated from one image for every kPointsAnImage points that are wanted (setting
// find_points), but from at least kLeastCompared and at most kMostCompared images
// (docs/results/2026-11-29-time-before-training.md).
constexpr double kPointsAnImage = 600, kLeastCompared = 40, kMostCompared = 120;

// Triangulates points from the images of a static scene and adds them to the points of the data
// (docs/results/2026-11-22-placed-points.md).
void place_points(Dataset& data, const Split& train, const TrainSettings& asked) {
  constexpr std::size_t kMinCorners = 500;
  constexpr double kPixelsAPoint = 4;  // pixels of an image per pixel that gets a depth, at least
  const double wanted = points_to_find(asked, moves(train));
  if (wanted == 0) return;
  const auto images =
      static_cast<std::size_t>(std::clamp(wanted / kPointsAnImage, kLeastCompared, kMostCompared));
  const auto between = static_cast<std::size_t>(std::min(wanted, median_pixels(train) / kPixelsAPoint));
  const Triangulation found = triangulate(train.views, images, between, asked.seed);
  if (found.brightness_ratio > kUnevenBrightness && asked.appearance == Appearance::none)
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

// Returns where the splats are placed if there are no points.
std::string start_text(const Dataset& data, const Split& train, const TrainSettings& asked,
                       bool plain_background) {
  if (data.depth_bounds.size() == train.views.size()) return "within the depth range given by the data";
  if (asked.init_extent != kAuto)
    return fmt::format("within {} of the origin along each axis", asked.init_extent);
  return initial_space(cameras_of(train), plain_background).text;
}

}  // namespace

void align(Dataset& data, Split& train) {
  if (moves(train)) return;
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

// The number of random splats is a third of the number of pixels of an image, because small images cannot
// determine the positions of many splats. It is at least 100 and at most 100 000. Images with 548 x 548 or
// more pixels get 100 000 splats, which is the published number.
Facts facts_of(Dataset& data, const Split& train, const TrainSettings& asked, bool begins) {
  require_images(train);
  require_pixels(train);
  if (begins) place_points(data, train, asked);
  const Look look = look_at(train);
  const auto transparent = std::ranges::find(train.views, false, &View::opaque);
  Facts facts;
  facts.views = train.views.size();
  facts.pixels = median_pixels(train);
  facts.dim = choose_dim(train.views);
  facts.moves = moves(train);
  facts.one_place = at_one_place(cameras_of(train));
  facts.depth = typical_depth(data, train);
  facts.points = data.points ? data.points->positions.size() : 0;
  facts.random_points = static_cast<std::size_t>(std::clamp(facts.pixels / 3, 100.0, 1e5));
  facts.transparent = transparent == train.views.end() ? "" : transparent->name;
  facts.mean_colour = look.mean_colour;
  facts.plain_background = look.plain_background;
  facts.few_images = !look.plain_background && facts.opaque() && facts.views <= kFewPhotographs;
  facts.wide_images =
      std::ranges::any_of(train.views, [](const View& view) { return !view.part_of.empty(); });
  if (facts.points == 0) facts.start = start_text(data, train, asked, facts.plain_background);
  return facts;
}

}  // namespace ubs
