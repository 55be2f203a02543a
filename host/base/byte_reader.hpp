// SPDX-License-Identifier: Apache-2.0
// ByteReader reads little-endian values from a block of bytes. Every read is checked against the end of the
// block.
#pragma once

#include <cstddef>
#include <cstring>
#include <span>
#include <string>

#include "host/base/error.hpp"

namespace ubs {

class ByteReader {
 public:
  ByteReader(std::span<const std::byte> bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}

  std::size_t position() const { return at_; }
  std::size_t remaining() const { return bytes_.size() - at_; }

  template <typename T>
  T read() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }

  std::span<const std::byte> take(std::size_t count) {
    if (count > remaining())
      fail(ErrorKind::data, "{}: truncated: only {} bytes follow byte {}, but {} more are needed", name_,
           remaining(), at_, count);
    at_ += count;
    return bytes_.subspan(at_ - count, count);
  }

  void skip(std::size_t count) { take(count); }

  // Reads the number of records that follow. Each record has at least `smallest` bytes. Throws Error(data) if
  // so many records cannot fit into the remaining bytes, so that the caller never allocates memory for them.
  template <typename T>
  std::size_t read_count(std::size_t smallest, const char* what) {
    const T count = read<T>();
    if (count > remaining() / smallest)
      fail(ErrorKind::data,
           "{}: the number of {} at byte {} is {}, but the remaining {} bytes are too few for them", name_,
           what, at_ - sizeof(T), count, remaining());
    return static_cast<std::size_t>(count);
  }

  // Reads a string up to the next zero byte, which is not included.
  std::string read_string() {
    std::string text;
    while (const char c = read<char>()) text += c;
    return text;
  }

  const std::string& name() const { return name_; }

 private:
  std::span<const std::byte> bytes_;
  std::string name_;
  std::size_t at_ = 0;
};

}  // namespace ubs
