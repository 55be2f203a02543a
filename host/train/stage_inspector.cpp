// SPDX-License-Identifier: Apache-2.0
#include "host/train/stage_inspector.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

constexpr const char* kRecordFields[] = {
    "x",   "y",     "factor 00", "factor 01",     "factor 11",     "opacity", "beta",
    "red", "green", "blue",      "half extent x", "half extent y", "depth"};
constexpr const char* kGradientFields[] = {"x",       "y",    "ellipse 00", "ellipse 01", "ellipse 11",
                                           "opacity", "beta", "red",        "green",      "blue"};
static_assert(kSplatDepth == 12 && kGradB == 9);

// Place of the first value of a record that is not finite; the number of fields when all are.
template <std::size_t kFields>
std::size_t first_bad(const float* record, const char* const (&)[kFields]) {
  std::size_t k = 0;
  while (k < kFields && std::isfinite(record[k])) ++k;
  return k;
}

}  // namespace

void StageInspector::look_at(const ProjectForward& a) {
  const auto records = read_values(device_, a.records, a.records.size);
  const auto tiles = read_values(device_, a.tile_counts, a.tile_counts.size);
  for (std::size_t i = a.first_record; i < a.first_record + std::size_t{a.splats.count}; ++i) {
    if (tiles[i] == 0) continue;
    const std::size_t k = first_bad(&records[i * kSplatStride], kRecordFields);
    if (k == std::size(kRecordFields)) continue;
    finding_ = {"project_forward", fmt::format("{} of its record", kRecordFields[k]),
                static_cast<std::int64_t>(i)};
    return;
  }
}

void StageInspector::look_at_image(const char* stage, const char* what, const BufferView<float>& planes,
                                   const ImageShape& shape) {
  const std::vector<float> values = read_values(device_, planes, planes.size);
  const std::size_t channels = values.size() >= 3 * shape.plane() ? 3 : 1;
  for (std::size_t c = 0; c < channels; ++c)
    for (int y = 0; y < shape.height; ++y)
      for (int x = 0; x < shape.width; ++x)
        if (!std::isfinite(values[c * shape.plane() + static_cast<std::size_t>(y * shape.pitch() + x)])) {
          finding_ = {stage, fmt::format("{} at pixel ({}, {}), channel {}", what, x, y, c), -1};
          return;
        }
}

void StageInspector::look_at(const RasterForward& a) {
  look_at_image("raster_forward", "image", a.image, a.shape);
}

void StageInspector::look_at(const ImageLoss& a) {
  if (a.v_image.size > 0) look_at_image("image_loss", "gradient of the image", a.v_image, a.shape);
  if (finding_) return;
  const std::vector<float> sums = read_values(device_, a.sums, a.sums.size);
  for (std::size_t k = 0; k < 5; ++k)
    if (!std::isfinite(sums[a.sums_offset + k])) finding_ = {"image_loss", fmt::format("sum {}", k), -1};
}

// What a rasteriser leaves in the slots is its own affair; their sum is a gradient on all of them. A value
// that is not finite spoils the splats behind it at its pixels, so that the nearest one is where it began.
void StageInspector::look_at(const SumSlots& a) {
  const auto gradients = read_values(device_, a.v_records, a.v_records.size),
             records = read_values(device_, a.records, a.records.size);
  float nearest = HUGE_VALF;
  for (std::size_t i = 0; i < a.count; ++i) {
    const std::size_t k = first_bad(&gradients[i * kGradStride], kGradientFields);
    const float depth = records[i * kSplatStride + kSplatDepth];
    if (k == std::size(kGradientFields) || !(depth < nearest)) continue;
    nearest = depth;
    finding_ = {"raster_backward", fmt::format("gradient of {} of its record", kGradientFields[k]),
                static_cast<std::int64_t>(i)};
  }
}

void StageInspector::look_at_gradient(const char* stage, const BufferView<float>& v_params,
                                      const SplatView& splats) {
  const std::vector<float> values = read_values(device_, v_params, v_params.size);
  const std::vector<std::string> names = ParameterLayout(config().dim, config().variant).property_names();
  const std::size_t rows = std::min(values.size() / splats.stride, names.size());
  for (std::size_t i = 0; i < splats.count; ++i)
    for (std::size_t r = 0; r < rows; ++r)
      if (!std::isfinite(values[r * splats.stride + i])) {
        finding_ = {stage, "gradient of " + names[r], static_cast<std::int64_t>(i)};
        return;
      }
}

Outcome StageInspector::run(const Operation& operation) {
  Outcome outcome = stages_.run(operation);
  if (finding_) return outcome;
  run_case(
      operation,
      [&](const ProjectBackward& a) { look_at_gradient("project_backward", a.v_params, a.splats); },
      [&](const Regularise& a) { look_at_gradient("regularise", a.v_params, a.splats); },
      [&](const auto& a) {
        if constexpr (requires { this->look_at(a); }) this->look_at(a);
      });
  return outcome;
}

}  // namespace ubs
