// SPDX-License-Identifier: Apache-2.0
// The unit of length in which a scene is trained (method.md 4.4). Data come in any unit: metres, or whatever
// structure from motion chose. Training has absolute numbers (the softplus of scales, the noise of positions,
// the near plane). So cameras and points are divided by a length of the scene's own before training, and the
// model is multiplied by it afterwards.
#pragma once

#include <optional>
#include <span>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// The depth at which cameras see points: the median over the cameras of the median over the points in their
// image. Nothing where no camera sees at least ten.
std::optional<double> median_depth(std::span<const Camera> cameras, const PointCloud& points);

// Whether the model can be multiplied by a length: not with cov_param skew_nd, whose one matrix joins lengths
// and query values.
bool has_free_unit(const ModelVariant& variant);

// Multiplies all lengths by `factor` > 0. Positions and scales change, and with cov_param cholesky the part
// of the factor between positions; the model draws the same images from the scaled cameras.
void scale_lengths(SplatModel& model, double factor);
void scale_lengths(Camera& camera, double factor);
void scale_lengths(PointCloud& points, double factor);
void scale_lengths(Split& split, double factor);

// The settings for data that are divided by settings.unit. An automatic one is 1.
TrainSettings in_unit(TrainSettings settings);
// The same views, with cameras divided by `unit`. Images in memory are not copied: `split` must outlive them.
Split in_unit(const Split& split, double unit);

}  // namespace ubs
