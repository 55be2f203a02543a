// SPDX-License-Identifier: Apache-2.0
// Communicator connects the processes of a job, which are called ranks. Training and commands communicate
// only through this interface. All ranks must call the same functions in the same order. Only integers are
// summed, because a sum of floating-point numbers would depend on the number of ranks and on the order of the
// additions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "host/base/memory_kind.hpp"

namespace ubs {

using Bytes = std::vector<std::byte>;
// The data that this rank sends: one piece for each rank, including itself.
using Pieces = std::vector<std::span<const std::byte>>;

// Exchange represents an exchange of pieces between the ranks that is in progress.
class Exchange {
 public:
  virtual ~Exchange() = default;
  // Waits until the sizes of the pieces from all ranks are known, and returns these sizes [bytes].
  virtual const std::vector<std::uint64_t>& sizes() = 0;
  // Stores the piece from rank i at the address into[i]. Waits until all pieces have arrived. Afterwards this
  // rank may also change the pieces that it has sent.
  virtual void receive(std::span<std::byte* const> into) = 0;
  // Receives the pieces into new buffers in host memory and returns them. Waits in the same way as receive().
  std::vector<Bytes> finish();
};

class Communicator {
 public:
  virtual ~Communicator() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  // Starts to send piece i to rank i. Pieces may have any size and may be empty. They must not change until
  // receive() has returned. Other functions may be called before that.
  virtual std::unique_ptr<Exchange> start(const Pieces& pieces) = 0;
  std::vector<Bytes> exchange(const Pieces& pieces) { return start(pieces)->finish(); }
  // Returns whether the pieces that are sent and received may be in memory of this kind.
  virtual bool takes_memory(MemoryKind kind) const { return kind == MemoryKind::host; }
  // Sums the values over all ranks, modulo 2^64. All ranks get the result.
  virtual void sum(std::span<std::uint64_t> values) = 0;

  bool first() const { return rank() == 0; }
  // Returns the value that the first rank has passed. All ranks get this value.
  std::uint64_t of_first(std::uint64_t value);
  // Distributes numbers to all ranks. Before the call, each number must be set on one rank and be +0 on all
  // others. Afterwards all ranks have exactly these numbers.
  void merge(std::span<float> values);
  // Returns the texts that all ranks have passed, in the order of the ranks. All ranks get all texts.
  std::vector<std::string> all_texts(const std::string& text);
};

// Returns the communicator of a process that does not belong to a job. It has only one rank.
Communicator& alone();

// Exchanges pieces that consist of values of type T, and returns the received bytes (see as_values).
template <typename T>
std::vector<Bytes> exchange_values(Communicator& ranks, const std::vector<std::vector<T>>& pieces) {
  Pieces bytes;
  for (const std::vector<T>& piece : pieces) bytes.push_back(std::as_bytes(std::span(piece)));
  return ranks.exchange(bytes);
}

// Interprets received bytes as values. The bytes are the memory of a std::vector, so they are aligned for all
// types that are sent.
template <typename T>
std::span<const T> as_values(const Bytes& bytes) {
  return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
}

}  // namespace ubs
