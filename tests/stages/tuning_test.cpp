// SPDX-License-Identifier: Apache-2.0
// Tests tuned constants: the table of constants agrees with the kernel sources, tuning files are written,
// used, and ignored if they are damaged or belong to another device, and tuned kernels give the same results
// as the defaults.
#include <algorithm>
#include <catch2/catch.hpp>
#include <regex>

#include "host/base/error.hpp"
#include "host/device/kernel_sources.hpp"
#include "host/lab/bench/step_bench.hpp"
#include "host/lab/bench/tuner.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/opencl/opencl_tuning.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/source_folder.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

using namespace opencl;
using test::get;
using test::put;
using test::TempFolder;
using test::Variable;

struct TuningFolder {
  TempFolder folder;
  Variable place{"UBS_TUNING_DIR", folder.path().c_str()}, on{"UBS_TUNING", nullptr};
};

const DeviceInfo kDevice{.platform = "Platform \"P\"", .name = "Device D", .driver = "1.0"};

OpenclDevice& opencl_of(Device& device) { return dynamic_cast<OpenclDevice&>(device); }

TEST_CASE("the defaults in the table of tuned constants are those in the kernel sources") {
  for (const TunedConstant& constant : tuned_constants()) {
    INFO(constant.macro << " in " << constant.source);
    const std::string macro(constant.macro);
    if (constant.source.starts_with("host/")) {  // the constant is only used by host code
      const std::string text = get(test::source_folder() / constant.source);
      CHECK(text.find("tuned_value(device.info().tuning, \"" + macro + "\")") != std::string::npos);
      continue;
    }
    const std::string text = kernel_source(std::string(constant.source));
    const std::regex pattern("#ifndef " + macro + "\n#define " + macro + " (\\d+)\\b");
    std::smatch found;
    REQUIRE(std::regex_search(text, found, pattern));
    CHECK(std::stoul(found[1]) == constant.standard);
    CHECK(std::ranges::any_of(constant.candidates, [&](unsigned v) { return v != constant.standard; }));
    CHECK(!constant.stages.empty());
    // The macro must also be used, not only defined.
    const std::string rest = found.suffix();
    CHECK(rest.find(macro) != std::string::npos);
  }
}

TEST_CASE("every constant with an #ifndef default in the tunable kernels is in the table") {
  for (const char* name :
       {"opencl/raster_cpu.cl", "gpu/raster_backward.cl", "opencl/slot_sum.cl", "gpu/sum_slots.cl",
        "gpu/loss.cl", "opencl/tile_list_chunks.cl", "map/project.cl"}) {
    const std::string text = kernel_source(name);
    const std::regex pattern("#ifndef (UBS_\\w+)\n#define UBS_\\w+ \\d+");
    for (auto it = std::sregex_iterator(text.begin(), text.end(), pattern); it != std::sregex_iterator();
         ++it) {
      INFO(name << ": " << it->str(1));
      CHECK(std::ranges::count_if(tuned_constants(), [&](const TunedConstant& c) {
              return c.macro == it->str(1) && c.source == name;
            }) == 1);
    }
  }
}

TEST_CASE("values are saved and loaded separately for each kind of rasteriser") {
  const TuningFolder folder;
  CHECK(load_tuning(kDevice, tuned_constants()).empty());
  save_tuning(kDevice, tuned_constants(), RasterKind::cpu, {{"UBS_CHUNK", 32}, {"UBS_SUM_GROUP", 128}});
  save_tuning(kDevice, tuned_constants(), RasterKind::gpu, {{"UBS_LOSS_GROUP", 64}});
  CHECK(load_tuning(kDevice, tuned_constants()) ==
        TuningValues{{"UBS_CHUNK", 32}, {"UBS_SUM_GROUP", 128}, {"UBS_LOSS_GROUP", 64}});
  save_tuning(kDevice, tuned_constants(), RasterKind::cpu, {});
  CHECK(load_tuning(kDevice, tuned_constants()) == TuningValues{{"UBS_LOSS_GROUP", 64}});
  const Variable off("UBS_TUNING", "off");
  CHECK(load_tuning(kDevice, tuned_constants()).empty());
}

TEST_CASE("the folder of tuning files depends on the environment") {
  const Variable own("UBS_TUNING_DIR", ""), cache("XDG_CACHE_HOME", "/caches"),
      home("HOME", "/home/somebody");
  CHECK(tuning_file(kDevice).parent_path() == "/caches/ubs");
  const Variable no_cache("XDG_CACHE_HOME", nullptr);
  CHECK(tuning_file(kDevice).parent_path() == "/home/somebody/.cache/ubs");
  const Variable no_home("HOME", nullptr);
  CHECK(tuning_file(kDevice).empty());
  CHECK(load_tuning(kDevice, tuned_constants()).empty());
  CHECK_THROWS_AS(save_tuning(kDevice, tuned_constants(), RasterKind::cpu, {}), Error);
  DeviceInfo newer = kDevice;
  newer.driver = "1.1";
  const Variable back("UBS_TUNING_DIR", "/t");
  CHECK(tuning_file(newer) != tuning_file(kDevice));
}

