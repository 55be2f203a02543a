// SPDX-License-Identifier: Apache-2.0
// Tests that .npy files have the same bytes as those of NumPy, that they are read back without change, and
// that invalid files give errors.
#include "host/dataset/npy.hpp"

#include <array>

#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

// Returns a header as numpy.save() writes it, followed by `data`.
std::string npy_text(const std::string& dict, const std::string& data) {
  std::string header = dict;
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(header.size()) + '\0' + header + data;
}

}  // namespace

TEST_CASE("npy: a written file has the expected bytes and is read back", "[npy]") {
  TempFolder folder;
  const std::array<float, 6> values{1, -2.5f, 3e-30f, 0, 5, 6};
  const std::string raw(reinterpret_cast<const char*>(values.data()), 24);
  const std::array<std::size_t, 2> shape{2, 3};
  write_npy(folder / "a.npy", shape, values);
  CHECK(get(folder / "a.npy") ==
        npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }", raw));
  const NpyArray back = read_npy(folder / "a.npy");
  CHECK(back.shape == std::vector<std::size_t>{2, 3});
  CHECK(std::equal(values.begin(), values.end(), back.values.begin(), back.values.end()));

  const std::array<std::size_t, 1> flat{6};
  write_npy(folder / "b.npy", flat, values);
  CHECK(get(folder / "b.npy") == npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (6,), }", raw));
  CHECK(read_npy(folder / "b.npy").shape == std::vector<std::size_t>{6});
}

// By default, NumPy writes arrays of float64.
TEST_CASE("npy: files with float64 are accepted like files with float32", "[npy]") {
  TempFolder folder;
  const std::array<double, 3> wide{0.1, -2.5, 1e-300};
  put(folder / "d.npy", npy_text("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }",
                                 {reinterpret_cast<const char*>(wide.data()), sizeof wide}));
  CHECK(read_npy(folder / "d.npy").values == std::vector<float>{0.1f, -2.5f, 0});
  CHECK(read_npy_double(folder / "d.npy").values == std::vector<double>(wide.begin(), wide.end()));
}

TEST_CASE("npy: scalar and empty arrays are written and read", "[npy]") {
  TempFolder folder;
  const std::array<float, 1> one{7};
  write_npy(folder / "s.npy", {}, one);
  CHECK(read_npy(folder / "s.npy").shape.empty());
  CHECK(read_npy(folder / "s.npy").values == std::vector<float>{7});
  const std::array<std::size_t, 2> shape{0, 3};
  write_npy(folder / "e.npy", shape, {});
  CHECK(read_npy(folder / "e.npy").shape == std::vector<std::size_t>{0, 3});
}

TEST_CASE("npy: errors contain the reason", "[npy]") {
  TempFolder folder;
  const auto refusal = [&](const std::string& content) {
    put(folder / "x.npy", content);
    return message_of([&] { read_npy(folder / "x.npy"); });
  };
  const std::string data(24, '\0');
  CHECK_THAT(refusal(""), Contains("x.npy: not a .npy file"));
  CHECK_THAT(refusal("something else entirely"), Contains("not a .npy file"));
  CHECK_THAT(refusal(std::string("\x93NUMPY\x02\x00\x00\x00\x00\x00", 12)), Contains("format 2.0"));
  CHECK_THAT(
      refusal(npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }", data).substr(0, 40)),
      Contains("truncated .npy header"));
  CHECK_THAT(refusal(npy_text("{'descr': '<i8', 'fortran_order': False, 'shape': (3,), }", data)),
             Contains("'<i8' is not supported"));
  const std::array<double, 2> wide{1, 1e300};
  CHECK_THAT(refusal(npy_text("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }",
                              {reinterpret_cast<const char*>(wide.data()), sizeof wide})),
             Contains("value 1 is 1e+300, which exceeds float32"));
  CHECK_THAT(refusal(npy_text("{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }", data)),
             Contains("Fortran order"));
  CHECK_THAT(refusal(npy_text("{'descr': '<f4', 'shape': (2, 3), }", data)),
             Contains("malformed .npy header: fortran_order is missing"));
  CHECK_THAT(refusal(npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 4), }", data)),
             Contains("truncated"));
  CHECK_THAT(refusal(npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }", data)),
             Contains("24 bytes of data, but the shape needs 16"));
  CHECK_THAT(refusal(npy_text("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296), }",
                              data)),
             Contains("truncated"));
  CHECK_THAT(refusal(npy_text(
                 "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999,), }", data)),
             Contains("invalid extent"));
  const std::array<std::size_t, 1> shape{2};
  const std::array<float, 1> one{7};
  CHECK_THAT(message_of([&] { write_npy(folder / "w.npy", shape, one); }, ErrorKind::internal),
             Contains("does not match"));
}
