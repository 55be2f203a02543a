// SPDX-License-Identifier: Apache-2.0
// SplatSeries contains the Gaussians of several time samples of a dynamic model, for formats that store them
// in one file. Readers of such files interpolate the values of two time samples if both have the same number
// of splats; otherwise they show each time sample until the next one begins. finish() prepares the time
// samples for interpolation, and keep_apart() prevents interpolation.
#pragma once

#include <span>
#include <vector>

#include "host/data/imported_splats.hpp"

namespace ubs {

class SplatSeries {
 public:
  SplatSeries() = default;
  // `moments`: at least one time sample, all with the same degree of harmonics and the same offset.
  explicit SplatSeries(std::vector<ImportedSplats> moments);

  // Adds the next time sample. Its harmonics are not stored again if they equal those of the first one.
  void add(ImportedSplats splats);

  // Prepares time samples in which splat i is the same splat at all times.
  // Drops the splats whose opacity is below `least_opacity` at all time samples. If a splat is invisible at a
  // time sample, it gets its position and shape of the nearest time sample at which it is visible, because
  // the values of a dynamic model are meaningless for a splat outside of its time. Permutes the axes of a
  // splat, or changes the sign of its quaternion, if this makes the quaternion closer to that of the previous
  // time sample.
  // Returns false and changes nothing if the numbers of splats differ.
  bool finish(float least_opacity);

  // Prepares time samples whose splats do not correspond, such as those that were trained separately. If a
  // time sample has as many splats as the previous one, adds an invisible splat to it, so that readers do not
  // interpolate.
  void keep_apart();

  std::size_t size() const { return moments_.size(); }
  std::span<const ImportedSplats> moments() const { return moments_; }
  // Returns the harmonics of a time sample. If they equal those of the first one, they are stored only there.
  static const std::vector<float>& sh(std::span<const ImportedSplats> moments, std::size_t moment);
  const std::vector<float>& sh(std::size_t moment) const { return sh(moments_, moment); }
  // Returns the number of splats of the time sample that has the most.
  std::size_t largest_count() const;

 private:
  std::vector<ImportedSplats> moments_;
};

}  // namespace ubs