TEST_CASE("damaged tuning files, and those for other devices, are ignored") {
  const TuningFolder folder;
  save_tuning(kDevice, tuned_constants(), RasterKind::cpu, {{"UBS_CHUNK", 32}});
  const std::string good = get(tuning_file(kDevice));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    REQUIRE(text.find(from) != std::string::npos);
    text.replace(text.find(from), from.size(), to);
    put(tuning_file(kDevice), text);
    return load_tuning(kDevice, tuned_constants());
  };
  CHECK(with("32", "32") == TuningValues{{"UBS_CHUNK", 32}});
  CHECK(with("Device D", "Device E").empty());
  CHECK(with("\"format\": 1", "\"format\": 2").empty());
  CHECK(with("values", "other").empty());
  CHECK(with("UBS_CHUNK", "UBS_N").empty());  // this macro is not a tuned constant
  CHECK(with("32", "33").empty());            // the value is not a candidate and would break the kernel
  CHECK(with("32", "-32").empty());
  CHECK(with("32", "\"32; rm -rf\"").empty());  // a string must never become an option of the compiler
  CHECK(with("\"UBS_CHUNK\": 32", "\"UBS_NONE\": 1, \"UBS_CHUNK\": 48") == TuningValues{{"UBS_CHUNK", 48}});
  for (const std::size_t length : {std::size_t{0}, std::size_t{1}, good.size() / 2}) {
    put(tuning_file(kDevice), good.substr(0, length));
    CHECK(load_tuning(kDevice, tuned_constants()).empty());
  }
  put(tuning_file(kDevice), "[]");
  CHECK(load_tuning(kDevice, tuned_constants()).empty());
  // This folder cannot be accessed, even by the user root.
  std::filesystem::create_symlink("loop", folder.folder / "loop");
  const Variable loop("UBS_TUNING_DIR", (folder.folder / "loop").c_str());
  CHECK(load_tuning(kDevice, tuned_constants()).empty());
}

TEST_CASE("opening a device loads its tuning file, and kernels are built with the values of this file") {
  const TuningFolder folder;
  const std::vector<DeviceInfo> devices = list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i) {
    if (devices[i].backend != "opencl") continue;
    CHECK(devices[i].tuning.empty());
    save_tuning(devices[i], tuned_constants(), RasterKind::cpu, {{"UBS_CHUNK", 32}, {"UBS_LOSS_TILE", 48}});
    const auto device = open_device(i);
    CHECK(device->info().tuning.size() == 2);
    const OpenclDevice& opened = opencl_of(*device);
    const auto options = opened.tuned({{"opencl/raster_cpu.cl"}, {"-DUBS_VW=16"}}).options;
    CHECK(options == std::vector<std::string>{"-DUBS_VW=16", "-DUBS_CHUNK=32"});
    CHECK(opened.tuned({{"map/adam.cl"}, {}}).options.empty());
    // An option that host code has already set is not changed.
    CHECK(opened.tuned({{"gpu/loss.cl"}, {"-DUBS_LOSS_TILE=64"}}).options.size() == 1);
    save_tuning(devices[i], tuned_constants(), RasterKind::cpu, {});
  }
}

// Tests the last candidate of each constant except UBS_LOSS_TILE_GPU, or all candidates of these constants
// with UBS_TEST_ALL=1. Host and kernel must use the same values: otherwise pixels are lost or launches fail.
// In most cases, the results are bit-identical to those of the defaults. With other tiles of the loss, the
// largest observed difference is 2.4e-6, for gradients whose terms cancel. With other batches of the GPU
// rasteriser, differences are below 4e-7.
TEST_CASE("candidates of tuned constants do not change the results of a training step") {
  const bench::BenchScene scene = bench::synthetic_object(3, 1500, 70, 50, 1);
  for (const auto& device : opencl_devices_under_test()) {
    OpenclDevice& opened = opencl_of(*device);
    for (const RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
      opened.set_tuning({});
      const bench::Parts expected = bench::StepBench(*device, scene, raster).outputs();
      for (const std::vector<float>& part : expected)  // a part with only zeros would not show a difference
        REQUIRE(std::ranges::any_of(part, [](float v) { return v != 0; }));
      // Tests the n-th candidates of all constants at the same time, which needs fewer builds. The last set
      // has the last candidate of each constant.
      for (const std::size_t n :
           test::whole_sweep() ? std::vector<std::size_t>{0, 1, 2, 3, 4} : std::vector<std::size_t>{4}) {
        TuningValues values;
        for (const TunedConstant& c : tuned_constants())
          if (c.raster == raster && (n < c.candidates.size() || n == 4) && c.macro != "UBS_LOSS_TILE_GPU")
            values[std::string(c.macro)] = c.candidates[std::min(n, c.candidates.size() - 1)];
        if (values.empty()) continue;
        INFO(device->info().name << ", set " << n << ", raster " << static_cast<int>(raster));
        opened.set_tuning(values);
        CHECK(bench::relative_difference(bench::StepBench(*device, scene, raster).outputs(), expected) <
              4.8e-6);
      }
    }
    opened.set_tuning({});
  }
}

TEST_CASE("a candidate is only chosen if it is faster by two per cent and by three standard errors") {
  const auto trial = [](double ratio, double uncertainty, const char* note = "") {
    return bench::Trial{.macro = "M", .ratio = ratio, .uncertainty = uncertainty, .note = note};
  };
  CHECK(bench::clearly_faster(trial(0.97, 0.005)));
  CHECK_FALSE(bench::clearly_faster(trial(0.985, 0)));
  CHECK_FALSE(bench::clearly_faster(trial(0.95, 0.02)));
  CHECK_FALSE(bench::clearly_faster(trial(0, 0, "does not run on this device")));
  CHECK(bench::relative_difference({{1, 2}}, {{1, 2}}) == 0);
  // Parts are compared separately, so that a part with large values does not hide the error of another part.
  CHECK(bench::relative_difference({{100}, {1}}, {{100}, {2}}) == 0.5);
  CHECK(std::isinf(bench::relative_difference({{1}}, {{1, 2}})));
  CHECK(std::isinf(bench::relative_difference({{0}, {NAN}}, {{0}, {1}})));
}

}  // namespace
}  // namespace ubs
