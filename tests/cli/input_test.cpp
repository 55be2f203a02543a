// SPDX-License-Identifier: Apache-2.0
// Tests how the executable handles malicious and unusual input: names that would leave the output folder,
// files outside of the data, paths that are not valid text, and names that are too long. resume_test.cpp
// tests that a run can be resumed if its path is not valid text.
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "host/base/text.hpp"
#include "host/check/metric_inputs.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/packed.hpp"
#include "host/formats/ply.hpp"
#include "host/pipeline/network.hpp"
#include "host/scene/initialise.hpp"
#include "tests/support/images.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/whole_sweep.hpp"
#include "tests/support/write_safetensors.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::check_error;
using test::file_count;
using test::get;
using test::put;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;
using test::whole_sweep;

constexpr const char* kTiny = "--iterations 60 --init-points 100 --cap-max 120 --log-every 20";

void synthesise(const TempFolder& folder, const fs::path& out) {
  test::put_scene(folder.path() / out, 24, 6, 2);
}

void put_model(const fs::path& path) { write_splat_ply(path, initialise_random(3, 20, 1)); }

View drawn_view(const std::string& name) {
  View view{name, {}, {16, 12, std::vector<std::uint8_t>(3 * 16 * 12, 90), {}}, nullptr};
  view.camera.translation = {0, 0, 4};
  view.camera.fx = view.camera.fy = 20;
  view.camera.cx = 8, view.camera.cy = 6;
  view.camera.width = 16, view.camera.height = 12;
  return view;
}

std::set<std::string> files_of(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

TEST_CASE("cli: names of views only lead to files in the output folder, and each view has its own file") {
  const TempFolder folder;
  const std::string absolute = (folder / "absolute").string();
  const std::vector<std::string> names{"../escaped", absolute,  "..",  "a/b", "A",
                                       "a",          "a_alpha", "CON", "x\ny"};
  Split test{"test", {}}, train{"train", {drawn_view("t")}};
  for (const std::string& name : names) test.views.push_back(drawn_view(name));
  write_packed(folder / "set.ubsd", {.splits = {train, test}});
  put_model(folder / "m.ply");
  ubs_ok(folder, "render m.ply --data set.ubsd --out deep/out --channels rgb,alpha");
  CHECK(file_count(folder / "deep") == 1);
  CHECK(file_count(folder / "deep/out") == 2 * names.size());
  for (const auto& entry : fs::directory_iterator(folder / "deep/out")) CHECK(entry.is_regular_file());
  ubs_ok(folder, fmt::format("train --data set.ubsd --out run --dim 3 {} --save-renders -1", kTiny));
  CHECK(file_count(folder / "run/renders") == names.size());
  CHECK(files_of(folder.path()) ==
        std::set<std::string>{"deep", "m.ply", "run", "set.ubsd", "stderr.txt", "stdout.txt"});
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["test"]["views"][0]["name"] == "..%2Fescaped");
}

TEST_CASE(
    "cli: weights of LPIPS that are truncated, damaged or incomplete give one line; most give exit code "
    "3") {
  const TempFolder folder;
  test::put_image(folder / "a/x.png", 64, 64);
  const TensorFile whole = check::random_weights(lpips_network("alex"), 3);
  const fs::path file = folder / "w/lpips_alex.safetensors";
  const std::string command = "metrics a/x.png a/x.png --lpips alex --lpips-weights w";
  fs::create_directory(folder / "w");
  test::put_safetensors(file, whole.tensors);
  ubs_ok(folder, command);
  const std::string bytes = get(file);
  std::uint64_t header = 0;
  std::memcpy(&header, bytes.data(), sizeof header);
  for (const std::size_t length :
       {std::size_t{0}, std::size_t{7}, std::size_t{8}, std::size_t{8} + header / 2, std::size_t{8} + header,
        bytes.size() / 2, bytes.size() - 1}) {
    INFO(length << " of " << bytes.size() << " bytes");
    put(file, bytes.substr(0, length));
    check_error(folder, command, 3, "lpips_alex.safetensors");
  }
  std::mt19937 random(5);
  const int mutants = whole_sweep() ? 40 : 8;
  int refused = 0;
  for (int i = 0; i < mutants; ++i) {  // each mutant has one wrong bit in the header
    std::string mutant = bytes;
    mutant[random() % (8 + header)] ^= static_cast<char>(1u << random() % 8);
    put(file, mutant);
    const Result result = run_ubs(folder, command);
    INFO(result.err);
    CHECK((result.code == 0 || result.code == 3));
    refused += result.code == 3;
  }
  CHECK(refused > mutants * 3 / 4);
  std::size_t changed = 0;
  for (const auto& [name, tensor] : whole.tensors) {
    // Every third tensor is tested. These include weights, biases and a linear head.
    if (!whole_sweep() && changed++ % 3 != 0) continue;
    INFO(name);
    auto fewer = whole.tensors, flat = whole.tensors;
    fewer.erase(name);
    test::put_safetensors(file, fewer);
    check_error(folder, command, 3, fmt::format("tensor '{}' is missing", name));
    flat[name].shape = {tensor.values.size()};
    if (tensor.shape.size() == 1) flat[name].shape = {tensor.values.size(), 1};
    test::put_safetensors(file, flat);
    check_error(folder, command, 3, "the network 'alex' needs");
  }
  auto huge = whole.tensors;
  std::ranges::fill(huge["features.0.weight"].values, 3e38f);
  test::put_safetensors(file, huge);
  test::put_image(folder / "b/x.png", 64, 64, 3);
  check_error(folder, "metrics a/x.png b/x.png --lpips alex --lpips-weights w", 7, "LPIPS");
}

