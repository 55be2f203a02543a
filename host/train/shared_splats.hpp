// SPDX-License-Identifier: Apache-2.0
// The splats of a training that the ranks of a job share (host/cluster/share.hpp): each rank's part lies in a
// model and moments of its own. Relocation and growth of method.md 4.3 over all parts, with the draws and the
// bits of Stages::relocate and grow. All ranks call the same.
#pragma once

#include <array>

#include "host/cluster/communicator.hpp"
#include "host/cluster/share.hpp"
#include "host/pipeline/device_model.hpp"

namespace ubs {

class SharedSplats {
 public:
  // `model` holds this rank's share of `total` splats.
  SharedSplats(Communicator& ranks, Device& device, Stages& stages, DeviceModel& model,
               Buffer<float>& moment1, Buffer<float>& moment2, std::uint32_t total);

  std::uint32_t total() const { return total_; }  // of all ranks
  Share share() const { return share_of(total_, ranks_.size(), ranks_.rank()); }

  std::uint32_t relocate(std::uint64_t seed, std::uint64_t iteration);  // how many were moved
  // Parts are cut anew.
  void grow(std::uint32_t target, std::uint64_t seed, std::uint64_t iteration);
  // The parts were set from outside.
  void set_total(std::uint32_t total) { total_ = total; }

  // Rows of all splats without padding, on the first rank or on all; empty on the others.
  std::vector<float> gather(const Buffer<float>& part, bool everywhere) const;

 private:
  struct Draw {
    std::uint32_t purpose;
    bool alive_only;
    std::uint64_t seed, iteration;
  };
  struct Slot {
    std::uint32_t place, number;  // in this rank's part; of the draw
  };
  // The slots of all ranks; how many of them got a source.
  std::uint32_t replace(const Draw& draw, const std::vector<std::uint32_t>& weights,
                        std::span<const Slot> slots);
  std::vector<std::uint32_t> weigh(bool alive_only);
  std::vector<Bytes> answer(const std::vector<Bytes>& tickets, const std::vector<std::uint32_t>& weights);
  void fill(std::span<const Slot> slots, std::span<const std::size_t> owners,
            const std::vector<Bytes>& columns);
  void move_parts(std::uint32_t target);
  std::size_t rows_of(const Buffer<float>& part) const { return part.size() / model_.stride(); }
  std::vector<float> row(const Buffer<float>& part, std::size_t row, std::uint32_t count) const;

  Communicator& ranks_;
  Stages& stages_;
  DeviceModel& model_;
  std::array<Buffer<float>*, 3> parts_;  // parameters, two moments
  std::uint32_t total_;
  Buffer<std::uint32_t> weights_, copy_counts_;
};

// Splats of a model; of rows in its layout without padding.
SplatModel part_of(const SplatModel& model, const Share& share);
std::vector<float> part_of(std::span<const float> rows, std::size_t count, const Share& share);

}  // namespace ubs
