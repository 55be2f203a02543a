// SPDX-License-Identifier: Apache-2.0
// Rows about files: damaged and poisoned ones end in one line that names the file, never in a model or a data
// set that is silently wrong.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/data/dataset.hpp"
#include "host/data/ply.hpp"
#include "host/stress/row.hpp"
#include "host/stress/row_scene.hpp"

namespace ubs::stress {
namespace {

namespace fs = std::filesystem;

// The action must end in Error(data) that names `file`; returns whether it was refused.
template <class Action>
bool refuses(RowRun& run, const std::string& file, const std::string& what, const Action& action) {
  run.count(1);
  try {
    action();
    return false;
  } catch (const Error& error) {
    const bool kind = error.kind() == ErrorKind::data || error.kind() == ErrorKind::numerical;
    run.require(kind && std::string(error.what()).find(file) != std::string::npos,
                fmt::format("{}: the message does not name {}: {}", what, file, error.what()));
    return true;
  }
}

void models(RowRun& run) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "model.ply";
  const SplatModel model = ordinary_case("file", 6, 5).model;
  write_splat_ply(path, model);
  const std::string whole = read_text_file(path);
  const auto read = [&](const std::string& content) {
    write_file_atomically(path, content);
    return read_splat_ply(path);
  };
  for (std::size_t length = 0; length < whole.size(); length += 13)
    run.require(refuses(run, "model.ply", "a PLY cut short", [&] { read(whole.substr(0, length)); }),
                fmt::format("a PLY of {} of {} bytes is read", length, whole.size()));
  for (const char* count : {"-1", "99999999999999999999", "4611686018427387904", "6", "nan"}) {
    std::string text = whole;
    text.replace(text.find("vertex 5") + 7, 1, count);
    run.require(refuses(run, "model.ply", "a wrong count", [&] { read(text); }),
                fmt::format("a PLY with count {} is read", count));
  }
  const std::size_t data = whole.size() - 5 * 35 * 4;
  for (const float value : {NAN, INFINITY, -INFINITY}) {
    std::string text = whole;
    std::memcpy(text.data() + data + 4 * 17, &value, 4);
    SplatModel loaded;
    const bool refused =
        refuses(run, "model.ply", "a value that is not finite", [&] { loaded = read(text); });
    run.require(refused || std::ranges::all_of(loaded.values, [](float v) { return std::isfinite(v); }),
                fmt::format("a PLY with {} is read as it stands", value));
  }
  SplatModel poisoned = model;
  poisoned.values[7] = NAN;
  remove_path(path);
  run.require(refuses(run, "model.ply", "writing NaN", [&] { write_splat_ply(path, poisoned); }) &&
                  !path_exists(path),
              "a model with NaN is written");
}

void cameras(RowRun& run) {
  const TemporaryFolder folder;
  save_case(row_case("file", 6, 1), folder.path());
  const fs::path path = folder.path() / "transforms_test.json";
  const std::string whole = read_text_file(path);
  DatasetOptions options;
  options.load_images = false;
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    const std::size_t at = text.find(from);
    run.require(at != std::string::npos, "the JSON file has no " + from);
    text.replace(at, from.size(), to);
    write_file_atomically(path, text);
    const bool refused = refuses(run, "transforms_test.json", from + " -> " + to,
                                 [&] { load_dataset(folder.path(), options); });
    run.require(refused, fmt::format("a data folder with {} instead of {} is read", to, from));
  };
  with("\"fl_x\": 32.0", "\"fl_x\": NaN");
  with("\"fl_x\": 32.0", "\"fl_x\": 1e999");
  with("\"fl_x\": 32.0", "\"fl_x\": -1");
  with("\"w\": 32", "\"w\": 0");
  with("\"w\": 32", "\"w\": 1e12");
  with("\"w\": 32", "\"w\": 1.5");
  with("\"time\": 0.5", "\"time\": \"nan\"");
  with("\"frames\"", "\"nothing\"");
  for (std::size_t length = 0; length < whole.size(); length += 29)
    run.require(refuses(run, "transforms_test.json", "JSON cut short",
                        [&] {
                          write_file_atomically(path, whole.substr(0, length));
                          load_dataset(folder.path(), options);
                        }),
                fmt::format("a JSON file of {} of {} bytes is read", length, whole.size()));
}

void colmap(RowRun& run) {
  const TemporaryFolder folder;
  make_folders(folder.path() / "sparse" / "0");
  const auto put = [&](const char* name, const std::string& text) {
    write_file_atomically(folder.path() / "sparse" / "0" / name, text);
  };
  DatasetOptions options;
  options.load_images = false;
  const auto load = [&] { load_dataset(folder.path(), options); };
  const std::string camera = "1 PINHOLE 32 24 32 32 16 12\n", image = "1 1 0 0 0 0 0 2 1 a.png\n\n";
  put("points3D.txt", "1 0 0 1 10 20 30 0.5\n2 1 0 1 10 20 30 0.5\n");
  const auto refused = [&](const char* file, const std::string& text) {
    put("cameras.txt", camera), put("images.txt", image);
    put(file, text);
    run.require(refuses(run, file, text, load), fmt::format("{} with '{}' is read", file, text));
  };
  for (const char* bad : {"nan(ind)", "inf", "-nan", "1e400", "x"}) {
    refused("cameras.txt", fmt::format("1 PINHOLE 32 24 {} 32 16 12\n", bad));
    refused("images.txt", fmt::format("1 {} 0 0 0 0 0 2 1 a.png\n\n", bad));
  }
  refused("images.txt", "1 1 0 0 0 0 0 2 9 a.png\n\n");  // a camera that there is not
  refused("images.txt", "1 0 0 0 0 0 0 2 1 a.png\n\n");  // a quaternion of length 0
}

}  // namespace

std::vector<Row> file_rows() {
  return {{"27.models", "PLY files cut short, with wrong counts, NaN and infinities", models},
          {"27.cameras", "transforms JSON cut short, with NaN, zero and huge sizes", cameras},
          {"27.colmap", "COLMAP text with nan(ind), inf, missing cameras, zero quaternions", colmap}};
}

}  // namespace ubs::stress