TEST_CASE("cli: files outside of the data folder need --allow-outside") {
  const TempFolder folder;
  test::put_image(folder / "secret/x.png", 16, 12);
  put(folder / "data/transforms.json",
      R"({"w": 16, "h": 12, "fl_x": 20, "frames": [{"file_path": "../secret/x.png",
          "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})");
  put_model(folder / "m.ply");
  const std::string outside = "outside of the folder";
  check_error(folder, fmt::format("train --data data --out run {}", kTiny), 3, outside);
  check_error(folder, "eval --model m.ply --data data --split train", 3, outside);
  check_error(folder, "render m.ply --data data --split train --out images", 3, outside);
  check_error(folder, "gradients --model m.ply --data data --split train --view 0 --out g.ply", 3, outside);
  check_error(folder, "pack data --out p.ubsd", 3, outside);
  check_error(folder, "info data", 3, outside);
  check_error(folder, "plan --data data", 3, outside);
  ubs_ok(folder, fmt::format("train --data data --out run --allow-outside --test-every 0 --dim 3 {}", kTiny));
  ubs_ok(folder, "eval --model m.ply --data data --split train --allow-outside --test-every 0");
  ubs_ok(folder, "pack data --out p.ubsd --allow-outside");
  ubs_ok(folder, "info data --allow-outside");
}

TEST_CASE("cli: info describes a packed data set and a nerfstudio file") {
  const TempFolder folder;
  synthesise(folder, "data");
  ubs_ok(folder, "pack data --out set.ubsd --background 1,1,1 --downscale 2");
  const json info = json::parse(ubs_ok(folder, "info set.ubsd --json").out);
  CHECK(info["layout"] == "packed");
  CHECK(info["background"] == json({1.0, 1.0, 1.0}));
  CHECK(info["downscale"] == 2);
  CHECK(info["bytes"] == fs::file_size(folder / "set.ubsd"));
  CHECK(info["splits"]["train"] == json({{"views", 6}, {"sizes", {{12, 12}}}, {"masks", 0}, {"images", 6}}));
  CHECK(info["splits"]["test"]["views"] == 2);
  const std::string text = ubs_ok(folder, "info set.ubsd").out;
  CHECK(text.find("(packed)") != std::string::npos);
  CHECK(text.find("6 views of 12x12, 6 images") != std::string::npos);
  fs::rename(folder / "data/transforms_train.json", folder / "data/one.json");
  CHECK(json::parse(ubs_ok(folder, "info data/one.json --json").out)["layout"] == "nerfstudio");
  put(folder / "set.ubsd", get(folder / "set.ubsd").substr(0, 100));
  check_error(folder, "info set.ubsd", 3, "set.ubsd: the header is truncated");
}

