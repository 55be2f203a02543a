// SPDX-License-Identifier: Apache-2.0
// Communicator connects this process to the other processes of a job, its ranks. Training and commands only
// use this interface. All ranks must call the same functions in the same order. Only integers are summed, so
// that no sum depends on the number of ranks or on the order in which a library adds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace ubs {

using Bytes = std::vector<std::byte>;
using Pieces = std::vector<std::span<const std::byte>>;  // one per rank

// A pending exchange of pieces between the ranks.
class Exchange {
 public:
  virtual ~Exchange() = default;
  // Returns how many bytes arrive from each rank. Waits.
  virtual const std::vector<std::uint64_t>& sizes() = 0;
  // Receives the pieces into the addresses in `into`, one per rank. Waits until all of them have arrived, and
  // until this rank may change the pieces that it sends.
  virtual void receive(std::span<std::byte* const> into) = 0;
  // The same, into host memory.
  std::vector<Bytes> finish();
};

class Communicator {
 public:
  virtual ~Communicator() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  // Sends piece i to rank i. Pieces may be empty and of any size. They must not change until receive()
  // returns. Other calls may be made in between.
  virtual std::unique_ptr<Exchange> start(const Pieces& pieces) = 0;
  std::vector<Bytes> exchange(const Pieces& pieces) { return start(pieces)->finish(); }
  // Returns whether data for and from other ranks may be in the memory of a CUDA device.
  virtual bool takes_card_memory() const { return false; }
  // Sums the values over all ranks, modulo 2^64. All ranks get the result.
  virtual void sum(std::span<std::uint64_t> values) = 0;

  bool first() const { return rank() == 0; }
  // Returns the value of the first rank on all ranks.
  std::uint64_t of_first(std::uint64_t value);
  // Combines numbers of which each is set on one rank and is +0 on all others. Afterwards all ranks have
  // exactly these numbers.
  void merge(std::span<float> values);
  // Returns the texts of all ranks on all ranks.
  std::vector<std::string> all_texts(const std::string& text);
};

// The communicator of a process that does not belong to a job.
Communicator& alone();

// Exchanges pieces of typed values.
template <typename T>
std::vector<Bytes> exchange_values(Communicator& ranks, const std::vector<std::vector<T>>& pieces) {
  Pieces bytes;
  for (const std::vector<T>& piece : pieces) bytes.push_back(std::as_bytes(std::span(piece)));
  return ranks.exchange(bytes);
}

// Interprets received bytes as values. They are the memory of a vector, so they are aligned for all types
// that are sent.
template <typename T>
std::span<const T> as_values(const Bytes& bytes) {
  return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
}

}  // namespace ubs
