// SPDX-License-Identifier: Apache-2.0
// Tests how the OpenCL back end calls the driver: it must flush queues in time, write from pinned memory,
// launch few kernels, and adapt to the limits that a driver reports. For this, this file defines some
// functions of OpenCL, which record the calls, may return simulated answers, and otherwise call the functions
// of the OpenCL loader.
#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numeric>
#include <optional>

#include "host/base/temporary_folder.hpp"
#include "host/base/warning.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/opencl/platform.hpp"
#include "host/opencl/projection.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/source_folder.hpp"

namespace {

struct Copy {
  const std::byte* from;
  std::size_t bytes;
};
std::vector<std::string> calls;             // names of launched kernels, and "flush" for each call of clFlush
std::map<std::string, std::size_t> groups;  // size of the work-groups of each launched kernel
// `pinned` contains the blocks of pinned memory that were mapped. `writes` contains the host memory that
// clEnqueueWriteBuffer() was called with.
std::vector<Copy> pinned, writes;

// Values that the functions below return instead of those of the driver, unless they are 0.
struct Answers {
  cl_device_type type = 0;
  std::size_t device_items = 0, kernel_items = 0;  // maximum work-group size of the device and of a kernel
  // Local memory of the device, and local memory that a kernel requires.
  cl_ulong device_local_bytes = 0, kernel_local_bytes = 0;
  std::size_t sub_group_items = 0;
  const char* extensions = nullptr;  // replaces all extensions of the device
};
Answers answers;
cl_ulong most_local_bytes = 0;  // largest local memory of a launched kernel

// Copies a simulated value to `to` and returns true, or returns false if the value is 0 or does not fit.
template <typename T>
bool answer(const T& value, std::size_t size, void* to) {
  if (value == 0 || size != sizeof value || !to) return false;
  std::memcpy(to, &value, sizeof value);
  return true;
}

template <typename Function>
Function* next(Function*, const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

cl_int clFlush(cl_command_queue queue) {
  calls.emplace_back("flush");
  return next(&clFlush, "clFlush")(queue);
}

cl_int clGetDeviceInfo(cl_device_id device, cl_device_info what, std::size_t size, void* to,
                       std::size_t* bytes) {
  const bool answered = (what == CL_DEVICE_TYPE && answer(answers.type, size, to)) ||
                        (what == CL_DEVICE_MAX_WORK_GROUP_SIZE && answer(answers.device_items, size, to)) ||
                        (what == CL_DEVICE_LOCAL_MEM_SIZE && answer(answers.device_local_bytes, size, to));
  if (answered) return CL_SUCCESS;
  if (what != CL_DEVICE_EXTENSIONS || !answers.extensions)
    return next(&clGetDeviceInfo, "clGetDeviceInfo")(device, what, size, to, bytes);
  const std::size_t length = std::strlen(answers.extensions) + 1;
  if (bytes) *bytes = length;
  if (to) std::memcpy(to, answers.extensions, std::min(size, length));
  return CL_SUCCESS;
}

cl_int clGetKernelWorkGroupInfo(cl_kernel kernel, cl_device_id device, cl_kernel_work_group_info what,
                                std::size_t size, void* to, std::size_t* bytes) {
  const bool answered = (what == CL_KERNEL_WORK_GROUP_SIZE && answer(answers.kernel_items, size, to)) ||
                        (what == CL_KERNEL_LOCAL_MEM_SIZE && answer(answers.kernel_local_bytes, size, to));
  return answered ? CL_SUCCESS
                  : next(&clGetKernelWorkGroupInfo, "clGetKernelWorkGroupInfo")(kernel, device, what, size,
                                                                                to, bytes);
}

// This function is part of OpenCL 2.1. The headers for OpenCL 1.2 do not declare it.
cl_int clGetKernelSubGroupInfo(cl_kernel kernel, cl_device_id device, cl_uint what, std::size_t input_size,
                               const void* input, std::size_t size, void* to, std::size_t* bytes) {
  constexpr cl_uint kSizeForRange = 0x2033;  // CL_KERNEL_MAX_SUB_GROUP_SIZE_FOR_NDRANGE
  const bool answered = what == kSizeForRange && answer(answers.sub_group_items, size, to);
  return answered ? CL_SUCCESS
                  : next(&clGetKernelSubGroupInfo, "clGetKernelSubGroupInfo")(
                        kernel, device, what, input_size, input, size, to, bytes);
}

cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions,
                              const std::size_t* offset, const std::size_t* global, const std::size_t* local,
                              cl_uint waits, const cl_event* wait_list, cl_event* event) {
  char name[128] = "";
  clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, nullptr);
  if (answers.kernel_items > 0 && local && local[0] * local[1] * local[2] > answers.kernel_items)
    return CL_INVALID_WORK_GROUP_SIZE;
  if (answers.kernel_local_bytes > 0) return CL_OUT_OF_RESOURCES;
  // Ignores the kernel that checks the lane exchange. It is launched when a kernel with lane exchange is
  // first used.
  if (std::strcmp(name, "exchange_check") != 0) calls.emplace_back(name);
  groups[name] = local ? local[0] * local[1] * local[2] : 0;
  cl_device_id device = nullptr;
  cl_ulong local_bytes = 0;
  clGetCommandQueueInfo(queue, CL_QUEUE_DEVICE, sizeof device, &device, nullptr);
  clGetKernelWorkGroupInfo(kernel, device, CL_KERNEL_LOCAL_MEM_SIZE, sizeof local_bytes, &local_bytes,
                           nullptr);
  most_local_bytes = std::max(most_local_bytes, local_bytes);
  return next(&clEnqueueNDRangeKernel, "clEnqueueNDRangeKernel")(queue, kernel, dimensions, offset, global,
                                                                 local, waits, wait_list, event);
}

void* clEnqueueMapBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, cl_map_flags flags,
                         std::size_t offset, std::size_t bytes, cl_uint waits, const cl_event* wait_list,
                         cl_event* event, cl_int* code) {
  void* mapped = next(&clEnqueueMapBuffer, "clEnqueueMapBuffer")(queue, buffer, blocking, flags, offset,
                                                                 bytes, waits, wait_list, event, code);
  cl_mem_flags kind = 0;
  clGetMemObjectInfo(buffer, CL_MEM_FLAGS, sizeof kind, &kind, nullptr);
  if (kind & CL_MEM_ALLOC_HOST_PTR) pinned.push_back({static_cast<std::byte*>(mapped), bytes});
  return mapped;
}

cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool blocking, std::size_t offset,
                            std::size_t bytes, const void* from, cl_uint waits, const cl_event* wait_list,
                            cl_event* event) {
  writes.push_back({static_cast<const std::byte*>(from), bytes});
  return next(&clEnqueueWriteBuffer, "clEnqueueWriteBuffer")(queue, buffer, blocking, offset, bytes, from,
                                                             waits, wait_list, event);
}

}  // extern "C"

namespace ubs {
namespace {

using namespace opencl;

bool launched(const std::string& part) {
  return std::ranges::any_of(calls, [&](const std::string& call) { return call.find(part) != call.npos; });
}

TEST_CASE("the queue is flushed whenever the host has other work to do") {
  const bench::BenchScene scene = bench::synthetic_object(3, 500, 40, 40, 1);
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
      INFO(device->info().name << ", raster " << static_cast<int>(raster));
      const auto stages = ubs::make_stages(*device, {.dim = 3, .raster = raster});
      DeviceModel model(*device, scene.model, scene.model.count);
      Renderer renderer(*device, *stages);
      renderer.set_cameras({scene.views.views[0].camera});
      calls.clear();
      renderer.forward(model.view(), 0, {}, true);
      CHECK(launched("project_forward"));
      CHECK(launched("raster_"));
      CHECK(calls.back() == "flush");
      // The queue is flushed before the rasteriser, so that the device builds the lists while the host loads
      // the kernels of the rasteriser.
      const auto drawn =
          std::ranges::find_if(calls, [](const auto& call) { return call.starts_with("raster_"); });
      CHECK(*(drawn - 1) == "flush");

      Buffer<float> v_params(*device, "gradients", static_cast<std::size_t>(model.rows()) * model.stride());
      device->fill_zero(*renderer.v_image().memory, 0, renderer.v_image().size * sizeof(float));
      calls.clear();
      renderer.backward_to_records();
      const auto summed =
          std::ranges::find_if(calls, [](const auto& call) { return call.starts_with("sum_slots"); });
      REQUIRE(summed != calls.end());
      CHECK(*(summed - 1) == "flush");

      Buffer<float> moment1(*device, "m1", v_params.size()), moment2(*device, "m2", v_params.size()),
          rates(*device, "rates", static_cast<std::size_t>(model.rows()));
      for (Buffer<float>* buffer : {&v_params, &moment1, &moment2, &rates}) buffer->zero();
      const AdamStep step{.splats = model.view(),
                          .v_params = v_params.view(),
                          .moment1 = moment1.view(),
                          .moment2 = moment2.view(),
                          .learning_rates = rates.view(),
                          .step = 1};
      for (const bool at_once : {false, true}) {
        calls.clear();
        if (at_once)
          renderer.learn(false, {.splats = model.view()}, step);
        else
          stages->adam(step);
        CHECK(launched("adam"));
        CHECK(calls.back() == "flush");
      }
    }
}

// Each launch costs time on a GPU, so this test fails if a change increases their number.
TEST_CASE("the tile lists of a view need 20 launches with the GPU kernels", "[device]") {
  // The image has 625 tiles, so that sorting by tile needs two passes.
  const bench::BenchScene scene = bench::synthetic_object(3, 5000, 400, 400, 1);
  for (const auto& device : opencl_devices_under_test()) {
    INFO(device->info().name);
    const auto stages = ubs::make_stages(*device, {.dim = 3, .raster = RasterKind::gpu});
    DeviceModel model(*device, scene.model, scene.model.count);
    Renderer renderer(*device, *stages);
    renderer.set_cameras({scene.views.views[0].camera});
    const auto launches_of_lists = [&](const auto& draw) {
      calls.clear();
      draw();
      const auto named = [](const char* part) {
        return std::ranges::find_if(calls, [&](const auto& call) { return call.starts_with(part); });
      };
      REQUIRE(named("raster_") != calls.end());
      return std::count_if(named("project_forward") + 1, named("raster_"),
                           [](const auto& call) { return call != "flush"; });
    };
    CHECK(launches_of_lists([&] { renderer.forward(model.view(), 0, {}, true); }) == 20);
    // The second time, the buffers of the lists exist, and the host does not wait for the lengths of the
    // lists.
    CHECK(launches_of_lists([&] { CHECK(renderer.forward_deferred(model.view(), 0, {}).had_capacity()); }) ==
          20);
  }
}

TEST_CASE("data that are written without waiting are in pinned memory", "[device]") {
  for (const auto& device : opencl_devices_under_test()) {
    INFO(device->info().name);
    Buffer<std::uint8_t> to(*device, "to", 300000), small(*device, "small", 100);
    std::vector<std::uint8_t> bytes(to.size());
    for (const std::size_t size : {std::size_t{1000}, std::size_t{300000}, std::size_t{200000}}) {
      std::iota(bytes.begin(), bytes.end(), static_cast<std::uint8_t>(size / 1000));
      const std::vector<std::uint8_t> given = bytes;
      writes.clear();
      device->copy_async(*to.view().memory, std::as_bytes(std::span(bytes).first(size)));
      small.upload(std::span<const std::uint8_t>(bytes).first(100));
      std::ranges::fill(bytes, std::uint8_t{0});  // after both calls have returned, the source may be changed
      REQUIRE(writes.size() == 2);
      for (const Copy& write : writes)
        CHECK(std::ranges::any_of(pinned, [&](const Copy& block) {
          return write.from >= block.from && write.from + write.bytes <= block.from + block.bytes;
        }));
      device->join_uploads();
      const std::vector<std::uint8_t> there = to.download();
      CHECK(std::equal(given.begin(), given.begin() + static_cast<std::ptrdiff_t>(size), there.begin()));
      CHECK(std::ranges::equal(std::span(given).first(100), small.download()));
    }
  }
}

// Returns a handle of the same OpenCL device that is described by `info`, for example as a GPU.
std::unique_ptr<OpenclDevice> disguised(Device& device, const DeviceInfo& info) {
  const cl_device_id id = dynamic_cast<OpenclDevice&>(device).id();
  cl_platform_id platform = nullptr;
  REQUIRE(clGetDeviceInfo(id, CL_DEVICE_PLATFORM, sizeof platform, &platform, nullptr) == CL_SUCCESS);
  return std::make_unique<OpenclDevice>(platform, id, info);
}

TEST_CASE("Buffer::show() does not copy on CPUs, and on GPUs copies to memory of the caller", "[device]") {
  for (const auto& device : opencl_devices_under_test())
    for (const DeviceType type : {DeviceType::cpu, DeviceType::gpu}) {
      DeviceInfo info = device->info();
      info.type = type;
      const auto as = disguised(*device, info);
      Buffer<std::uint32_t> buffer(*as, "numbers", 1000);
      std::vector<std::byte> room;
      std::vector<std::uint32_t> expected(1000);
      std::iota(expected.begin(), expected.end(), 1u);
      buffer.upload(expected);
      std::vector<std::uint32_t> shown;
      buffer.show(1000, room, [&](const std::uint32_t* from) { shown.assign(from, from + 1000); });
      CHECK(shown == expected);
      CHECK(room.empty() == (info.type == DeviceType::cpu));
    }
}

// With UBS_SYNC=1, the back end compares the arguments of each kernel that it uses with the declaration of
// the kernel in host/opencl/kernels.hpp.
TEST_CASE("kernels have the declared arguments, and other arguments are reported") {
  const bench::BenchScene scene = bench::synthetic_object(3, 200, 40, 40, 1);
  const test::Variable sync("UBS_SYNC", "1");
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
      const auto opened = disguised(*device, device->info());
      const auto stages = ubs::make_stages(*opened, {.dim = 3, .raster = raster});
      DeviceModel model(*opened, scene.model, scene.model.count);
      Renderer renderer(*opened, *stages);
      renderer.set_cameras({scene.views.views[0].camera});
      for (const bool counted : {true, false}) {
        if (counted) renderer.forward(model.view(), 0, {}, true);
        if (!counted) REQUIRE(renderer.forward_deferred(model.view(), 0, {}).had_capacity());
        Buffer<float> v_params(*opened, "gradients", static_cast<std::size_t>(model.rows()) * model.stride());
        renderer.backward(v_params.view(), false);
      }
      Kernel kernel = opened->kernel({{"map/row_sums.cl"}, {"-DUBS_VW=1"}}, "row_sums");
      constexpr ParameterType sums = parameter_type<float*>(), pitch = parameter_type<int>(), count = pitch;
      kernel.check_types(std::array{sums, pitch, count});
      const auto check = [&](const auto&... types) { kernel.check_types(std::array{types...}); };
      CHECK_THROWS_WITH(check(parameter_type<const float*>(), pitch, count), Catch::Contains("argument 0"));
      CHECK_THROWS_WITH(check(parameter_type<u32*>(), pitch, count), Catch::Contains("argument 0"));
      CHECK_THROWS_WITH(check(sums, parameter_type<u32>(), count), Catch::Contains("argument 1"));
      CHECK_THROWS_WITH(check(sums, pitch), Catch::Contains("2 are declared"));
      CHECK_THROWS_WITH(check(sums, pitch, count, count), Catch::Contains("argument 3"));
    }
}

