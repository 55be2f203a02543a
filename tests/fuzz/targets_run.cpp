// SPDX-License-Identifier: Apache-2.0
// Implements the fuzz targets for checkpoints, files in the folder of a run, and camera paths.
#include <cstring>

#include "host/base/crc32.hpp"
#include "host/look/report/run_record.hpp"
#include "host/model/keyframes.hpp"
#include "host/scene/initialise.hpp"
#include "host/train/checkpoint.hpp"
#include "tests/fuzz/files.hpp"

namespace ubs::fuzz {

namespace {

std::string small_checkpoint() {
  Checkpoint checkpoint;
  checkpoint.settings.dim = 3;
  checkpoint.settings.iterations = kScheduleLength;
  checkpoint.data = "/data";
  TrainState& state = checkpoint.state;
  state.model = initialise_random(3, 2, 1);
  state.moment1 = state.moment2 = std::vector<float>(state.model.values.size(), 0.5f);
  state.iteration = 7;
  write_checkpoint(folder() / "s.ckpt", checkpoint);
  return get(folder() / "s.ckpt");
}

}  // namespace

// The input is the header of a checkpoint as a block, followed by the arrays of numbers. This function adds
// the preamble and the checksum, because a fuzzer cannot guess them.
void run_checkpoint(Data d) {
  static const std::string magic_and_version = small_checkpoint().substr(0, 12);
  const Data header = take_block(d);
  std::string file = magic_and_version;
  add<std::uint32_t>(file, static_cast<std::uint32_t>(header.size()));
  file.append(reinterpret_cast<const char*>(header.data()), header.size());
  file.append(reinterpret_cast<const char*>(d.data()), d.size());
  add<std::uint32_t>(file, crc32(std::as_bytes(std::span(file))));
  const fs::path path = put("x.ckpt", {reinterpret_cast<const std::uint8_t*>(file.data()), file.size()});
  expect_error_only([&] { read_checkpoint(path); });
}

std::vector<std::string> seed_checkpoint() {
  const std::string file = small_checkpoint();
  std::uint32_t length = 0;
  std::memcpy(&length, file.data() + 12, sizeof length);
  return {block(file.substr(16, length)) + file.substr(16 + length, file.size() - 20 - length)};
}

// The input consists of three blocks, which are the contents of metrics.json, log.csv and config.yaml.
void run_run_folder(Data d) {
  for (const char* name : {"run/metrics.json", "run/log.csv", "run/config.yaml"}) {
    fs::create_directories(folder() / "run");
    put(name, take_block(d));
  }
  expect_error_only([] {
    const RunRecord run = read_run(folder() / "run");
    run.number({"test", "mean", "psnr"});
    run.text({"device", "name"});
  });
}

std::vector<std::string> seed_run_folder() {
  const std::string metrics =
      R"({"test":{"mean":{"psnr":31.5,"ssim":null},"views":[{"name":"a","psnr":3}]},"device":{"name":"x"}})";
  const std::string log =
      "iteration,seconds,loss,splats,test_psnr,test_ssim,sample_psnr,sample_views\n"
      "10,0.5,0.25,100,,,19.5,4\n20,1,0.2,100,20.5,0.5,,\n";
  const std::string config = "# settings\ndim: 6\nbackground: [0, 0, 0]\nlr_rgb: 0.001\n";
  return {block(metrics) + block(log) + block(config),
          block(metrics) + block(log) + block(config + "unknown: &a [1, *a]\n")};
}

void run_keyframes(Data d) {
  const fs::path path = put("x.json", d);
  expect_error_only([&] { read_keyframes(path, {}); });
}

std::vector<std::string> seed_keyframes() {
  return {
      R"({"closed":true,"keyframes":[{"position":[1,2,3],"look_at":[0,0,0],"up":[0,0,1],"fov":50,"time":0.5},)"
      R"({"world_to_camera":[[1,0,0,1],[0,1,0,2],[0,0,1,3]],"time":0},{"time":1,"transform_matrix":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}]})",
      R"({"camera_type":"perspective","render_width":4,"render_height":3,"is_cycle":true,"camera_path":[)"
      R"({"camera_to_world":[1,0,0,0,0,1,0,0,0,0,1,3,0,0,0,1],"fov":50,"aspect":1.5}]})",
      R"([{"id":0,"width":128,"position":[0,0,-3],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fx":110.0}])",
      R"({"camera":{"fov":60},"animTracks":[{"loopMode":"repeat","keyframes":{"times":[0,30],"values":)"
      R"({"position":[0,0,3,1,0,3],"target":[0,0,0,0,0,0]}}}]})"};
}

}  // namespace ubs::fuzz
