// SPDX-License-Identifier: Apache-2.0
// Tests of the device check. The check must detect kernels in which one formula or one barrier is broken. If
// the check of a device fails, ubs uses another device, but reports an error if the user has selected this
// device. The results of checks, called verdicts, are stored.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/check/conformance.hpp"
#include "host/check/gate.hpp"
#include "host/check/verdicts.hpp"
#include "host/device/registry.hpp"
#include "host/opencl/platform.hpp"
#include "tests/support/changed_kernels.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/set_variable.hpp"

namespace ubs::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

const std::string kCheck = "devices --check --dim 3 --device opencl";

struct Mutation {
  const char *stage, *file, *original, *mutant;  // `stage` is the stage in which the error must be found
};

// Changes that break kernels: one formula each of the forward pass, the backward passes, Adam, the gradient
// of the loss, relocation and the tile lists, and one barrier.
constexpr Mutation kMutations[] = {
    {"projection", "math/ellipse.h", "out.cov.c = s.c + eps2d;", "out.cov.c = s.c + R(1.01) * eps2d;"},
    {"backward rasteriser", "math/blend.h", "sums.r += step.weight * v_r;",
     "sums.r += V(1.01) * step.weight * v_r;"},
    {"backward projection", "math/projection.h", "inv_z * v_j02", "V(1.01) * inv_z * v_j02"},
    {"Adam", "math/adam.h", "(R(1.0) - k.beta2)", "(R(1.00001) - k.beta2)"},
    {"gradient of the loss", "math/loss.h", "(u * square_u + v * square_v)", "(u * square_u - v * square_v)"},
    {"relocation", "math/mcmc.h", "ubs_softplus(raw_opacity) / parts",
     "ubs_softplus(raw_opacity) / (parts + V(1.0))"},
    {"lists", "opencl/tile_list_chunks.cl", "drawn += here > 0 ? 1 : 0;", "drawn += here > 1 ? 1 : 0;"},
    // Without this barrier, one work-item reads values that the other work-items have not written yet.
    {"loss", "gpu/loss.cl", "  UBS_BARRIER();\n  if (me > 0) return;", "  if (me > 0) return;"},
};

fs::path mutant(const TempFolder& folder, const Mutation& m) {
  return changed_kernels(folder, m.file, m.original, m.mutant);
}

// Returns the stages with wrong results in the output of `ubs devices --check --json`.
std::vector<std::string> wrong_stages(const Result& result) {
  std::vector<std::string> wrong;
  const Json report = Json::parse(result.out);
  for (const Json& form : report.at("devices").at(0).at("forms"))
    for (const Json& stage : form.at("stages"))
      if (!stage.at("right").get<bool>()) wrong.push_back(stage.at("stage"));
  return wrong;
}

TEST_CASE("devices --check: correct kernels pass, and one line is printed per stage") {
  const TempFolder folder;
  const Result text = ubs_ok(folder, kCheck);
  for (const char* stage :
       {"lists", "projection", "rasteriser", "backward rasteriser", "backward projection", "loss", "image",
        "gradient", "reproducibility", "Adam", "penalties", "relocation", "growth", "noise", "image metrics"})
    CHECK(text.out.find(fmt::format("\n  {} ", stage)) != std::string::npos);
  CHECK(text.out.find("WRONG") == std::string::npos);
  const Json devices = Json::parse(ubs_ok(folder, "devices --json --device opencl").out);
  CHECK(devices["devices"][devices["chosen"].get<std::size_t>()]["check"]["verdict"] == "ok");
}

TEST_CASE("devices --check: a variant that requires N = 3 is rejected with another N") {
  const TempFolder folder;
  check_error(folder, "devices --check --dim 6 --rot-mode quaternion --device none-such",
              exit_code(ErrorKind::usage), "dim = 3");
  check_error(folder, "devices --check --dim 3 --rot-mode quaternion --device none-such",
              exit_code(ErrorKind::device), "none-such");
  for (const char* dims : {"0", "6,2"})  // earlier versions reported internal errors
    check_error(folder, fmt::format("devices --check --dim {} --device none-such", dims),
                exit_code(ErrorKind::usage), "from 3 to 11");
}

TEST_CASE("the device check passes with correct kernels for Gaussians with spherical harmonics") {
  KernelConfig config;
  config.dim = 3;
  config.variant.kernel = SpatialKernel::gaussian;
  config.variant.rot_mode = RotMode::quaternion;
  config.variant.colour = ColourMode::sh1;
  const auto device = opencl::open_device(0);
  for (const check::Finding& f : check::examine(*device, {config, {check::Part::drawing}})) {
    INFO(check::text(f));
    CHECK(f.holds());
  }
}

TEST_CASE("devices --check: a broken formula or barrier in the kernels is detected") {
  for (const Mutation& m : kMutations) {
    const TempFolder folder;
    const Variable kernels("UBS_KERNEL_DIR", mutant(folder, m).c_str());
    const Result result = run_ubs(folder, kCheck + " --json");
    INFO(m.file << ": " << m.mutant << "\n" << result.out << result.err);
    CHECK(result.code == exit_code(ErrorKind::faulty));
    const std::vector<std::string> wrong = wrong_stages(result);
    CHECK(std::ranges::count(wrong, m.stage) > 0);
  }
}