TEST_CASE(
    "PoCL on CPUs computes exp2 and log2 with built-ins of clang, other CPUs with library functions, and "
    "GPUs with native functions") {
  for (const auto& device : opencl_devices_under_test()) {
    DeviceInfo info = device->info();
    for (const std::string platform : {"Portable Computing Language", "Another"})
      for (const DeviceType type : {DeviceType::cpu, DeviceType::gpu}) {
        info.platform = platform;
        info.type = type;
        const auto other = disguised(*device, info);
        other->kernel({{"opencl/group_scan.cl", "opencl/scan.cl"}, {"-DUBS_SCAN_IN=uint", "-DUBS_SUM=uint"}},
                      "scan_sums");
        const std::string options = other->programs().at(0).options;
        const auto has = [&](const char* option) { return options.find(option) != std::string::npos; };
        const bool cpu = type == DeviceType::cpu, of_pocl = platform != "Another";
        CHECK(has("-DUBS_POCL=1") == (cpu && of_pocl));
        CHECK(has("-Dnative_exp2=exp2") == (cpu && !of_pocl));
        CHECK(has("-Dnative_log2=log2") == (cpu && !of_pocl));
      }
  }
}

TEST_CASE("256 registers per thread are requested if an Intel GPU supports this") {
  const auto version = [](std::uint32_t architecture, std::uint32_t release) {
    return architecture << 22 | release << 14 | 4u;
  };
  const std::string with = "cl_khr_fp16 cl_intel_device_attribute_query",
                    option = "-cl-intel-256-GRF-per-thread";
  CHECK(large_register_option(with, version(12, 55)) == option);  // Arc A770
  CHECK(large_register_option(with, version(12, 60)) == option);  // Max 1550
  CHECK(large_register_option(with, version(20, 1)) == option);   // Arc B580
  CHECK(large_register_option(with, version(12, 0)).empty());     // Xe-LP
  CHECK(large_register_option(with, version(9, 0)).empty());
  CHECK(large_register_option("cl_khr_fp16", version(12, 55)).empty());
}

