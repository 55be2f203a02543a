// SPDX-License-Identifier: Apache-2.0
// Compiles the programs that the CUDA back end compiles at run time with the real NVRTC, which needs no GPU.
// The programs are compiled for sm_90, and each value of each setting that selects code occurs at least once.
// The results of variants are tested by test_variants and test_work, on devices and with --cuda-on-host.
#include <fmt/ranges.h>

#include <catch2/catch.hpp>
#include <fstream>
#include <regex>
#include <set>

#include "cuda_backend/compiler.hpp"
#include "cuda_backend/dynamic_library.hpp"
#include "cuda_backend/kernel_choice.hpp"
#include "host/base/error.hpp"
#include "host/scene/frozen_groups.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/variants.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

constexpr int kHopper = 90;

bool compiler_exists() {
  try {
    WARN(cuda::compiler_version());
    return true;
  } catch (const Error& error) {
    WARN("SKIPPED: " << error.what());
    return false;
  }
}

// Returns a small set of configurations that together contain every value of every setting that selects code.
// If a setting can be used with any number of dimensions, the configuration has few dimensions, because
// programs with many dimensions take ten times as long to compile.
std::vector<KernelConfig> configurations() {
  std::vector<KernelConfig> all;
  const std::set<std::string> names{
      "3DGS", "6DGS", "skew_nd whiten sh2 antialias", "exp", "taylor2", "cayley", "direct gaussian"};
  for (const test::NamedVariant& v : test::named_variants())
    if (names.contains(v.name))
      all.push_back({.dim = v.dim, .query_grad = v.query_grad, .variant = v.variant});
  for (std::size_t i = 0; i < 3; ++i) all[i].dim = 4;  // the variants taylor2, cayley and exp
  all[1].variant.beta_opacity = BetaOpacity::none;
  all[1].variant.colour = ColourMode::sh0;
  all[2].variant.colour = ColourMode::sh1;
  const KernelConfig plain{.dim = 3};
  const auto add = [&](auto change) {
    all.push_back(plain);
    change(all.back());
  };
  add([](KernelConfig& c) { c.alpha_min = 1.0f / 255, c.depth = true, c.depth_grad = true; });
  add([](KernelConfig& c) { c.absgrad = true; });
  add([](KernelConfig& c) {
    c.query_grad = c.gaussian_arrays = true;
    c.variant = {.rot_mode = RotMode::quaternion,
                 .kernel = SpatialKernel::gaussian,
                 .colour = ColourMode::sh3,
                 .antialias = Antialias::on};
  });
  // The kernels for N > 7 are not compiled ahead of time.
  add([](KernelConfig& c) { c.dim = 8, c.query_grad = true; });
  if (test::whole_sweep()) add([](KernelConfig& c) { c.dim = 11; });
  add([](KernelConfig& c) { c.math = MathMode::native; });
  add([](KernelConfig& c) { c.math = MathMode::rough; });
  add([](KernelConfig& c) { c.frozen = frozen_groups(ParameterLayout(3, {}), "xyz,scale,l_triangle"); });
  add([](KernelConfig& c) {
    c.variant.kernel = SpatialKernel::gaussian, c.backward = false, c.depth = true;
  });
  return all;
}

struct KernelUse {
  // `spilled` consists of the number of bytes stored, "+", and the number of bytes loaded.
  std::string kernel, registers, spilled;
};
std::vector<KernelUse> kernel_uses(const std::string& log) {
  static const std::regex line(
      "Compiling entry function '(\\w+)'|(\\d+) bytes spill stores, (\\d+) bytes spill loads|Used (\\d+) "
      "registers");
  std::vector<KernelUse> uses;
  for (std::sregex_iterator at(log.begin(), log.end(), line), end; at != end; ++at) {
    const std::smatch& m = *at;
    if (m[1].matched)
      uses.push_back({m[1], "", ""});
    else if (!uses.empty() && m[4].matched)
      uses.back().registers = m[4];
    else if (!uses.empty())
      uses.back().spilled = m[2].str() + "+" + m[3].str();
  }
  return uses;
}

TEST_CASE("the kernels of all settings compile for sm_90, and rasterisers do not spill registers", "[cuda]") {
  if (!compiler_exists()) return;
  std::ofstream report("cuda_programs_sm90.csv");  // for developers, in the working folder of the test
  report << "kernel,options,registers,spill_bytes\n";
  std::set<std::string> seen;
  for (const KernelConfig& config : configurations())
    for (const cuda::ProgramSpec& spec : cuda::run_time_programs(config)) {
      const std::string name = fmt::format("{} {}", spec.file, fmt::join(spec.options, " "));
      if (!seen.insert(name).second) continue;
      INFO(name);
      const cuda::CompiledProgram compiled = cuda::compile_program(spec, kHopper);
      CHECK_THAT(compiled.log, !Catch::Contains("warning"));
      for (const std::string& kernel : spec.kernels)
        CHECK(compiled.binary.find(".text." + kernel) != std::string::npos);
      const std::vector<KernelUse> uses = kernel_uses(compiled.log);
      CHECK(uses.size() == spec.kernels.size());
      for (const KernelUse& use : uses) {
        report << fmt::format("{},{},{},{}\n", use.kernel, fmt::join(spec.options, " "), use.registers,
                              use.spilled);
        INFO(use.kernel);
        CHECK(!use.registers.empty());
        if (use.kernel.starts_with("raster_")) CHECK(use.spilled == "0+0");
      }
    }
  CHECK(seen.size() > 20);
}

