// SPDX-License-Identifier: Apache-2.0
// SharedSplats holds one rank's part of the splats that the ranks of an MPI job train together
// (host/cluster/share.hpp). Relocation and growth act on the splats of all ranks. They use the same random
// numbers as Stages::relocate and Stages::grow, and the results are bit-identical.
#pragma once

#include <array>
#include <memory>

#include "host/cluster/communicator.hpp"
#include "host/cluster/share.hpp"
#include "host/train/trained_splats.hpp"

namespace ubs {

class SharedSplats final : public TrainedSplats {
 public:
  // `initial` contains the splats of all ranks. `capacity` is the maximum number of splats of all ranks
  // together.
  SharedSplats(Communicator& ranks, Device& device, Stages& stages, const SplatModel& initial,
               std::size_t capacity);

  std::uint32_t total() const override { return total_; }
  std::uint32_t first() const override { return share().first; }
  std::uint32_t relocate(float spread, std::uint64_t seed, std::uint64_t iteration) override;
  // Adds splats and redistributes all splats over the ranks.
  void grow(std::uint32_t target, float spread, std::uint64_t seed, std::uint64_t iteration) override;
  SplatModel download() const override;
  void save(TrainState& state, bool everywhere) const override;
  void load(const TrainState& state) override;

 private:
  // Draw contains the inputs of the random numbers that select sources.
  struct Draw {
    std::uint32_t purpose;
    bool alive_only;
    float spread;
    std::uint64_t seed, iteration;
  };
  // Slot is a place for a copy of a source splat.
  struct Slot {
    std::uint32_t place, number;  // index in this rank's part; index of the slot's random number
  };
  Share share() const { return share_of(total_, ranks_.size(), ranks_.rank()); }
  SplatModel gather_model(bool everywhere) const;
  // Returns the rows of the splats of all ranks without padding. Without `everywhere`, the result is empty on
  // all ranks but the first.
  std::vector<float> gather(const Buffer<float>& part, bool everywhere) const;
  // Fills the slots of all ranks with copies of randomly selected sources. Returns the number of slots that
  // were filled.
  std::uint32_t replace(const Draw& draw, const std::vector<std::uint32_t>& weights,
                        std::span<const Slot> slots);
  std::vector<std::uint32_t> weigh(bool alive_only);
  std::vector<Bytes> answer(float spread, const std::vector<Bytes>& tickets,
                            const std::vector<std::uint32_t>& weights);
  void fill(std::span<const Slot> slots, std::span<const std::size_t> owners,
            const std::vector<Bytes>& columns);
  // Displaces the copies in the slots, whose places are in ascending order.
  void place(const Draw& draw, std::span<const Slot> slots);
  void move_parts(std::uint32_t target);
  std::size_t rows_of(const Buffer<float>& part) const { return part.size() / model_.stride(); }
  std::vector<float> row(const Buffer<float>& part, std::size_t row, std::uint32_t count) const;

  Communicator& ranks_;
  std::array<Buffer<float>*, 3> parts_;  // parameters, first moments, second moments
  std::uint32_t total_;
  Buffer<std::uint32_t> weights_, copy_counts_;
};

// Returns the splats of this rank. If there is only one rank, these are all splats, in an object of the base
// class.
std::unique_ptr<TrainedSplats> make_trained_splats(Communicator& ranks, Device& device, Stages& stages,
                                                   const SplatModel& initial, std::size_t capacity);

// Returns a rank's part of a model, or of rows in the layout of a model without padding.
SplatModel part_of(const SplatModel& model, const Share& share);
std::vector<float> part_of(std::span<const float> rows, std::size_t count, const Share& share);

}  // namespace ubs
