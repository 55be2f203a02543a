// SPDX-License-Identifier: Apache-2.0
// Little-endian values from a block of bytes; every read is checked against the end.
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
      fail(ErrorKind::data, "{}: truncated: {} bytes at byte {}, {} more were expected", name_, remaining(),
           at_, count);
    at_ += count;
    return bytes_.subspan(at_ - count, count);
  }

  void skip(std::size_t count) { take(count); }

  // A count of records of at least `smallest` bytes; what cannot fit in the file is refused before any
  // memory is set aside for it.
  template <typename T>
  std::size_t read_count(std::size_t smallest, const char* what) {
    const T count = read<T>();
    if (count > remaining() / smallest)
      fail(ErrorKind::data, "{}: {} {} promised at byte {}, but only {} bytes follow", name_, count, what,
           at_ - sizeof(T), remaining());
    return static_cast<std::size_t>(count);
  }

  // Up to and without the next zero byte.
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
