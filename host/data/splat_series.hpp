// SPDX-License-Identifier: Apache-2.0
// SplatSeries holds the Gaussians of several moments of a dynamic model, for formats that store them in one
// file. Readers of such files interpolate the values of two moments if both have the same number of splats;
// otherwise they show each moment until the next one begins. finish() prepares the moments for interpolation,
// keep_apart() prevents it.
#pragma once

#include <span>
#include <vector>

#include "host/data/imported_splats.hpp"

namespace ubs {

class SplatSeries {
 public:
  SplatSeries() = default;
  // `moments`: at least one, all with the same degree of harmonics and the same offset.
  explicit SplatSeries(std::vector<ImportedSplats> moments);

  // Adds the next moment. Its harmonics are not stored again if they equal those of the first moment.
  void add(ImportedSplats splats);

  // Prepares moments in which splat i is the same splat at all times.
  // Drops the splats whose opacity is below `least_opacity` at all moments. A splat that is invisible at some
  // moments gets its position and shape of the nearest moment at which it is visible, because the values of a
  // dynamic model are meaningless for a splat outside of its time. Renames axes, or changes the sign of the
  // quaternion, if this is nearer to the previous moment.
  // Returns false and changes nothing if the numbers of splats differ.
  bool finish(float least_opacity);

  // Prepares moments whose splats do not correspond, such as moments that were trained separately. If a
  // moment has as many splats as the previous one, adds an invisible splat to it, so that readers do not
  // interpolate.
  void keep_apart();

  std::size_t size() const { return moments_.size(); }
  std::span<const ImportedSplats> moments() const { return moments_; }
  // Returns the harmonics of a moment. If they equal those of the first moment, they are stored only there.
  static const std::vector<float>& sh(std::span<const ImportedSplats> moments, std::size_t moment);
  const std::vector<float>& sh(std::size_t moment) const { return sh(moments_, moment); }
  // Returns the number of splats of the moment that has the most.
  std::size_t largest_count() const;

 private:
  std::vector<ImportedSplats> moments_;
};

}  // namespace ubs
