// SPDX-License-Identifier: Apache-2.0
#include "host/look/serve/painter.hpp"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/png.hpp"

namespace ubs::serve {
namespace {

constexpr int kQuality = 90;

}  // namespace

Outcome Painter::Bounded::run(const Operation& operation) {
  Outcome outcome = stages_.run(operation);
  const auto* count = std::get_if<CountLists>(&operation);
  // If the totals stay in device memory, the lists keep their allocated size, so there is no limit to check.
  if (count == nullptr || count->totals.memory != nullptr) return outcome;
  if (const auto& totals = std::get<ListTotals>(outcome); totals.intersections > most)
    fail(ErrorKind::memory,
         "the view is too expensive to render, because its {} splats have {} intersections with tiles of "
         "the image: move the camera farther away",
         totals.visible, totals.intersections);
  return outcome;
}

Painter::Painter(Device& device, Stages& stages, const RenderSettings& settings)
    : stages_(stages), renderer_(device, stages_), settings_(settings) {}

Image8 Painter::image(std::span<const RenderGroup> groups, const Camera& camera, std::uint64_t most) {
  stages_.most = most;
  renderer_.set_cameras({camera});
  renderer_.forward(groups, 0, settings_, false);
  const RenderedView view = renderer_.download();
  return image_from_interleaved(view.rgb, view.width, view.height);
}

std::string Painter::draw(std::span<const RenderGroup> groups, const Camera& camera, bool exact,
                          std::uint64_t most) {
  Image8 image = this->image(groups, camera, most);
  if (exact) {  // encode the image like all PNG files that ubs writes
    const auto file = encode_png({image.width, image.height}, image.rgb.data());
    return {reinterpret_cast<const char*>(file.data()), file.size()};
  }
  cv::Mat pixels(image.height, image.width, CV_8UC3, image.rgb.data());
  cv::cvtColor(pixels, pixels, cv::COLOR_RGB2BGR);
  std::vector<std::uint8_t> bytes;
  if (!opencv().imencode(".jpg", pixels, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality}))
    fail(ErrorKind::internal, "an image of {} x {} pixels cannot be encoded", image.width, image.height);
  return {bytes.begin(), bytes.end()};
}

}  // namespace ubs::serve
