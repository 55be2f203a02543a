// SPDX-License-Identifier: Apache-2.0
// Trains and renders a scene of two tiles with OpenCL, which runs nearly all kernels. The scene is small
// enough for a simulator (tests/gates/README.md):
//   gate_scene cpu|gpu [FOLDER]
// With `cpu`, the program uses the kernels and the vector width that the host selects for CPUs, and with
// `gpu` those for GPUs. Both are possible on any device. If FOLDER is given, every program is written to this
// folder as the host passes it to a driver. NAME.cl contains the source. NAME.options contains the options in
// its first line, and the names of the kernels in the following lines. In this case the device is treated as
// if it were not a device of PoCL, because programs for PoCL contain code that other compilers do not
// support.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>

#include "host/base/error.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/model/contributions.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/opencl/platform.hpp"
#include "host/opencl/sources.hpp"
#include "host/train/trainer.hpp"
#include "tests/support/published.hpp"

namespace {

using namespace ubs;

constexpr int kDim = 6, kIterations = 2, kSplats = 20, kRoom = 24, kWidth = 20, kHeight = 12;

std::unique_ptr<Device> open_first(bool gpu, bool export_programs) {
  const std::vector<DeviceInfo> all = opencl::list_devices();
  if (all.empty()) fail(ErrorKind::device, "there is no OpenCL device: install a driver");
  std::vector<cl_platform_id> platforms(8);
  cl_uint count = 0;
  opencl::check(clGetPlatformIDs(8, platforms.data(), &count), "clGetPlatformIDs");
  cl_device_id device = nullptr;
  DeviceInfo info = all[0];  // a device of the first platform that has devices
  for (cl_uint i = 0; i < count && device == nullptr; ++i)
    if (clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_ALL, 1, &device, nullptr) == CL_SUCCESS)
      platforms[0] = platforms[i];
  info.type = gpu ? DeviceType::gpu : DeviceType::cpu;
  info.float_vector_width = gpu ? 1 : std::max(4u, info.float_vector_width);
  if (export_programs) info.platform = "no platform";
  return std::make_unique<opencl::OpenclDevice>(platforms[0], device, info);
}

// Returns an initial model in which some splats are dead, so that relocation has an effect.
SplatModel initial(const SplatModel& from) {
  SplatModel model = from;
  const int opacity = model.layout().opacity;
  for (std::size_t i = 0; i < model.count; i += 10) model.row(opacity)[i] = -12;
  return model;
}

void require(bool holds, const char* what) {
  if (!holds) fail(ErrorKind::internal, "gate_scene: {}", what);
}

// Trains a model and returns the loss. The settings are chosen such that as many kernels as possible run:
// tile lists are built without waiting for their size, the gradients of two views are added, one view has a
// mask, splats are relocated, added and displaced by noise, and there are penalties for opacities and scales.
double train(Device& device, bench::BenchScene scene, const std::string& raster) {
  View& masked = scene.views.views[1];
  masked.image.mask.assign(kWidth * kHeight, 1);
  for (std::size_t i = 0; i < masked.image.mask.size(); i += 7) masked.image.mask[i] = 0;
  masked.masked = true;
  TrainSettings settings = test::published();
  settings.raster = raster;
  settings.dim = kDim;
  settings.iterations = kIterations;
  settings.batch = 2;
  settings.list_counts = ListCounts::bound;
  settings.refine.first = 0;
  settings.cap_max = kRoom;
  settings.growth = 1.1;
  settings.scale_penalty = 0.01;
  settings.log_every = 1;
  const Split test{"test", {scene.views.views[0]}};
  Trainer trainer(device, settle(settings), scene.views, test, initial(scene.model));
  double loss = 0, psnr = 0;
  trainer.run([&](const StepReport& report) {
    if (report.loss) loss = *report.loss;
    if (report.test) psnr = report.test->mean.psnr;
    return true;
  });
  require(std::isfinite(loss) && loss > 0, "the loss is not a positive number");
  require(std::isfinite(psnr) && psnr > 3, "the rendered view does not resemble its target");
  require(trainer.model().count > scene.model.count, "no splat was added");
  return loss;
}

// Renders the first view with depth. In contrast to train(), the host waits for the size of the tile lists.
// Returns the largest weight of a splat in a pixel.
float largest_weight(Device& device, const bench::BenchScene& scene, RasterKind raster) {
  const DeviceGroups groups(device, MixedModel(scene.model), {.raster = raster, .depth = true});
  Renderer renderer(device, groups.stages());
  renderer.set_cameras(cameras_of(scene.views));
  const reduce::Contributions weights = reduce::measure_contributions(device, renderer, groups, {}, 1);
  const float most = *std::ranges::max_element(weights.most);
  require(most > 0 && most <= 1, "the largest weight of a splat is not in (0, 1]");
  return most;
}

void write_programs(const Device& device, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  std::map<std::string, int> seen;
  for (const ProgramUse& use : device.programs()) {
    std::vector<std::string> sources;
    std::string all = use.sources;
    for (std::size_t at; (at = all.find(" + ")) != all.npos; all.erase(0, at + 3))
      sources.push_back(all.substr(0, at));
    sources.push_back(all);
    std::string name = std::filesystem::path(all).stem().string();
    if (const int copy = seen[name]++; copy > 0) name += fmt::format("_{}", copy + 1);
    std::ofstream(folder / (name + ".cl")) << opencl::assemble(sources);
    std::ofstream options(folder / (name + ".options"));
    options << use.options << "\n";
    for (const std::string& kernel : use.kernels) options << kernel << "\n";
    if (!options.flush()) fail(ErrorKind::data, "{}: cannot be written", (folder / name).string());
  }
}

int run(bool gpu, const std::string& folder) {
  const auto device = open_first(gpu, !folder.empty());
  const bench::BenchScene scene = bench::synthetic_object(kDim, kSplats, kWidth, kHeight, 2);
  const double loss = train(*device, scene, gpu ? "gpu" : "cpu");
  const float weight = largest_weight(*device, scene, gpu ? RasterKind::gpu : RasterKind::cpu);
  if (!folder.empty()) write_programs(*device, folder);
  std::set<std::string> kernels;
  for (const ProgramUse& use : device->programs()) kernels.insert(use.kernels.begin(), use.kernels.end());
  std::printf("%s: %zu kernels, loss %.6f, largest weight %.6f\n", describe(device->info()).c_str(),
              kernels.size(), loss, weight);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string kind = argc > 1 ? argv[1] : "";
  if ((kind != "cpu" && kind != "gpu") || argc > 3) {
    std::fprintf(stderr, "usage: gate_scene cpu|gpu [FOLDER]\n");
    return exit_code(ErrorKind::usage);
  }
  setenv("UBS_TUNING", "off", 1);
  try {
    return run(kind == "gpu", argc > 2 ? argv[2] : "");
  } catch (const Error& error) {
    std::fprintf(stderr, "gate_scene: %s\n", error.what());
    return exit_code(error.kind());
  }
}
