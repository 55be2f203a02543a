// SPDX-License-Identifier: Apache-2.0
// TrainedSplats holds the splats on the device during training: their parameters, the gradients, and the two
// moments of Adam. It also relocates and adds splats (method.md 4.3). This class is for a single process,
// which holds all splats. With several ranks, the derived class SharedSplats (shared_splats.hpp) holds the
// splats of one rank, and all ranks must make the same calls.
#pragma once

#include <cstdint>

#include "host/pipeline/device_model.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

class TrainedSplats {
 public:
  // `initial` contains the splats that this process holds at the start. `capacity` is the maximum number of
  // splats that it will hold.
  TrainedSplats(Device& device, Stages& stages, const SplatModel& initial, std::size_t capacity);
  virtual ~TrainedSplats() = default;
  TrainedSplats(const TrainedSplats&) = delete;
  TrainedSplats& operator=(const TrainedSplats&) = delete;

  // These functions return the splats of this process.
  DeviceModel& model() { return model_; }
  const DeviceModel& model() const { return model_; }
  SplatView view() const { return model_.view(); }
  // Each buffer has the shape (trained rows, model().stride()).
  BufferView<float> v_params() const { return v_params_.view(); }
  BufferView<float> moment1() const { return moment1_.view(); }
  BufferView<float> moment2() const { return moment2_.view(); }

  virtual std::uint32_t total() const { return model_.count(); }  // number of splats of all ranks
  virtual std::uint32_t first() const { return 0; }  // number of splats of the ranks before this one

  // Relocates dead splats to the positions of live ones; `spread` is the setting copy_spread. Returns the
  // number of relocated splats of all ranks.
  virtual std::uint32_t relocate(float spread, std::uint64_t seed, std::uint64_t iteration);
  // Adds copies of splats until there are `target` in total.
  virtual void grow(std::uint32_t target, float spread, std::uint64_t seed, std::uint64_t iteration);

  // Returns all splats on the first rank, and an empty model on the other ranks.
  virtual SplatModel download() const { return model_.download(); }
  // Stores the parameters and the moments in `state`. With `everywhere`, these are the data of all splats,
  // otherwise those of this process.
  virtual void save(TrainState& state, bool everywhere) const;
  // Loads the model and the moments from a state that contains all splats.
  virtual void load(const TrainState& state);

 protected:
  Stages& stages_;
  DeviceModel model_;
  Buffer<float> v_params_, moment1_, moment2_;
};

}  // namespace ubs
