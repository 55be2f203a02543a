// SPDX-License-Identifier: Apache-2.0
// Tests that a failing driver does not hide the devices of another driver, and that each failure is reported
// once. The other driver is PoCL.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/support/run_ubs.hpp"
#include "tests/support/set_variable.hpp"

namespace ubs {
namespace {

using namespace test;
using nlohmann::json;

std::filesystem::path system_drivers() {
  const char* folder = std::getenv("OCL_ICD_VENDORS");
  return folder ? folder : "/etc/OpenCL/vendors";
}

TEST_CASE("the devices of working drivers are listed even if another driver fails") {
  const TempFolder folder;
  const json sound = json::parse(ubs_ok(folder, "devices --json").out);
  std::filesystem::create_directory(folder / "vendors");
  put(folder / "vendors/a_faulty.icd", std::string(UBS_FAULTY_ICD) + "\n");
  for (const auto& entry : std::filesystem::directory_iterator(system_drivers()))
    put(folder / "vendors" / entry.path().filename(), get(entry.path()));
  const Variable vendors("OCL_ICD_VENDORS", (folder / "vendors").c_str());

  for (const char* fault : {"device", "platform"}) {
    const Variable kind("UBS_FAULTY_ICD", fault);
    const Result listed = ubs_ok(folder, "devices --json");
    INFO(fault << "\n" << listed.err);
    CHECK(json::parse(listed.out)["devices"] == sound["devices"]);
    const bool devices = std::string(fault) == "device";
    // Each of the two faulty devices, or the faulty platform, must be reported only once, although ubs lists
    // the devices several times in a process.
    CHECK(std::ranges::count(listed.err, '\n') == (devices ? 2 : 1));
    CHECK(listed.err.find("ubs: warning: ") == 0);
    CHECK(listed.err.find("'Faulty Driver' is not used: ") != std::string::npos);
    CHECK(listed.err.find(devices ? "clGetDeviceInfo failed with CL_OUT_OF_RESOURCES"
                                  : "clGetDeviceIDs failed with CL_OUT_OF_HOST_MEMORY") != std::string::npos);
  }
}

}  // namespace
}  // namespace ubs