// A simulated GPU: the first OpenCL device, with broken kernels.
Backend broken_gpu() {
  const auto list = [] {
    DeviceInfo info = opencl::list_devices().at(0);
    info.name = "Broken GPU";
    info.type = DeviceType::gpu;
    return std::vector{info};
  };
  return {.name = "opencl", .list_devices = list, .open_device = [](std::size_t) {
            return opencl::open_device(0);
          }};
}

TEST_CASE("first use: a broken device is skipped by default, and is an error if the user has selected it") {
  register_backend(broken_gpu());
  const TempFolder folder;
  const std::string kernels = mutant(folder, kMutations[0]).string();
  const Variable on("UBS_CHECK", "on"), any("UBS_DEVICE", nullptr);
  // No verdicts are stored for this build number.
  const std::string build = fmt::format("test-{}-{}", ::getpid(), std::time(nullptr));
  const check::Use use{[](const DeviceInfo&) {
                         KernelConfig config;
                         config.dim = 3;
                         config.backward = false;
                         return std::vector{config};
                       },
                       {check::Part::drawing}};
  std::vector<std::string> checked, warnings;
  const check::Gate gate{build,
                         [&](const DeviceInfo& info) {
                           checked.push_back(info.name);
                           if (info.name == "Broken GPU")
                             setenv("UBS_KERNEL_DIR", kernels.c_str(), 1);
                           else
                             unsetenv("UBS_KERNEL_DIR");
                         },
                         [&](const std::string& text) { warnings.push_back(text); }};
  const std::vector<DeviceInfo> devices = list_devices();
  const std::size_t broken = devices.size() - 1;
  REQUIRE(devices[broken].name == "Broken GPU");
  CHECK(choose_device(devices, "") == broken);
  // In the first round, both devices are checked. Stored verdicts depend on the kernel folder. When the first
  // round looked up the verdict of the CPU, UBS_KERNEL_DIR was still the folder of the broken kernels. So the
  // CPU is checked again in the second round. In the third round, both verdicts are found.
  for (const std::size_t checks : {2u, 1u, 0u}) {
    INFO("this round should make " << checks << " checks");
    checked.clear(), warnings.clear();
    CHECK(check::choose_verified_device("", use, gate) == 0);
    CHECK(checked.size() == checks);
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0].starts_with("Broken GPU"));
    CHECK(warnings[0].find("projection: ") != std::string::npos);
    CHECK(warnings[0].find("using " + devices[0].name) != std::string::npos);
    const std::string refused =
        message_of([&] { check::choose_verified_device("broken", use, gate); }, ErrorKind::faulty);
    CHECK(refused.find("projection: ") != std::string::npos);
  }
  CHECK(check::Verdicts(devices[broken], build).all().at(0).right == false);
  CHECK(check::Verdicts(devices[0], build).all().at(0).right);
  CHECK(check::Verdicts(devices[0], build + "x").all().empty());
  check::Verdicts(devices[0], build).keep({"form", {check::Part::loss}, true});
  check::Verdicts(devices[0], build).keep({"form", {check::Part::loss}, false, "problem"});
  REQUIRE(check::Verdicts(devices[0], build).find("form", {check::Part::loss}));
  CHECK_FALSE(check::Verdicts(devices[0], build).find("form", {check::Part::loss})->right);
  DeviceInfo other = devices[0];
  other.driver += "x";
  CHECK(check::Verdicts(other, build).all().empty());
  const Variable off("UBS_CHECK", "off");
  CHECK(check::choose_verified_device("", use, gate) == broken);
  check::Verdicts(devices[broken], build).forget();
  check::Verdicts(devices[0], build).forget();
}

// The cache folder may be shared, so another user may have written the file with the verdicts.
TEST_CASE("verdicts: invalid or deeply nested JSON in the file is ignored, and the file can be replaced") {
  const TempFolder folder;
  DeviceInfo device;
  device.name = fmt::format("Device of verdicts {}", ::getpid());
  const check::Verdict verdict{"form", {check::Part::loss}, true};
  check::Verdicts(device, "build").keep(verdict);
  REQUIRE(check::Verdicts(device, "build").all().size() == 1);
  fs::path file;
  for (const auto& entry : fs::directory_iterator(kernel_cache_folder()))
    if (entry.path().filename().string().starts_with("check-") &&
        get(entry.path()).find(device.name) != std::string::npos)
      file = entry.path();
  REQUIRE_FALSE(file.empty());
  const std::string text = get(file);
  const std::string start = text.substr(0, text.rfind('}'));
  const auto verdicts_with = [&](const std::string& more) {
    put(file, start + more + "}");
    return check::Verdicts(device, "build").all().size();
  };
  CHECK(verdicts_with(", \"more\": [[]]") == 1);
  CHECK(verdicts_with(", \"deep\": " + std::string(200, '[') + std::string(200, ']')) == 0);
  CHECK(verdicts_with(", \"builds\": {\"build\": 5}") == 0);
  CHECK(verdicts_with(", not json") == 0);
  check::Verdicts(device, "build").keep(verdict);
  CHECK(check::Verdicts(device, "build").all().size() == 1);
  fs::remove(file);
}

}  // namespace
}  // namespace ubs::test
