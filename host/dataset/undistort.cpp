// SPDX-License-Identifier: Apache-2.0
// undistort() (undistort.hpp) resamples images with OpenCV.
#include "host/dataset/undistort.hpp"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"

namespace ubs {

Image8 undistort(const Image8& image, const Undistortion& plan) {
  const Lens& lens = plan.lens;
  if (image.width != lens.width || image.height != lens.height)
    fail(ErrorKind::internal, "the image has {}x{} pixels, but its lens is for {}x{}", image.width,
         image.height, lens.width, lens.height);
  // If the image shows all directions, its left and right borders meet. So columns from the other border are
  // added on either side, and interpolation continues across the border.
  const int wrapped = lens.formula && lens.formula->all_directions ? std::min(4, image.width) : 0;
  cv::Mat map_x(plan.height, plan.width, CV_32F), map_y(plan.height, plan.width, CV_32F);
  const auto& m = plan.rotation;
  for (int j = 0; j < plan.height; ++j)
    for (int i = 0; i < plan.width; ++i) {
      const double x = (i + 0.5 - plan.cx) / plan.fx, y = (j + 0.5 - plan.cy) / plan.fy;
      const Ray ray{m[0] * x + m[3] * y + m[6], m[1] * x + m[4] * y + m[7], m[2] * x + m[5] * y + m[8]};
      const PlanePoint p = project_ray(lens, ray).value_or(PlanePoint{-1, -1});
      map_x.ptr<float>(j)[i] = static_cast<float>(p[0] - 0.5 + wrapped);
      map_y.ptr<float>(j)[i] = static_cast<float>(p[1] - 0.5);
    }
  cv::Mat source(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data()));
  if (wrapped > 0) {
    cv::Mat padded;
    cv::copyMakeBorder(source, padded, 0, 0, wrapped, wrapped, cv::BORDER_WRAP);
    source = padded;
  }
  Image8 result{plan.width, plan.height, {}};
  result.rgb.resize(static_cast<std::size_t>(plan.width) * static_cast<std::size_t>(plan.height) * 3);
  cv::Mat target(plan.height, plan.width, CV_8UC3, result.rgb.data());
  cv::remap(source, target, map_x, map_y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return result;
}

}  // namespace ubs
