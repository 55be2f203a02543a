// SPDX-License-Identifier: Apache-2.0
// Tests files of models with splats of different dimensions.
#include <algorithm>

#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

SplatModel numbered(int dim, std::size_t count, float first) {
  SplatModel model(dim, count);
  for (float& v : model.values) v = first += 0.25f;
  return model;
}

MixedModel three_groups() {
  return MixedModel(std::vector<SplatModel>{numbered(7, 5, 1), numbered(6, 3, 2), numbered(3, 70, 3)});
}

}  // namespace

TEST_CASE("mixed file: a model that is written and read again is the same", "[reduce]") {
  const TempFolder folder;
  const MixedModel model = three_groups();
  write_mixed_ply(folder / "m.ply", model, std::vector<std::string>{"ubs_offset 1 2 3"});
  const std::string text = get(folder / "m.ply");
  CHECK(text.find("comment ubs groups 7,6,3\n") != std::string::npos);
  CHECK(text.find("element vertex 5\n") != std::string::npos);  // the only element that other tools read
  CHECK(text.find("element vertex_6d 3\n") != std::string::npos);
  CHECK(text.find("element vertex_3d 70\n") != std::string::npos);

  const LoadedModel back = load_splat_model(folder / "m.ply");
  REQUIRE(back.model.groups.size() == 3);
  for (std::size_t g = 0; g < 3; ++g) {
    CHECK(back.model.groups[g].dim == model.groups[g].dim);
    CHECK(back.model.groups[g].values == model.groups[g].values);
  }
  CHECK(back.comments == std::vector<std::string>{"ubs_offset 1 2 3"});
  CHECK(back.offset == std::array<double, 3>{1, 2, 3});
  CHECK(back.model.count() == 78);
  CHECK(back.model.parameters() == 5 * 44 + 3 * 35 + 70 * 14);
  CHECK(to_string(back.model) == "78 splats: 5 with N = 7, 3 with N = 6, 70 with N = 3");

  // With a single group, the file has the format without groups.
  write_splat_ply(folder / "a.ply", model.groups[1]);
  write_mixed_ply(folder / "b.ply", model.groups[1]);
  CHECK(get(folder / "a.ply") == get(folder / "b.ply"));
  CHECK(get(folder / "a.ply").find("groups") == std::string::npos);
}

TEST_CASE("mixed file: inconsistent files are rejected with a reason", "[reduce]") {
  const TempFolder folder;
  write_mixed_ply(folder / "m.ply", three_groups());
  const std::string good = get(folder / "m.ply");
  const auto message = [&](const std::string& text) {
    put(folder / "x.ply", text);
    return message_of([&] { read_mixed_ply(folder / "x.ply"); });
  };
  CHECK_THAT(
      message_of([&] { read_splat_ply(folder / "m.ply"); }),
      Contains("splats of different dimensions (78 splats: 5 with N = 7, 3 with N = 6, 70 with N = 3)"));
  CHECK_THAT(message(replaced(good, "groups 7,6,3", "groups 7,3")), Contains("lists the groups '7,3'"));
  CHECK_THAT(message(replaced(good, "comment ubs groups 7,6,3\n", "")),
             Contains("but the elements have N = 7,6,3"));
  CHECK_THAT(message(replaced(good, "vertex_6d 3\n", "vertex_5d 3\n")),
             Contains("'vertex_5d' has the properties of N = 6"));
  CHECK_THAT(message(replaced(good, "vertex_6d 3\n", "face 3\n")), Contains("groups '7,6,3'"));
  CHECK_THAT(message(good.substr(0, good.size() - 8)), Contains("truncated"));
  CHECK_THAT(message(good + "12345678"), Contains("unexpected bytes"));
  CHECK_THAT(message(replaced(good, "groups 7,6,3\n", "groups 7,6,3\ncomment ubs groups 7,6,3\n")),
             Contains("a second time"));

  MixedModel twice(std::vector<SplatModel>{numbered(6, 2, 1), numbered(6, 2, 2)});
  CHECK_THAT(message_of([&] { write_mixed_ply(folder / "n.ply", twice); }, ErrorKind::internal),
             Contains("two groups with N = 6"));
  MixedModel bad = three_groups();
  bad.groups[2].values[5] = std::numeric_limits<float>::infinity();
  CHECK_THAT(message_of([&] { write_mixed_ply(folder / "n.ply", bad); }, ErrorKind::numerical),
             Contains("in splat 5, 'x' is inf"));
  CHECK(!std::filesystem::exists(folder / "n.ply"));
}
