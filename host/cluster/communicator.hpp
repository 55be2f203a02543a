// SPDX-License-Identifier: Apache-2.0
// The seam to the other processes of a job, its ranks: what training and commands know of them. All ranks
// call the same functions in the same order. What they add up are integers, so that no sum depends on the
// number of ranks or on how a library adds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace ubs {

using Bytes = std::vector<std::byte>;
using Pieces = std::vector<std::span<const std::byte>>;  // by rank

// Pieces that are on their way.
class Exchange {
 public:
  virtual ~Exchange() = default;
  // Waits. How many bytes come, by the rank that they come from.
  virtual const std::vector<std::uint64_t>& sizes() = 0;
  // Waits for what comes, each piece where `into` says, and until the own pieces may change.
  virtual void receive(std::span<std::byte* const> into) = 0;
  // The same, into memory of the host.
  std::vector<Bytes> finish();
};

class Communicator {
 public:
  virtual ~Communicator() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  // Piece i goes to rank i. Pieces may be empty, and of any size; they stay as they are until receive().
  // Other calls may come in between.
  virtual std::unique_ptr<Exchange> start(const Pieces& pieces) = 0;
  std::vector<Bytes> exchange(const Pieces& pieces) { return start(pieces)->finish(); }
  // Whether what travels to and from other ranks may lie in the memory of a CUDA card.
  virtual bool takes_card_memory() const { return false; }
  // Over all ranks, modulo 2^64; all get it.
  virtual void sum(std::span<std::uint64_t> values) = 0;

  bool first() const { return rank() == 0; }
  // What the first rank has.
  std::uint64_t of_first(std::uint64_t value);
  // Numbers that one rank each has, where all others have +0: the bits of that one.
  void merge(std::span<float> values);
  // To all ranks, from all ranks.
  std::vector<std::string> all_texts(const std::string& text);
};

// A process that is no part of a job.
Communicator& alone();

// Typed pieces.
template <typename T>
std::vector<Bytes> exchange_values(Communicator& ranks, const std::vector<std::vector<T>>& pieces) {
  Pieces bytes;
  for (const std::vector<T>& piece : pieces) bytes.push_back(std::as_bytes(std::span(piece)));
  return ranks.exchange(bytes);
}

// What has come is aligned for every type that travels: it is a vector's memory.
template <typename T>
std::span<const T> as_values(const Bytes& bytes) {
  return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
}

}  // namespace ubs
