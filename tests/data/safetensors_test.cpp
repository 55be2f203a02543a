// SPDX-License-Identifier: Apache-2.0
// Tests reading safetensors files. Any invalid content must give an error that names the file and, if there
// is one, the tensor.
#include "host/pipeline/safetensors.hpp"

#include <catch2/catch.hpp>
#include <cstdint>
#include <limits>

#include "host/base/error.hpp"
#include "tests/support/temp_folder.hpp"

namespace {

using namespace ubs;

std::string file_text(const std::string& header, const std::vector<float>& values) {
  const std::uint64_t length = header.size();
  std::string text(reinterpret_cast<const char*>(&length), sizeof length);
  text += header;
  return text.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
}

std::string entry(const std::string& name, const std::string& shape, int begin, int end,
                  const std::string& type = "F32") {
  return fmt::format(R"("{}":{{"dtype":"{}","shape":{},"data_offsets":[{},{}]}})", name, type, shape, begin,
                     end);
}

}  // namespace

TEST_CASE("safetensors: tensors in any order are read, and metadata are ignored") {
  const test::TempFolder folder;
  const std::string header =
      fmt::format(R"({{"__metadata__":{{"a":"b"}},{},{},{}}}  )", entry("late", "[2,1]", 12, 20),
                  entry("early", "[3]", 0, 12), entry("none", "[0,7]", 20, 20));
  test::put(folder / "t.safetensors", file_text(header, {1, 2, 3, 4, 5}));
  const TensorFile file = read_safetensors(folder / "t.safetensors");
  REQUIRE(file.tensors.size() == 3);
  CHECK(file.at("early").values == std::vector<float>{1, 2, 3});
  CHECK(file.at("late").shape == std::vector<std::size_t>{2, 1});
  CHECK(file.at("late").values == std::vector<float>{4, 5});
  CHECK(file.at("none").values.empty());
  CHECK_THROWS_WITH(file.at("other"), Catch::Contains("tensor 'other' is missing"));
}

TEST_CASE("safetensors: errors describe the damage") {
  const test::TempFolder folder;
  const auto check = [&](const std::string& text, const std::string& message) {
    test::put(folder / "t.safetensors", text);
    CHECK_THROWS_WITH(read_safetensors(folder / "t.safetensors"),
                      Catch::StartsWith((folder / "t.safetensors").string()) && Catch::Contains(message));
  };
  const std::vector<float> three{1, 2, 3};
  const auto with = [&](const std::string& entries) {
    return file_text(fmt::format("{{{}}}", entries), three);
  };
  check("short", "truncated");
  check(std::string(8, '\xff') + "{}", "the header should have");
  check(file_text("{nonsense", three), "malformed JSON");
  check(file_text("[1]", three), "not a JSON object");
  check(with(R"("a":3)"), "tensor 'a': needs dtype");
  check(with(entry("a", "[3]", 0, 12, "F16")), "has the type F16");
  check(with(entry("a", "[4]", 0, 16)), "does not match");
  check(with(entry("a", "[18446744073709551615,3]", 0, 12)), "does not match");
  check(with(entry("a", "[-3]", 0, 12)), "does not match");
  check(with(entry("a", "3", 0, 12)), "shape is not a list");
  check(with(entry("a", "[2]", 0, 12)), "2 values cannot be stored in 12 bytes");
  check(with(entry("a", "[3]", 4, 16)), "must be [BEGIN, END]");
  check(with(entry("a", "[1]", 8, 4)), "must be [BEGIN, END]");
  check(with(entry("a", "[2]", 0, 8)), "end at byte 8 of 12");
  check(with(entry("a", "[2]", 4, 12)), "begins at byte 4");
  check(with(entry("a", "[2]", 0, 8) + "," + entry("b", "[2]", 4, 12)), "tensor 'b': begins at byte 4");
  check(file_text(fmt::format("{{{}}}", entry("a", "[1]", 0, 4)), {std::numeric_limits<float>::quiet_NaN()}),
        "not finite");
}
