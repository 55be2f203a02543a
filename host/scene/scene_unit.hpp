// SPDX-License-Identifier: Apache-2.0
// The functions of this file convert a scene to the unit of length in which it is trained, and back
// (method.md 4.4). Data may have any unit: metres, or an arbitrary unit from structure from motion. But some
// computations of training depend on the unit: the softplus of scales, the noise of positions, and the near
// plane. Therefore cameras and points are divided by a characteristic length of the scene before training,
// and the model is multiplied by it afterwards.
#pragma once

#include <optional>
#include <span>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// Returns the typical depth at which cameras see points: the median, over the cameras, of the median depth of
// the points in their images. Uses at most 256 cameras and 10 000 points, chosen at regular intervals from
// their lists. Returns nothing if none of these cameras sees at least ten of these points.
std::optional<double> median_depth(std::span<const Camera> cameras, const PointCloud& points);

// Returns whether all lengths of a model with this variant can be multiplied by a factor. With cov_param =
// skew_nd this is impossible, because its matrix combines lengths and query values.
bool has_free_unit(const ModelVariant& variant);

// These functions multiply all lengths by `factor` > 0. In a model they change positions and scales. With
// cov_param = cholesky they also change the entries of the Cholesky factor that combine two position axes. If
// a model and its cameras are scaled by the same factor, the rendered images do not change.
void scale_lengths(SplatModel& model, double factor);
void scale_lengths(Camera& camera, double factor);
void scale_lengths(PointCloud& points, double factor);
void scale_lengths(Split& split, double factor);

// Returns the same views with the positions of the cameras divided by `unit`. The returned views refer to the
// images that `split` holds in memory and do not copy them, so `split` must outlive the returned views.
Split in_unit(const Split& split, double unit);

}  // namespace ubs
