// SPDX-License-Identifier: Apache-2.0
#include "host/check/stage_run.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"
#include "kernels/layout.h"

namespace ubs::check {
namespace {

template <typename T>
std::vector<T> read(Device& device, const BufferView<T>& view, std::size_t count) {
  std::vector<T> values(count);
  device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}
template <typename T>
void write(Device& device, const BufferView<T>& view, std::span<const T> values) {
  device.write(*view.memory, 0, std::as_bytes(values));
}

// Fields describes a quantity in the record of a splat: `count` values from index `first` on.
struct Fields {
  const char* name;
  std::size_t first, count;
};
constexpr Fields kRecordFields[] = {{"mean", kSplatX, 2},          {"conic factor", kSplatL00, 3},
                                    {"opacity", kSplatOpacity, 1}, {"beta", kSplatBeta, 1},
                                    {"colour", kSplatR, 3},        {"depth", kSplatDepth, 1}};
constexpr Fields kGradientFields[] = {{"mean", kGradX, 2},
                                      {"ellipse", kGradW00, 3},
                                      {"opacity", kGradOpacity, 1},
                                      {"beta", kGradBeta, 1},
                                      {"colour", kGradR, 3}};

bool has_field(const Fields& fields, const ModelVariant& variant) {
  return std::string_view(fields.name) != "beta" || variant.has_spatial_beta();
}

}  // namespace

StageRun::StageRun(Device& device, const KernelConfig& config, const Problem& problem)
    : device_(device),
      problem_(problem),
      stages_(make_stages(device, config)),
      model_(device, problem.model),
      renderer_(device, stages_),
      target_(device, "target image", problem.target.size()),
      sums_(device, "loss sums", 8),
      v_params_(device, "parameter gradients", static_cast<std::size_t>(model_.rows()) * model_.stride()) {
  settings_.projection = {static_cast<float>(problem.near_plane), static_cast<float>(problem.far_plane),
                          static_cast<float>(problem.eps2d)};
  settings_.background = problem.background;
  renderer_.set_cameras({problem.camera});
  target_.upload(problem.target);
  run_whole();
}

void StageRun::run_whole() { run(stages_.config().backward ? "iteration" : "forward"); }

void StageRun::iteration() {
  renderer_.forward(model_.view(), 0, settings_, true);
  stages_.image_loss({.shape = renderer_.shape(),
                      .image = renderer_.image(),
                      .target = {},
                      .target_float = target_.view(),
                      .weights = problem_.loss,
                      .v_image = renderer_.v_image(),
                      .sums = sums_.view()});
  renderer_.backward(v_params_.view(), false);
}

void StageRun::run(const std::string& stage) {
  if (stage == "forward") {
    renderer_.forward(model_.view(), 0, settings_, stages_.config().backward);
  } else if (stage == "iteration") {
    iteration();
  } else if (stage == "lists + raster_forward") {
    stages_.repeat<CountLists>();
    stages_.repeat<BuildLists>();
    stages_.repeat<RasterForward>();
  } else if (stage == "raster_backward") {
    stages_.repeat<RasterBackward>();
    stages_.repeat<SumSlots>();
  } else if (const Operation* last = stages_.last(stage)) {
    stages_.real().run(*last);
  } else {
    fail(ErrorKind::internal, "unknown stage '{}'", stage);
  }
  device_.finish();
}

std::vector<float> StageRun::read_planes(BufferView<float> from) const {
  const ImageShape shape = renderer_.shape();
  return cropped_planes(read(device_, from, 3 * shape.plane()), shape);
}

void StageRun::write_planes(BufferView<float> to, std::span<const float> planes) {
  write<float>(device_, to, padded_planes(planes, renderer_.shape()));
}

std::vector<float> StageRun::image() const { return read_planes(renderer_.image()); }
std::vector<float> StageRun::gradient() const {
  return download_rows(v_params_, model_.layout(), model_.count(), model_.stride()).values;
}
double StageRun::loss() const { return loss_value(problem_.loss, sums_.download()); }

std::vector<float> StageRun::gradient_of(std::span<const double> v_image) {
  renderer_.forward(model_.view(), 0, settings_, true);
  write_planes(renderer_.v_image(), std::vector<float>(v_image.begin(), v_image.end()));
  renderer_.backward(v_params_.view(), false);
  return gradient();
}

StageErrors StageRun::projection_errors(const StageTruth& truth) {
  stages_.repeat<ProjectForward>();
  const std::size_t count = model_.count();
  const auto records = read(device_, stages_.last<ProjectForward>().records, kSplatStride * count);
  const auto drawn = read(device_, stages_.last<ProjectForward>().tile_counts, count);
  StageErrors out{"project_forward", {}};
  for (const Fields& fields : kRecordFields) {
    if (!has_field(fields, problem_.model.variant)) continue;
    ErrorSum sum;
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t k = fields.first; drawn[i] > 0 && truth.visible[i] && k < fields.first + fields.count;
           ++k)
        sum.add(records[kSplatStride * i + k], truth.records[kSplatStride * i + k]);
    out.quantities.push_back({fields.name, sum.errors()});
  }
  return out;
}

