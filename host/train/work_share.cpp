// SPDX-License-Identifier: Apache-2.0
#include "host/train/work_share.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {

WorkShare::WorkShare(const TrainSettings& settings)
    : points_(share_points(settings)), iterations_(settings.iterations) {}

WorkShare::Piece WorkShare::piece_before(std::size_t point) const {
  return {point > 0 ? points_[point - 1] : SharePoint{},
          point < points_.size() ? points_[point] : SharePoint{iterations_, 1}};
}

WorkShare::Piece WorkShare::piece_of(int iteration) const {
  const auto next = std::ranges::lower_bound(points_, iteration, {}, &SharePoint::iteration);
  return piece_before(static_cast<std::size_t>(next - points_.begin()));
}

double WorkShare::at(int iteration) const {
  if (points_.empty()) return static_cast<double>(iteration) / iterations_;
  const auto [from, to] = piece_of(iteration);
  if (iteration >= to.iteration) return to.share;
  return from.share +
         (to.share - from.share) * (iteration - from.iteration) / (to.iteration - from.iteration);
}

double WorkShare::steps_at(int iteration) const {
  return points_.empty() ? iteration : kScheduleLength * at(iteration);
}

int WorkShare::iteration_at(double steps) const {
  if (points_.empty()) return static_cast<int>(std::llround(steps));
  const double share = steps / kScheduleLength;
  const auto next = std::ranges::lower_bound(points_, share, {}, &SharePoint::share);
  const auto [from, to] = piece_before(static_cast<std::size_t>(next - points_.begin()));
  if (to.iteration <= from.iteration) return to.iteration;  // after the end of the run
  const double part = (share - from.share) / (to.share - from.share);
  const auto nearest = from.iteration + std::llround(part * (to.iteration - from.iteration));
  // Never return an iteration of the previous piece, which has ended when this piece starts.
  return std::max(static_cast<int>(nearest), from.iteration > 0 ? from.iteration + 1 : 0);
}

double WorkShare::iterations_per_share(int iteration) const {
  if (points_.empty()) return iterations_;
  const auto [from, to] = piece_of(std::min(iteration, iterations_));
  return (to.iteration - from.iteration) / (to.share - from.share);
}

}  // namespace ubs
