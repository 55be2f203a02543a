// SPDX-License-Identifier: Apache-2.0
#include "host/settings/work_share.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {

WorkShare::WorkShare(const TrainSettings& settings) {
  SharePoint from;
  for (const SharePoint& point : share_points(settings)) {
    pieces_.push_back({from, point, reached(from, point)});
    from = pieces_.back().end;
    if (point.left_at > 0) left_.push_back(pieces_.back());
  }
  const SharePoint end{settings.iterations, 1};
  pieces_.push_back({from, end, end});
  if (const Piece& first = pieces_.front(); first.to.share == 1) {
    steps_ = first.to.iteration;
    counted_ = first.end.iteration;
  }
}

const WorkShare::Piece& WorkShare::piece_of(int iteration) const {
  const auto piece =
      std::ranges::lower_bound(pieces_, iteration, {}, [](const Piece& p) { return p.end.iteration; });
  return piece == pieces_.end() ? pieces_.back() : *piece;
}

double WorkShare::at(int iteration) const {
  const auto& [from, to, end] = piece_of(iteration);
  if (iteration >= to.iteration) return to.share;
  return from.share +
         (to.share - from.share) * (iteration - from.iteration) / (to.iteration - from.iteration);
}

double WorkShare::steps_at(int iteration) const {
  return iteration <= counted_ ? iteration : steps_ * at(iteration);
}

int WorkShare::Piece::iteration_at(double share) const {
  if (to.iteration <= from.iteration) return to.iteration;  // the run was continued after its end
  const double part = (share - from.share) / (to.share - from.share);
  const auto nearest = from.iteration + std::llround(part * (to.iteration - from.iteration));
  // The iteration `from.iteration` belongs to the previous piece, so the result must be larger.
  return std::max(static_cast<int>(nearest), from.iteration > 0 ? from.iteration + 1 : 0);
}

int WorkShare::iteration_at(double steps) const {
  if (steps <= counted_) return static_cast<int>(std::llround(steps));
  const double share = steps / steps_;
  // If a piece ended before its point, its last iteration may be the nearest one to a larger share that the
  // piece did not reach. The run used this result while it was in the piece, so the result must remain the
  // same.
  for (const Piece& piece : left_)
    if (share > piece.from.share && share <= piece.to.share)
      if (const int nearest = piece.iteration_at(share); nearest <= piece.end.iteration) return nearest;
  const auto piece = std::ranges::find_if(pieces_, [&](const Piece& p) { return p.end.share >= share; });
  return (piece == pieces_.end() ? pieces_.back() : *piece).iteration_at(share);
}

double WorkShare::iterations_per_share(int iteration) const {
  iteration = std::min(iteration, pieces_.back().to.iteration);
  // When a run is continued after its end, the share decreases in one iteration, for which there is no speed.
  // Use the speed of the next iteration.
  if (const Piece& piece = piece_of(iteration); piece.to.share < piece.from.share) ++iteration;
  const auto& [from, to, end] = piece_of(iteration);
  return (to.iteration - from.iteration) / (to.share - from.share);
}

}  // namespace ubs
