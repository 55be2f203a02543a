// SPDX-License-Identifier: Apache-2.0
// ubs devices --doctor: prints one page about this machine with a verdict and advice. Users should attach it
// to problem reports.
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <thread>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/check/conformance.hpp"
#include "host/device/tuning.hpp"
#include "host/train/run_settings.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/program_version.hpp"
#include "tools/device_reports.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

constexpr int kDim = 6;           // number of dimensions for which devices are checked
constexpr double kFewFree = 2.0;  // if less memory is free, this is reported as a problem [GiB]

class Doctor {
 public:
  Doctor(const std::vector<std::string>& names, bool json) : names_(names), as_json_(json) {}

  int run() {
    versions();
    memory();
    folders();
    std::vector<DeviceInfo> devices;
    try {
      devices = list_devices();
    } catch (const Error& error) {
      trouble(exit_code(error.kind()), error.what(),
              "install an OpenCL driver: sudo apt-get install pocl-opencl-icd");
    }
    std::vector<std::size_t> chosen;
    if (names_.empty() && !devices.empty()) chosen = device_candidates(devices, "");
    for (const std::string& name : names_)
      if (!devices.empty()) chosen.push_back(choose_device(devices, name));
    if (devices.empty() && code_ == 0)
      trouble(exit_code(ErrorKind::device), "there is no compute device",
              "install an OpenCL driver: sudo apt-get install pocl-opencl-icd");
    for (const std::size_t index : chosen) examine(devices[index], index);
    verdict();
    return code_;
  }

 private:
  template <typename... Args>
  void line(fmt::format_string<Args...> format, Args&&... args) {
    if (as_json_) return;
    say("{}\n", fmt::format(format, std::forward<Args>(args)...));
    flush_out();
  }

  // `code` 0: training works despite the problem.
  void trouble(int code, const std::string& what, const std::string& advice) {
    problems_.push_back({{"what", what}, {"do", advice}, {"serious", code != 0}});
    if (code_ == 0) code_ = code;
  }

  void versions() {
    utsname system{};
    uname(&system);
    const std::string text = fmt::format("{} {} {}", system.sysname, system.release, system.machine);
#ifdef UBS_WITH_OPENCV
    const bool opencv = true;
#else
    const bool opencv = false;
#endif
    json_["version"] = version();
    json_["build"] = build_id();
    json_["system"] = text;
    json_["opencv"] = opencv;
    line("version    {}\nsystem     {}, {} threads; OpenCV {}", version_line(), text,
         std::thread::hardware_concurrency(),
         opencv ? "yes" : "no: 'ubs view', 'ubs report' and 'ubs web' are not available");
    double load[1] = {0};
    if (getloadavg(load, 1) != 1) return;
    json_["load"] = load[0];
    if (load[0] > 1.5 * std::thread::hardware_concurrency())
      trouble(0, fmt::format("other programs are using the processors (load {:.1f})", load[0]),
              "training will be slower: wait for them or stop them");
  }

  void memory() {
    const auto pages = [](int name) { return static_cast<std::uint64_t>(std::max(0L, sysconf(name))); };
    const std::uint64_t page = pages(_SC_PAGESIZE), all = pages(_SC_PHYS_PAGES) * page,
                        free = std::min(pages(_SC_AVPHYS_PAGES) * page + cached(), memory_left());
    json_["memory"] = {{"all_bytes", all}, {"free_bytes", free}, {"limits", memory_limits_text()}};
    line("memory     {:.1f} GiB, {:.1f} GiB free{}", gib(all), gib(free), memory_limits_text());
    if (gib(free) < kFewFree)
      trouble(0, fmt::format("only {:.1f} GiB of memory are free", gib(free)),
              "use smaller images (--downscale 2) and fewer splats (--cap-max)");
  }