// Returns the errors of the lists and the rasteriser. The lists use the tiles of each splat that the device
// has computed, because these tiles include a margin around the splat that StageTruth does not define.
StageErrors StageRun::raster_forward_errors(const StageTruth& truth) {
  const std::vector<float> records = rounded(truth.records);
  write<float>(device_, stages_.last<ProjectForward>().records, records);
  auto keys = read(device_, stages_.last<ProjectForward>().depth_keys, model_.count());
  for (std::size_t i = 0; i < keys.size(); ++i)
    if (keys[i] != UBS_KEY_CULLED && truth.visible[i])
      keys[i] = std::bit_cast<std::uint32_t>(records[kSplatStride * i + kSplatDepth]);
  write<std::uint32_t>(device_, stages_.last<ProjectForward>().depth_keys, keys);
  stages_.repeat<CountLists>();
  stages_.repeat<BuildLists>();
  stages_.repeat<RasterForward>();
  ErrorSum sum;
  sum.add(image(), truth.image, problem_.undecided);
  return {"lists + raster_forward", {{"image", sum.errors()}}};
}

StageErrors StageRun::loss_errors(const StageTruth& truth) {
  write_planes(renderer_.image(), rounded(truth.image));
  stages_.repeat<ImageLoss>();
  ErrorSum gradient, value;
  gradient.add(read_planes(renderer_.v_image()), truth.v_image);
  value.add(loss(), truth.loss);
  return {"image_loss", {{"loss", value.errors()}, {"image gradient", gradient.errors()}}};
}

StageErrors StageRun::raster_backward_errors(const StageTruth& truth) {
  write_planes(renderer_.image(), rounded(truth.image));
  write_planes(renderer_.v_image(), rounded(truth.v_image));
  stages_.repeat<RasterBackward>();
  stages_.repeat<SumSlots>();
  const std::vector<float> v = read(device_, stages_.last<SumSlots>().v_records,
                                    static_cast<std::size_t>(model_.count()) * kGradStride);
  StageErrors out{"raster_backward", {}};
  // A device may treat a denormal opacity as 0 and skip the splat, so such splats are not compared.
  const auto decided = [&](std::size_t i) {
    return std::fpclassify(static_cast<float>(truth.records[kSplatStride * i + kSplatOpacity])) !=
           FP_SUBNORMAL;
  };
  for (const Fields& fields : kGradientFields) {
    if (!has_field(fields, problem_.model.variant)) continue;
    ErrorSum sum;
    for (std::size_t i = 0; i < model_.count(); ++i)
      for (std::size_t k = fields.first; decided(i) && k < fields.first + fields.count; ++k)
        sum.add(v[i * kGradStride + k], truth.v_records[i * kGradStride + k]);
    out.quantities.push_back({fields.name, sum.errors()});
  }
  return out;
}

ProjectBackward StageRun::given_to_projection(const StageTruth& truth) {
  write<float>(device_, stages_.last<ProjectBackward>().v_records, rounded(truth.v_records));
  return stages_.last<ProjectBackward>();
}

StageErrors StageRun::project_backward_errors(const StageTruth& truth) {
  stages_.real().project_backward(given_to_projection(truth));
  return {"project_backward", group_errors(model_.layout(), model_.count(), gradient(), truth.v_params)};
}

std::vector<StageErrors> StageRun::stage_errors(const StageTruth& truth) {
  run_whole();
  std::vector<StageErrors> all;
  all.push_back(projection_errors(truth));
  all.push_back(raster_forward_errors(truth));
  if (!stages_.config().backward) {
    run_whole();
    return all;
  }
  all.push_back(loss_errors(truth));
  all.push_back(raster_backward_errors(truth));
  all.push_back(project_backward_errors(truth));
  run_whole();
  return all;
}

}  // namespace ubs::check