TEST_CASE("with the default variant and N = 7, only the gradient of the camera is compiled at run time",
          "[cuda]") {
  for (const bool depth : {true, false}) {
    CHECK(cuda::run_time_programs({.dim = 7, .depth = depth, .backward = false}).empty());
    const std::vector<cuda::ProgramSpec> programs = cuda::run_time_programs({.dim = 7, .depth = depth});
    REQUIRE(programs.size() == 1);
    CHECK(programs[0].kernels == std::vector<std::string>{"camera_backward"});
  }
  CHECK(cuda::run_time_programs({.dim = 7, .query_grad = true}).size() == 2);
  CHECK(cuda::run_time_programs({.dim = 8}).size() == 3);  // projection, camera, parameters
}

TEST_CASE("for a GPU that is newer than the compiler, programs are compiled to PTX", "[cuda]") {
  if (!compiler_exists()) return;
  const cuda::ProgramSpec spec{"cuda_backend/map_parameters.cuh", {"adam_step"}, {"-DUBS_N=3"}};
  CHECK(cuda::compile_program(spec, 999).binary.find(".visible .entry adam_step(") != std::string::npos);
  CHECK(test::message_of([&] { cuda::compile_program(spec, 10); }, ErrorKind::device).find("sm_10") !=
        std::string::npos);
}

TEST_CASE("compiled programs are cached, and compiled again if a cache file is damaged", "[cuda]") {
  if (!compiler_exists()) return;
  const test::TempFolder folder;
  ::setenv("UBS_KERNEL_CACHE", folder.path().c_str(), 1);
  cuda::ProgramSpec spec{"cuda_backend/map_parameters.cuh", {"adam_step"}, {"-DUBS_N=3"}};
  const std::string binary = cuda::cached_binary(spec, kHopper);
  REQUIRE(test::file_count(folder.path()) == 1);
  const std::filesystem::path file = *std::filesystem::directory_iterator(folder.path());
  const std::string whole = test::get(file);
  CHECK(whole.size() == binary.size() + 4);
  std::string other = whole;
  CHECK(cuda::cached_binary(spec, kHopper) == binary);
  other[other.size() / 2] = static_cast<char>(other[other.size() / 2] ^ 1);
  for (const std::string& damaged : {other, whole.substr(0, 100), std::string()}) {
    test::put(file, damaged);
    CHECK(cuda::cached_binary(spec, kHopper) == binary);
    CHECK(test::get(file) == whole);
  }
  spec.options = {"-DUBS_N=4"};
  CHECK(cuda::cached_binary(spec, kHopper) != binary);
  CHECK(test::file_count(folder.path()) == 2);
  ::unsetenv("UBS_KERNEL_CACHE");
}

TEST_CASE("an NVRTC whose code is too new for the driver is not selected", "[cuda]") {
  using Names = std::vector<std::string>;
  CHECK(cuda::toolkit_names("libnvrtc", "11.2", 12040) ==
        Names{"libnvrtc.so.12", "libnvrtc.so.11.2", "libnvrtc.so", "/usr/local/cuda/lib64/libnvrtc.so"});
  CHECK(cuda::toolkit_names("libnvrtc", "11.2", 13010).front() == "libnvrtc.so.13");
  CHECK(cuda::toolkit_names("libnvrtc", "11.2", 11080).front() == "libnvrtc.so.11.2");
  const Names newer_first{"libnvrtc_that_is_not_there.so", UBS_NVRTC_13, UBS_NVRTC_12};
  const auto version_for = [&](int driver) {
    int major = 0, minor = 0;
    reinterpret_cast<int (*)(int*, int*)>(dlsym(cuda::open_nvrtc(newer_first, driver), "nvrtcVersion"))(
        &major, &minor);
    return major;
  };
  CHECK(version_for(13000) == 13);
  CHECK(version_for(14000) == 13);
  CHECK(version_for(0) == 13);  // without a driver, any version is accepted
  CHECK(version_for(12040) == 12);
  const std::string message =
      test::message_of([&] { cuda::open_nvrtc(newer_first, 11080); }, ErrorKind::device);
  CHECK(message.find("has version 12.2, whose code is too new for the driver, which supports CUDA 11.8") !=
        std::string::npos);
  CHECK(test::message_of([] { cuda::open_nvrtc({}, 12040); }, ErrorKind::device).find("libnvrtc.so") !=
        std::string::npos);
}

TEST_CASE("a compilation failure is a build error that contains the message of the compiler", "[cuda]") {
  if (!compiler_exists()) return;
  const cuda::ProgramSpec spec{"cuda_backend/map_parameters.cuh", {"adam_step"}, {"-DUBS_N=not_a_number"}};
  try {
    cuda::compile_program(spec, kHopper);
    FAIL("the program was compiled although its options are invalid");
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::build);
    CHECK(std::string(error.what()).find("not_a_number") != std::string::npos);
  }
}

}  // namespace
}  // namespace ubs
