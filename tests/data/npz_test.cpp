// SPDX-License-Identifier: Apache-2.0
// .npz archives as numpy.savez and savez_compressed write them, and whatever a broken download may hold.
#include "host/data/npz.hpp"

#include <zlib.h>

#include <cstring>

#include "tests/support/data.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

std::string npy(const std::string& type, const std::string& shape, const std::string& data) {
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type, shape);
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(header.size()) + '\0' + header + data;
}

template <typename T>
std::string raw(std::initializer_list<T> values) {
  std::string bytes;
  for (const T value : values) bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  return bytes;
}

std::string deflated(const std::string& content) {
  std::string packed(content.size() + 100, '\0');
  z_stream stream{};
  REQUIRE(deflateInit2(&stream, 9, Z_DEFLATED, -MAX_WBITS, 9, Z_DEFAULT_STRATEGY) == Z_OK);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(content.data()));
  stream.avail_in = static_cast<uInt>(content.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  REQUIRE(deflate(&stream, Z_FINISH) == Z_STREAM_END);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

// A ZIP file of one member after the format's description, independent of the reader.
std::string zip(const std::string& name, const std::string& content, bool compressed,
                const std::string& extra = "", const std::string& comment = "") {
  const std::string data = compressed ? deflated(content) : content;
  const auto u16 = [](std::size_t v) { return raw({static_cast<std::uint16_t>(v)}); };
  const auto u32 = [](std::size_t v) { return raw({static_cast<std::uint32_t>(v)}); };
  const std::size_t checksum =
      crc32(0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size()));
  const std::string sizes = u32(checksum) + u32(data.size()) + u32(content.size());
  const std::string method = u16(20) + u16(0) + u16(compressed ? 8 : 0) + u16(0) + u16(0);
  const std::string local =
      "PK\x03\x04" + method + sizes + u16(name.size()) + u16(extra.size()) + name + extra;
  const std::string entry = "PK\x01\x02" + u16(20) + method + sizes + u16(name.size()) + u16(0) + u16(0) +
                            u16(0) + u16(0) + u32(0) + u32(0) + name;
  return local + data + entry + "PK\x05\x06" + u16(0) + u16(0) + u16(1) + u16(1) + u32(entry.size()) +
         u32(local.size() + data.size()) + u16(comment.size()) + comment;
}

}  // namespace

TEST_CASE("npz: stored and deflated members of every type") {
  const TempFolder folder;
  for (const bool compressed : {false, true}) {
    const auto read = [&](const std::string& type, const std::string& shape, const std::string& data) {
      put(folder / "a.npz", zip("values.npy", npy(type, shape, data), compressed, "extra", "a comment"));
      const auto arrays = read_npz(folder / "a.npz");
      REQUIRE(arrays.size() == 1);
      return arrays.at("values");
    };
    const NpzArray f4 = read("<f4", "2, 3", raw<float>({1, -2.5f, 0, 3e-30f, 5, 6}));
    CHECK(f4.shape == std::vector<std::size_t>{2, 3});
    CHECK(f4.values[1] == -2.5);
    CHECK(f4.values[5] == 6);
    CHECK(read("<f8", "1,", raw<double>({1e300})).values[0] == 1e300);
    CHECK(read("|u1", "3,", raw<std::uint8_t>({0, 127, 255})).values == std::vector<double>{0, 127, 255});
    CHECK(read("<i4", "1,", raw<std::int32_t>({-7})).values[0] == -7);
    const NpzArray scalar = read("<i8", "", raw<std::int64_t>({648}));
    CHECK(scalar.shape.empty());
    CHECK(scalar.values == std::vector<double>{648});
  }
}

TEST_CASE("npz: refusals say why") {
  const TempFolder folder;
  const auto refusal = [&](const std::string& content) {
    put(folder / "x.npz", content);
    return message_of([&] { read_npz(folder / "x.npz"); });
  };
  const std::string good = zip("a.npy", npy("<f4", "100,", std::string(400, 'x')), true);
  CHECK_THAT(refusal(""), Contains("not a .npz archive"));
  CHECK_THAT(refusal("hello"), Contains("not a .npz archive"));
  CHECK_THAT(refusal(good.substr(0, good.size() - 30)), Contains("not a .npz archive"));
  CHECK_THAT(refusal(good.substr(20)), Contains("x.npz"));
  CHECK_THAT(refusal(zip("a.npy", npy("<c8", "1,", std::string(8, 'x')), false)),
             Contains("'<c8' is not supported"));
  CHECK_THAT(refusal(zip("a.npy", "no array", false)), Contains("x.npz:a.npy: not a .npy file"));
  std::string wrong = zip("a.npy", npy("<f4", "1,", raw<float>({1})), false);
  wrong[wrong.find("NUMPY")] = 'M';
  CHECK_THAT(refusal(wrong), Contains("wrong checksum"));
  std::string encrypted = good, method = good, huge = good;
  const std::size_t entry = good.find("PK\x01\x02");
  encrypted[entry + 8] = 1;
  CHECK_THAT(refusal(encrypted), Contains("encrypted"));
  method[entry + 10] = 12;
  CHECK_THAT(refusal(method), Contains("method 12"));
  huge[entry + 27] = 0x7f;  // two GiB from a few hundred bytes
  CHECK_THAT(refusal(huge), Contains("corrupt compressed data"));
  // Every truncation and every flipped byte ends in a message or in a complete array, never in a crash.
  for (std::size_t i = 0; i < good.size(); ++i) {
    refusal(good.substr(0, i));
    std::string flipped = good;
    flipped[i] = static_cast<char>(flipped[i] ^ 0x55);
    refusal(flipped);
  }
}

TEST_CASE("npz: the garden of gsplat") {
  UBS_REQUIRE_DATA(folder, "gsplat_test_garden");
  const auto arrays = read_npz(folder / "test_garden.npz");
  CHECK(arrays.at("means3d").shape == std::vector<std::size_t>{138766, 3});
  CHECK(arrays.at("colors").values.size() == 3 * 138766);
  CHECK(arrays.at("viewmats").shape == std::vector<std::size_t>{3, 4, 4});
  CHECK(arrays.at("viewmats").values[15] == 1);
  CHECK(arrays.at("width").values == std::vector<double>{648});
  CHECK(arrays.at("height").values == std::vector<double>{420});
}
