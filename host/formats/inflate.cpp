// SPDX-License-Identifier: Apache-2.0
// Compresses data with zlib, and decompresses data with zlib and Zstandard. The size of decompressed data is
// limited, because a few kilobytes of compressed data can expand to gigabytes.
#include <zlib.h>
#include <zstd.h>

#include <algorithm>

#include "host/base/error.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

// Values of zlib's parameter windowBits for the largest window. The first is for data with a zlib header, the
// second for data with a gzip header, and the third for data without a header.
constexpr int kZlibWindow = 15, kGzipWindow = 15 + 16, kRawWindow = -15;
constexpr std::size_t kBlock = std::size_t{1} << 20;  // [bytes] the output grows in steps of this size

// Passes the next chunk of `rest` to zlib when zlib has read all of its input. Chunks are needed because zlib
// stores the length of its input in 32 bits.
void feed(z_stream& stream, std::span<const std::byte>& rest) {
  if (stream.avail_in > 0) return;
  const auto piece = rest.first(std::min(rest.size(), std::size_t{1} << 30));
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(piece.data()));
  stream.avail_in = static_cast<uInt>(piece.size());
  rest = rest.subspan(piece.size());
}

struct Inflater {
  z_stream stream{};
  Inflater(int window, const std::string& name) {
    if (inflateInit2(&stream, window) != Z_OK)
      fail(ErrorKind::memory, "{}: zlib cannot be initialised", name);
  }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
};

// Decompresses data. If the output has more than `limit` bytes, returns its first `limit` bytes if
// `start_only` is set, and throws otherwise.
std::vector<std::byte> inflate_window(std::span<const std::byte> packed, std::size_t limit, int window,
                                      const std::string& name, bool start_only = false) {
  Inflater inflater(window, name);
  z_stream& stream = inflater.stream;
  std::vector<std::byte> plain;
  while (true) {
    const std::size_t used = plain.size();
    if (used >= limit && start_only) return plain;
    if (used >= limit)
      fail(ErrorKind::data, "{}: contains more than the {} bytes that its header allows", name, limit);
    plain.resize(std::min(limit, used + kBlock));
    feed(stream, packed);
    stream.next_out = reinterpret_cast<Bytef*>(plain.data() + used);
    stream.avail_out = static_cast<uInt>(plain.size() - used);
    const int result = inflate(&stream, Z_NO_FLUSH);
    plain.resize(plain.size() - stream.avail_out);
    if (const std::size_t behind = stream.avail_in + packed.size(); result == Z_STREAM_END && behind > 0)
      fail(ErrorKind::data, "{}: {} bytes follow the end of the gzip data", name, behind);
    if (result == Z_STREAM_END) return plain;
    if (result != Z_OK) fail(ErrorKind::data, "{}: damaged or truncated gzip data", name);
  }
}

std::vector<std::byte> deflate_window(std::span<const std::byte> plain, int level, int window, int memory,
                                      int strategy) {
  z_stream stream{};
  if (deflateInit2(&stream, level, Z_DEFLATED, window, memory, strategy) != Z_OK)
    fail(ErrorKind::memory, "zlib cannot be initialised");
  std::vector<std::byte> packed;
  int result = Z_OK;
  while (result == Z_OK) {
    const std::size_t used = packed.size();
    packed.resize(used + kBlock);
    feed(stream, plain);
    stream.next_out = reinterpret_cast<Bytef*>(packed.data() + used);
    stream.avail_out = static_cast<uInt>(kBlock);
    result = deflate(&stream, plain.empty() ? Z_FINISH : Z_NO_FLUSH);
    packed.resize(packed.size() - stream.avail_out);
  }
  deflateEnd(&stream);
  if (result != Z_STREAM_END) fail(ErrorKind::internal, "zlib cannot compress {} bytes", stream.total_in);
  return packed;
}

}  // namespace

std::vector<std::byte> inflate_gzip(std::span<const std::byte> packed, std::size_t limit,
                                    const std::string& name) {
  return inflate_window(packed, limit, kGzipWindow, name);
}

std::vector<std::byte> inflate_gzip_start(std::span<const std::byte> packed, std::size_t size,
                                          const std::string& name) {
  return inflate_window(packed, size, kGzipWindow, name, true);
}

std::vector<std::byte> inflate_raw(std::span<const std::byte> packed, std::size_t limit,
                                   const std::string& name) {
  return inflate_window(packed, limit, kRawWindow, name);
}

std::vector<std::byte> deflate_gzip(std::span<const std::byte> plain) {
  return deflate_window(plain, Z_DEFAULT_COMPRESSION, kGzipWindow, 9, Z_DEFAULT_STRATEGY);
}

std::vector<std::byte> deflate_runs(std::span<const std::byte> plain) {
  return deflate_window(plain, Z_BEST_SPEED, kZlibWindow, 8, Z_RLE);
}

std::vector<std::byte> inflate_zstd(std::span<const std::byte> packed, std::size_t size,
                                    const std::string& name) {
  // Most frames state their decompressed size. If the stated size differs from `size`, which is from the
  // table of contents of the file, the frame is refused before it is decompressed.
  const unsigned long long stated = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (stated == ZSTD_CONTENTSIZE_ERROR || (stated != ZSTD_CONTENTSIZE_UNKNOWN && stated != size))
    fail(ErrorKind::data,
         "{}: a Zstandard stream is damaged, or its decompressed size differs from the size in the table of "
         "contents",
         name);
  std::vector<std::byte> plain(size);
  const std::size_t result = ZSTD_decompress(plain.data(), plain.size(), packed.data(), packed.size());
  if (ZSTD_isError(result) || result != size)
    fail(ErrorKind::data, "{}: damaged or truncated Zstandard data", name);
  return plain;
}

}  // namespace ubs
