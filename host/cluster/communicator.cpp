// SPDX-License-Identifier: Apache-2.0
#include "host/cluster/communicator.hpp"

#include <algorithm>
#include <bit>
#include <utility>

namespace ubs {
namespace {

class Alone final : public Communicator {
 public:
  int rank() const override { return 0; }
  int size() const override { return 1; }
  std::unique_ptr<Exchange> start(const Pieces& pieces) override {
    struct Own final : Exchange {
      explicit Own(std::span<const std::byte> piece) : piece(piece), size{piece.size()} {}
      const std::vector<std::uint64_t>& sizes() override { return size; }
      void receive(std::span<std::byte* const> into) override { std::ranges::copy(piece, into[0]); }
      std::span<const std::byte> piece;
      std::vector<std::uint64_t> size;
    };
    return std::make_unique<Own>(pieces.at(0));
  }
  void sum(std::span<std::uint64_t>) override {}
};

}  // namespace

Communicator& alone() {
  static Alone ranks;
  return ranks;
}

std::vector<Bytes> Exchange::finish() {
  std::vector<Bytes> come;
  std::vector<std::byte*> into;
  for (const std::uint64_t size : sizes()) come.emplace_back(size);
  for (Bytes& bytes : come) into.push_back(bytes.data());
  receive(into);
  return come;
}

std::uint64_t Communicator::of_first(std::uint64_t value) {
  if (!first()) value = 0;
  sum(std::span(&value, 1));
  return value;
}

void Communicator::merge(std::span<float> values) {
  if (size() == 1) return;
  std::vector<std::uint64_t> bits(values.size());
  std::ranges::transform(values, bits.begin(), [](float v) { return std::bit_cast<std::uint32_t>(v); });
  sum(bits);
  std::ranges::transform(bits, values.begin(),
                         [](std::uint64_t b) { return std::bit_cast<float>(static_cast<std::uint32_t>(b)); });
}

std::vector<std::string> Communicator::all_texts(const std::string& text) {
  std::vector<std::string> texts;
  for (const Bytes& bytes :
       exchange(Pieces(static_cast<std::size_t>(size()), std::as_bytes(std::span(text)))))
    texts.emplace_back(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return texts;
}

}  // namespace ubs