// Names of folders are arbitrary bytes. The name in this test is encoded in Latin-1, and contains a line
// break and an escape sequence of encode_text().
TEST_CASE("cli: a data path that is not valid text is preserved in every file") {
  const TempFolder folder;
  const std::string name = "caf\xe9 \\x41\n'q'";
  const fs::path data = folder / name, run = folder / (name + " run");
  synthesise(folder, data);
  const auto shell = [](const fs::path& path) { return shell_word(path.string()); };
  ubs_ok(folder, fmt::format("train --data {} --out {} --dim 3 {} --checkpoint-every 20 --cache-folder {}",
                             shell(data), shell(run), kTiny, shell(folder / (name + " cache"))));
  const json metrics = json::parse(get(run / "metrics.json"));
  CHECK(decode_text(metrics["data"].get<std::string>()) == data.string());
  const std::string config = get(run / "config.yaml");
  CHECK(config.find("cache_folder: '" + (folder.path() / "caf\\xe9 \\x5cx41\\x0a''q'' cache").string()) !=
        std::string::npos);
  // The written files can be read: the settings, the data of a report, and a checkpoint.
  ubs_ok(folder, fmt::format("eval --model {} --data {} --spec {} --out e.json", shell(run / "model.ply"),
                             shell(data), shell(run / "config.yaml")));
  CHECK(decode_text(json::parse(get(folder / "e.json"))["data"].get<std::string>()) == data.string());
  ubs_ok(folder, fmt::format("report {} --out page.html", shell(run)));
  const std::string page = get(folder / "page.html");
  CHECK(page.find("caf\\xe9") != std::string::npos);
  CHECK(page.find("does not exist") == std::string::npos);
  ubs_ok(folder, fmt::format("pack {} --out p.ubsd", shell(data)));
}

TEST_CASE("cli: names that are too long and loops of links do not give internal errors") {
  const TempFolder folder;
  synthesise(folder, "data");
  put_model(folder / "m.ply");
  for (const char* name : {"loop", "loop.mp4", "loop.ply"}) fs::create_symlink(name, folder / name);
  std::size_t kind = 0;
  for (const std::string& bad :
       {std::string(300, 'x'), std::string("loop"), "loop/" + std::string(300, 'y')}) {
    const std::vector<std::string> commands{
        "train --data {} --out run",
        "train --data data --out {} --iterations 5",
        "train --resume {}",
        "train --data data --out run --spec {}",
        "info {}",
        "eval --model {} --data data",
        "eval --model m.ply --data {}",
        "eval --model m.ply --data data --out {}",
        "render {} --data data --out o",
        "render m.ply --data data --out {}",
        "render m.ply --video {}.mp4",
        "render m.ply --path {} --out o",
        "metrics {} {}",
        "metrics data {}",
        "gradients --model m.ply --data data --view 0 --out {}",
        "gradients --model m.ply --data data --view 0 --target {} --out g.ply",
        "pack {} --out p.ubsd",
        "pack data --out {}",
        "convert {} x.ply",
        "convert m.ply {}.ply",
        "report {}",
        "synth glossy --out {} --size 8 --views 1",
        "reduce --model {} --data data --out r.ply",
        "plan --data {}",
        "train --data data --out run --lpips vgg --lpips-weights {}"};
    for (std::size_t i = 0; i < commands.size(); ++i) {
      if (!whole_sweep() && (i + kind) % 3 != 0) continue;  // tests each command with one of the three paths
      const std::string& command = commands[i];
      const Result result = run_ubs(folder, fmt::format(fmt::runtime(command), bad, bad));
      INFO(command.substr(0, 60) << " with " << bad.substr(0, 10) << ": " << result.err.substr(0, 300));
      CHECK((result.code == 3 || result.code == 2));
      CHECK_THAT(result.err, Catch::Contains(": error: "));
      CHECK(result.err.find("internal") == std::string::npos);
    }
    fs::remove_all(folder / "run");
    ++kind;
  }
}

TEST_CASE("cli: control characters in names are not printed") {
  const TempFolder folder;
  const Result result = run_ubs(folder, fmt::format("info {}", shell_word("a\x1b[31mb.ply")));
  CHECK(result.code == 3);
  CHECK(result.err.find('\x1b') == std::string::npos);
  CHECK(result.err.find("a\\x1b[31mb.ply: no such file") != std::string::npos);
}

TEST_CASE("cli: float64 targets are accepted like float32 targets") {
  const TempFolder folder;
  write_packed(folder / "set.ubsd", {.splits = {{"train", {drawn_view("t")}}}});
  put_model(folder / "m.ply");
  const std::vector<float> pixels(12 * 16 * 3, 0.25f);
  write_npy(folder / "t32.npy", std::vector<std::size_t>{12, 16, 3}, pixels);
  std::string wide = get(folder / "t32.npy").substr(0, 128);
  wide.replace(wide.find("<f4"), 3, "<f8");
  for (const float p : pixels) {
    const double value = p;
    wide.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  put(folder / "t64.npy", wide);
  const std::string command =
      "gradients --model m.ply --data set.ubsd --split train --view 0 --target {} --out {}";
  ubs_ok(folder, fmt::format(fmt::runtime(command), "t32.npy", "a.ply"));
  ubs_ok(folder, fmt::format(fmt::runtime(command), "t64.npy", "b.ply"));
  CHECK(get(folder / "a.ply") == get(folder / "b.ply"));
}

}  // namespace
}  // namespace ubs