struct AnswersFor {
  explicit AnswersFor(const Answers& given) { answers = given; }
  ~AnswersFor() { answers = {}; }
};

// Returns the warnings that `work` prints.
template <typename Work>
std::string warnings_of(const Work& work) {
  std::string said;
  set_log([&](LogLevel level, const std::string& text) {
    if (level == LogLevel::warning) said += text + "\n";
  });
  work();
  set_log({});
  return said;
}

// Computes a gradient on simulated GPUs whose work-groups have at most 128 or 192 work-items, or whose local
// memory has only 16 KiB.
TEST_CASE("GPUs with small work-groups or little local memory run the CPU kernels, with a warning",
          "[device]") {
  const oracle::Scene scene =
      oracle::regular_scene({.count = 150, .dim = 4, .seed = 11, .width = 45, .height = 38});
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  const auto gradient = [&](Device& device) {
    const auto stages = ubs::make_stages(device, {.dim = 4, .raster = raster_kind("auto", device.info())});
    return view_gradient(device, *stages, scene.model, scene.camera, target, {}, 0.2f).values.values;
  };
  if (opencl_devices_under_test().empty()) return;  // this program tests the CUDA back end on the host
  const std::vector<float> usual = gradient(*opencl::open_device(0));
  const std::vector<double> expected(usual.begin(), usual.end());
  for (const Answers& small :
       {Answers{.type = CL_DEVICE_TYPE_GPU, .device_items = 128, .device_local_bytes = 16384},
        Answers{.type = CL_DEVICE_TYPE_GPU, .device_items = 192},
        Answers{.type = CL_DEVICE_TYPE_GPU, .device_local_bytes = 16384}}) {
    const AnswersFor as(small);
    groups.clear();
    most_local_bytes = 0;
    std::unique_ptr<Device> device;
    const std::string said = warnings_of([&] { device = opencl::open_device(0); });
    CHECK_THAT(said, Catch::Contains("the slower CPU kernels are used"));
    CHECK(raster_kind("auto", device->info()) == RasterKind::cpu);
    CHECK(test::relative_error(gradient(*device), expected) < 2e-5);
    REQUIRE(groups.size() > 10);
    for (const auto& [kernel, items] : groups) {
      INFO(kernel);
      CHECK(items <= 128);
    }
    if (small.device_local_bytes > 0) CHECK(most_local_bytes <= small.device_local_bytes);
  }
}

