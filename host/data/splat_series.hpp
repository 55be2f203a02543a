// SPDX-License-Identifier: Apache-2.0
// SplatSeries holds the Gaussians of several moments of a model that moves, for formats that store them in
// one file. Readers of such files interpolate between two moments, number by number, if both have the same
// number of splats, and otherwise show each moment until the next one begins. finish() prepares the moments
// for the first case, keep_apart() for the second.
#pragma once

#include <span>
#include <vector>

#include "host/data/imported_splats.hpp"

namespace ubs {

class SplatSeries {
 public:
  SplatSeries() = default;
  // `moments`: one or more, of the same degree of harmonics and the same offset.
  explicit SplatSeries(std::vector<ImportedSplats> moments);

  // Adds the next moment. Its harmonics are not stored again if they equal those of the first moment.
  void add(ImportedSplats splats);

  // For moments whose splat i is the same splat at all times. Drops the splats whose opacity is below
  // `least_opacity` at all moments. A splat that is invisible at some moments gets its place and shape of the
  // nearest moment at which it is visible, because a model that moves says nothing sensible about a splat
  // outside of its time. Axes are renamed where another order of them, or another sign of the quaternion, is
  // nearer to that of the moment before. Returns false and changes nothing if the numbers of splats differ.
  bool finish(float least_opacity);

  // For moments whose splats do not belong together, such as moments that were trained separately. Adds an
  // invisible splat to a moment that has as many splats as the one before.
  void keep_apart();

  std::size_t size() const { return moments_.size(); }
  std::span<const ImportedSplats> moments() const { return moments_; }
  // Returns the harmonics of a moment, which may be stored at the first one.
  static const std::vector<float>& sh(std::span<const ImportedSplats> moments, std::size_t moment);
  const std::vector<float>& sh(std::size_t moment) const { return sh(moments_, moment); }
  // Returns the largest number of splats of a moment.
  std::size_t largest_count() const;

 private:
  std::vector<ImportedSplats> moments_;
};

}  // namespace ubs
