// SPDX-License-Identifier: Apache-2.0
// LossLog stores the results of Stages::image_loss on the device for all views since the last row of log.csv.
// Each draw (a view in an iteration) has one row of eight sums.
#pragma once

#include <span>
#include <vector>

#include "host/base/error.hpp"
#include "host/device/device.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {

class LossLog {
 public:
  LossLog(Device& device, const TrainSettings& settings)
      : rows_(static_cast<std::size_t>(settings.batch) * static_cast<std::size_t>(settings.log_every)),
        weights_(loss_weights(settings)),
        sums_(device, "loss sums", 8 * rows_) {}

  BufferView<float> view() const { return sums_.view(); }
  std::size_t offset(std::uint64_t draw) const { return 8 * (draw % rows_); }
  std::vector<float> download() const { return sums_.download(); }
  void load(const std::vector<float>& sums) {
    if (sums.size() != sums_.size())
      fail(ErrorKind::internal, "the state has {} loss sums instead of {}", sums.size(), sums_.size());
    sums_.upload(sums);
  }
  // Returns the loss of a draw. `sums` is the result of download().
  double loss(const std::vector<float>& sums, std::uint64_t draw) const {
    return loss_value(weights_, std::span(sums).subspan(offset(draw), 8));
  }

 private:
  const std::size_t rows_;
  const LossWeights weights_;
  Buffer<float> sums_;
};

}  // namespace ubs