TEST_CASE("a kernel that exceeds the limits of a device is rejected with required and available sizes",
          "[device]") {
  const oracle::Scene scene =
      oracle::regular_scene({.count = 20, .dim = 3, .seed = 1, .width = 20, .height = 20});
  if (opencl_devices_under_test().empty()) return;  // this program tests the CUDA back end on the host
  const auto draw = [&] {
    const auto device = opencl::open_device(0);
    const auto stages = ubs::make_stages(*device, {.dim = 3, .raster = RasterKind::gpu});
    DeviceModel model(*device, scene.model, scene.model.count);
    Renderer renderer(*device, *stages);
    renderer.set_cameras({scene.camera});
    renderer.forward(model.view(), 0, {}, true);
  };
  {
    const AnswersFor as({.kernel_items = 128});
    CHECK_THROWS_WITH(
        draw(), Catch::Contains("needs work-groups of 256 work-items, but") &&
                    Catch::Contains(
                        "allows at most 128 for this kernel (CL_INVALID_WORK_GROUP_SIZE): set raster = cpu"));
  }
  const AnswersFor as({.device_local_bytes = 32768, .kernel_local_bytes = 40000});
  CHECK_THROWS_WITH(
      draw(), Catch::Contains("needs 40000 bytes of local memory, but") && Catch::Contains("has only 32768"));
}

// Copies all kernels to a folder, replaces the lane exchange (kernels/gpu/exchange.h) by `text`, and makes
// ubs use the kernels in this folder.
struct OtherExchange {
  explicit OtherExchange(const std::string& text) {
    std::filesystem::copy(test::source_folder() / "kernels", folder.path() / "kernels",
                          std::filesystem::copy_options::recursive);
    std::ofstream(folder.path() / "kernels/gpu/exchange.h") << text;
    source.emplace("UBS_KERNEL_DIR", (folder.path() / "kernels").c_str());
  }
  TemporaryFolder folder;
  std::optional<test::Variable> source;
};

