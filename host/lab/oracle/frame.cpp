// SPDX-License-Identifier: Apache-2.0
#include "host/lab/oracle/frame.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ubs::oracle {
namespace {

constexpr double kRoom = 1.05, kRoomPx = 0.05;  // margins of the bounding boxes: a factor, and a length [px]

void check(const Model& model, const Camera& camera, const Options& options) {
  const Rows rows(model.dim, options.variant);
  if (model.values.size() != static_cast<std::size_t>(rows.count) * model.count)
    throw std::invalid_argument("oracle: the number of values does not match dim and count of the model");
  if (camera.width <= 0 || camera.height <= 0) throw std::invalid_argument("oracle: the image has no pixels");
}

}  // namespace

std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat) {
  std::vector<double> raw(rows.count);
  for (int r = 0; r < rows.count; ++r) raw[r] = model.values[r * model.count + splat];
  return raw;
}

std::vector<Footprint<double>> project(const Model& model, const Camera& camera, const Options& options) {
  check(model, camera, options);
  const Rows rows(model.dim, options.variant);
  std::vector<Footprint<double>> all(model.count);
  for (std::size_t i = 0; i < model.count; ++i)
    all[i] = footprint<double>(splat_parameters(model, rows, i), rows, camera, options);
  return all;
}

Frame::Frame(const Model& model, const Camera& camera, const Options& options)
    : Frame(project(model, camera, options), options) {}

// Sorts front to back by the depth rounded to float, and by index if these depths are equal. This is the
// order in which a single-precision renderer sorts.
Frame::Frame(const std::vector<Footprint<double>>& all, const Options& options) {
  const double end = limits_of(options.variant.kernel).support;
  std::vector<std::pair<float, std::size_t>> order;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].visible) {
      order.emplace_back(static_cast<float>(all[i].depth), i);
    } else {
      culled.push_back(all[i]);
      culled_splats.push_back(i);
    }
  }
  std::sort(order.begin(), order.end());
  for (const auto& [depth, i] : order) {
    splats.push_back(i);
    footprints.push_back(all[i]);
    half_width.push_back(kRoom * std::sqrt(end * all[i].cov[0]) + kRoomPx);
    half_height.push_back(kRoom * std::sqrt(end * all[i].cov[2]) + kRoomPx);
  }
}

std::vector<int> Frame::reaching_row(double y) const {
  std::vector<int> result;
  for (std::size_t k = 0; k < footprints.size(); ++k)
    if (std::abs(footprints[k].mean[1] - y) <= half_height[k]) result.push_back(static_cast<int>(k));
  return result;
}

void composite(const Frame& frame, const std::vector<int>& candidates, double x, double y,
               const Options& options, Composited& pixel) {
  pixel.list.clear();
  pixel.left_out = 0;
  pixel.closed = 0;
  double transmittance = 1;
  for (int k : candidates) {
    const Footprint<double>& f = frame.footprints[k];
    if (!(std::abs(f.mean[0] - x) <= frame.half_width[k])) continue;
    const double r = kernel_radius<double>(f, x, y);
    if (!reaches(f, r, options.variant.kernel)) continue;
    const double alpha = splat_alpha<double>(f, r, options.variant.kernel);
    if (alpha <= options.alpha_min) {
      ++pixel.left_out;
      continue;
    }
    if (pixel.closed > 0) continue;
    if (transmittance * (1 - alpha) <= kMinTransmittance) {
      pixel.closed = transmittance;
      if (options.alpha_min > 0) continue;  // left_out also counts the splats behind this one
      break;
    }
    transmittance *= 1 - alpha;
    pixel.list.push_back(k);
  }
}

}  // namespace ubs::oracle
