// SPDX-License-Identifier: Apache-2.0
// undistort() of lens.hpp: OpenCV resamples.
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"
#include "host/data/lens.hpp"

namespace ubs {

Image8 undistort(const Image8& image, const Undistortion& plan) {
  const Lens& lens = plan.lens;
  if (image.width != lens.width || image.height != lens.height)
    fail(ErrorKind::internal, "image {}x{} for a lens of {}x{}", image.width, image.height, lens.width,
         lens.height);
  cv::Mat map_x(plan.height, plan.width, CV_32F), map_y(plan.height, plan.width, CV_32F);
  for (int j = 0; j < plan.height; ++j)
    for (int i = 0; i < plan.width; ++i) {
      const Ray ray{(i + 0.5 - plan.cx) / lens.fx, (j + 0.5 - plan.cy) / lens.fy, 1};
      const PlanePoint p = project_ray(lens, ray).value_or(PlanePoint{-1, -1});
      map_x.ptr<float>(j)[i] = static_cast<float>(p[0] - 0.5);
      map_y.ptr<float>(j)[i] = static_cast<float>(p[1] - 0.5);
    }
  const cv::Mat source(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data()));
  Image8 result{plan.width, plan.height, {}};
  result.rgb.resize(static_cast<std::size_t>(plan.width) * static_cast<std::size_t>(plan.height) * 3);
  cv::Mat target(plan.height, plan.width, CV_8UC3, result.rgb.data());
  cv::remap(source, target, map_x, map_y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return result;
}

}  // namespace ubs