// Lane exchange means that the work-items of a sub-group read each other's values without local memory. This
// test simulates drivers that support it, and emulates its functions in local memory, correctly or
// incorrectly. It also simulates drivers that do not support it, and drivers whose sub-groups have a size
// that is not a multiple of 16.
TEST_CASE("a lane exchange that does not work is replaced by local memory, with a warning", "[device]") {
  if (opencl_devices_under_test().empty()) return;  // this program tests the CUDA back end on the host
  const oracle::Scene scene =
      oracle::regular_scene({.count = 150, .dim = 3, .seed = 11, .width = 45, .height = 38});
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  std::ifstream file(test::source_folder() / "tests/support/emulated_exchange.h");
  const std::string right{std::istreambuf_iterator<char>(file), {}};
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = right;
    const std::size_t at = text.find(from);
    REQUIRE(at != std::string::npos);
    return text.replace(at, from.size(), to);
  };
  const Answers nvidia{.type = CL_DEVICE_TYPE_GPU, .extensions = "cl_nv_device_attribute_query"};
  const auto khr = [](std::size_t sub_group_items) {
    return Answers{.type = CL_DEVICE_TYPE_GPU,
                   .sub_group_items = sub_group_items,
                   .extensions = "cl_khr_subgroup_shuffle"};
  };
  struct Case {
    Answers answers;
    std::string text, warning;
  };
  const Case cases[] = {
      {nvidia, right, ""},
      {nvidia, broken("handed[item ^ distance]", "handed[item ^ (distance / 2)]"),
       "the lane exchange gives wrong values"},
      {nvidia, "#if UBS_SUBGROUPS\n#error no such instruction\n#endif\n" + right,
       "summed through local memory"},
      {khr(32), right, ""},
      {khr(8), right, "of a sub-group is 8, which is not a multiple of 16"},
      {{.type = CL_DEVICE_TYPE_GPU, .extensions = ""}, right, "does not support exchanging values"},
      {{.type = CL_DEVICE_TYPE_CPU, .extensions = ""}, right, ""},
  };
  const bool on_cpu = opencl::open_device(0)->info().type == DeviceType::cpu;
  std::vector<double> expected;
  for (const Case& c : cases) {
    if (c.answers.type == CL_DEVICE_TYPE_CPU && !on_cpu) continue;
    const OtherExchange exchange(c.text);
    const AnswersFor as(c.answers);
    DeviceInfo info = opencl::open_device(0)->info();
    info.name = "Lanes";  // a new name, because warnings are printed once per device
    info.subgroup_language = "CL3.0";
    const auto device = disguised(*opencl::open_device(0), info);
    const auto stages = ubs::make_stages(*device, {.dim = 3, .raster = RasterKind::gpu});
    std::vector<float> values;
    const std::string said = warnings_of([&] {
      values = view_gradient(*device, *stages, scene.model, scene.camera, target, {}, 0.2f).values.values;
    });
    INFO(said);
    CHECK(said.empty() == c.warning.empty());
    CHECK_THAT(said, Catch::Contains(c.warning));
    if (info.type == DeviceType::cpu) {  // CPUs use other elementary functions, which round differently
      CHECK(test::relative_error(values, expected) < 2e-5);
      continue;
    }
    if (expected.empty()) expected.assign(values.begin(), values.end());
    CHECK(std::ranges::equal(values, expected));
  }
}

TEST_CASE("GPUs project splats in work-groups of 64 work-items, or of the tuned size") {
  const bench::BenchScene scene = bench::synthetic_object(3, 100, 20, 20, 1);
  for (const auto& device : opencl_devices_under_test())
    for (const unsigned group : {0u, 128u, 256u}) {
      DeviceInfo info = device->info();
      info.type = DeviceType::gpu;
      info.float_vector_width = 1;
      info.tuning = group ? TuningValues{{"UBS_PROJECT_GROUP", group}} : TuningValues{};
      const auto card = disguised(*device, info);
      const auto stages = ubs::make_stages(*card, {.dim = 3, .raster = RasterKind::gpu});
      DeviceModel model(*card, scene.model, scene.model.count);
      Renderer renderer(*card, *stages);
      renderer.set_cameras({scene.views.views[0].camera});
      renderer.forward(model.view(), 0, {}, true);
      CHECK(groups.at("project_forward") == (group ? group : 64));
    }
}

}  // namespace
}  // namespace ubs