  // Returns the memory that the system would free for a program that needs it.
  static std::uint64_t cached() {
    std::ifstream file("/proc/meminfo");
    std::uint64_t kib = 0, sum = 0;
    for (std::string name, unit; file >> name >> kib && std::getline(file, unit);)
      if (name == "Cached:" || name == "Buffers:") sum += kib;
    return sum << 10;
  }

  void folder(const char* what, const fs::path& path, const char* advice) {
    const std::string defect = path.empty() ? "there is no folder for them" : cache_defect(path);
    json_["folders"].push_back({{"for", what}, {"path", path.string()}, {"defect", defect}});
    line("folder     {:<22} {}: {}", what, path.empty() ? "none" : path.string(),
         defect.empty() ? "can be written" : defect);
    if (!defect.empty()) trouble(0, fmt::format("{} cannot be stored ({})", what, defect), advice);
  }

  void folders() {
    json_["folders"] = Json::array();
    folder("compiled kernels", kernel_cache_folder(),
           "kernels are compiled again at every start: set UBS_KERNEL_CACHE to a writable folder");
    folder("results of ubs-lab tune", cache_folder("UBS_TUNING_DIR"),
           "set UBS_TUNING_DIR to a writable folder");
    std::error_code error;  // if there is no such folder, the path is empty, which folder() reports
    folder("temporary files", fs::temp_directory_path(error), "set TMPDIR to a writable folder");
  }

  void examine(const DeviceInfo& info, std::size_t index) {
    Json entry{{"device", device_json(info)}};
    line("\ndevice     {}", describe(info));
    line("  memory   {:.1f} GiB, largest buffer {:.1f} GiB", gib(info.memory_bytes),
         gib(info.max_allocation_bytes));
    try {
      const std::unique_ptr<Device> device = open_device(index);
      if (conforms(*device, entry)) ++working_;
    } catch (const Error& error) {
      entry["error"] = error.what();
      line("  error    {}", error.what());
      trouble(0, fmt::format("{}: {}", info.name, error.what()),
              "update its driver, or choose another with --device");
      if (first_failure_ == 0) first_failure_ = exit_code(error.kind());
    }
    json_["devices"].push_back(std::move(entry));
  }

  void wrong(const std::string& text, const DeviceInfo& info) {
    trouble(exit_code(ErrorKind::faulty), fmt::format("{}: {}", info.name, text),
            "do not use this device: choose another with --device, or update its driver");
  }

  bool conforms(Device& device, Json& entry) {
    const Stopwatch watch;
    const check::Subject subject{kernel_config(kDim, {}, {}, device.info()), check::kTraining};
    const check::Findings findings = check::examine(device, subject);
    const check::Finding* bad = check::failure(findings);
    const double seconds = watch.seconds();
    entry["check"] = {{"stages", findings.size()}, {"right", !bad}, {"seconds", seconds}};
    line("  check    {} stages against float64: {} ({:.1f} s)", findings.size(),
         bad ? "WRONG: " + check::text(*bad) : "correct", seconds);
    if (bad) wrong(check::text(*bad), device.info());
    return !bad;
  }

  void verdict() {
    if (working_ == 0 && code_ == 0) code_ = first_failure_ ? first_failure_ : exit_code(ErrorKind::device);
    const std::string text = code_ != 0 ? "fix these problems before you trust results of this machine"
                             : problems_.empty() ? "no problems were found"
                                                 : "ubs works, but see the remarks";
    json_["problems"] = problems_;
    json_["verdict"] = text;
    json_["well"] = code_ == 0;
    if (as_json_) return print_json(json_);
    line("\nverdict    {}", text);
    for (const Json& p : problems_)
      line("  {}\n    -> {}", p["what"].get<std::string>(), p["do"].get<std::string>());
  }

  const std::vector<std::string>& names_;
  bool as_json_;
  Json json_ = Json::object();
  Json problems_ = Json::array();
  int code_ = 0, working_ = 0, first_failure_ = 0;
};

}  // namespace

int diagnose(const std::vector<std::string>& devices, bool json) { return Doctor(devices, json).run(); }

}  // namespace ubs::tools
