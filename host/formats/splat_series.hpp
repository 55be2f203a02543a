// SPDX-License-Identifier: Apache-2.0
// SplatSeries contains the Gaussians of several time samples of a dynamic model, for formats that store all
// samples in one file. Readers of such files interpolate the values of two successive time samples if both
// have the same number of splats; otherwise they show each time sample until the next one begins. finish()
// prepares the time samples for interpolation, and keep_apart() prevents interpolation.
#pragma once

#include <span>
#include <vector>

#include "host/formats/imported_splats.hpp"

namespace ubs {

class SplatSeries {
 public:
  SplatSeries() = default;
  // `moments` contains the time samples, at least one. All of them must have the same degree of the spherical
  // harmonics and the same offset.
  explicit SplatSeries(std::vector<ImportedSplats> moments);

  // Adds the next time sample. If its spherical harmonics equal those of the first time sample, they are not
  // stored again.
  void add(ImportedSplats splats);

  // Prepares time samples in which splat i is the same splat at all times.
  // Drops the splats whose opacity is below `least_opacity` at all time samples. If a splat is invisible at a
  // time sample, its position and shape are copied from the nearest time sample at which it is visible,
  // because the position and the shape that a dynamic model gives for an invisible splat are meaningless.
  // Permutes the axes of a splat, or changes the sign of its quaternion, if this makes the quaternion closer
  // to that of the previous time sample. Returns false and changes nothing if the numbers of splats differ.
  bool finish(float least_opacity);

  // Prepares time samples whose splats do not correspond, for example because they were trained separately.
  // If a time sample has as many splats as the previous one, an invisible splat is added to it, so that
  // readers do not interpolate.
  void keep_apart();

  std::size_t size() const { return moments_.size(); }
  std::span<const ImportedSplats> moments() const { return moments_; }
  // Returns a time sample with its spherical harmonics.
  ImportedSplats moment(std::size_t moment) const;
  // Returns the spherical harmonics of a time sample. They may be stored in the first time sample (see
  // add()).
  static const std::vector<float>& sh(std::span<const ImportedSplats> moments, std::size_t moment);
  const std::vector<float>& sh(std::size_t moment) const { return sh(moments_, moment); }
  // Returns the largest number of splats of a time sample.
  std::size_t largest_count() const;

 private:
  std::vector<ImportedSplats> moments_;
};

}  // namespace ubs
