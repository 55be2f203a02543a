// SPDX-License-Identifier: Apache-2.0
// TrainedSplats holds what a training changes of its splats: parameters on the device, their gradients, and
// the two moments of Adam. It also moves and adds splats (method.md 4.3). This class is for one process,
// which holds all splats. SharedSplats (shared_splats.hpp) holds the part of one of several ranks; then all
// ranks make the same calls.
#pragma once

#include <cstdint>

#include "host/pipeline/device_model.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

class TrainedSplats {
 public:
  // `initial`: the splats that this process holds at the start; `capacity`: the most that it will hold.
  TrainedSplats(Device& device, Stages& stages, const SplatModel& initial, std::size_t capacity);
  virtual ~TrainedSplats() = default;
  TrainedSplats(const TrainedSplats&) = delete;
  TrainedSplats& operator=(const TrainedSplats&) = delete;

  // The splats of this process.
  DeviceModel& model() { return model_; }
  const DeviceModel& model() const { return model_; }
  SplatView view() const { return model_.view(); }
  // (trained rows, model().stride()) each.
  BufferView<float> v_params() const { return v_params_.view(); }
  BufferView<float> moment1() const { return moment1_.view(); }
  BufferView<float> moment2() const { return moment2_.view(); }

  virtual std::uint32_t total() const { return model_.count(); }  // of all ranks
  virtual std::uint32_t first() const { return 0; }  // how many splats the ranks before this one hold

  // Moves dead splats to living ones; returns how many of all ranks were moved.
  virtual std::uint32_t relocate(std::uint64_t seed, std::uint64_t iteration);
  // Adds copies of living splats until there are `target` in total.
  virtual void grow(std::uint32_t target, std::uint64_t seed, std::uint64_t iteration);

  // Returns all splats; on other ranks than the first an empty model.
  virtual SplatModel download() const { return model_.download(); }
  // Fills in model and moments: those of this process, or with `everywhere` those of all ranks.
  virtual void save(TrainState& state, bool everywhere) const;
  // Takes them from a state that has all splats.
  virtual void load(const TrainState& state);

 protected:
  Stages& stages_;
  DeviceModel model_;
  Buffer<float> v_params_, moment1_, moment2_;
};

}  // namespace ubs
