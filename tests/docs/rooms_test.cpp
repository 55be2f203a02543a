// SPDX-License-Identifier: Apache-2.0
// What the files of a room may include (docs/architecture.md): nothing above it, and no back end.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::string> kMayInclude{
    {"base", ""},
    {"scene", "base kernels"},
    {"device", "base scene kernels"},
    {"spec", "base scene device"},
    {"cluster", "base"},
    {"pipeline", "base cluster scene device kernels"},
    {"metrics", "base device pipeline"},
    {"train", "base cluster scene device kernels spec pipeline metrics"},
    {"data", "base scene spec kernels"},
    {"opencl", "base scene device kernels"},
    {"cuda_backend", "base scene device kernels"},
    {"oracle", "base scene device metrics"},
    {"view", "base scene data pipeline"},
    {"report", "base scene spec data pipeline train view"},
    {"reduce", "base scene kernels data pipeline train"},
    {"bench", "base scene spec data device pipeline train"},
    {"accuracy", "base scene spec device kernels metrics pipeline train bench oracle check"},
    {"check", "base scene device kernels metrics pipeline"},
    {"run", "base cluster scene spec data device pipeline metrics train view check"},
    {"facade", "base scene spec data device pipeline metrics train run include"},
    {"web", "base scene spec data device pipeline metrics train view report run"},
    {"serve", "base scene spec data device pipeline train view report run web"},
};

std::string room_of(const std::string& path) {
  std::istringstream parts(path);
  std::string first, second;
  std::getline(parts, first, '/');
  std::getline(parts, second, '/');
  return first == "host" ? second : first;
}

TEST_CASE("files of a room include what their room may") {
  std::size_t files = 0;
  for (const char* folder : {"host", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".cpp" && extension != ".hpp" && extension != ".cu") continue;
      const std::string name = fs::relative(entry.path(), UBS_SOURCE_DIR).generic_string();
      if (name == "host/device/registry.cpp") continue;  // the list of back ends
      const std::string room = room_of(name);
      REQUIRE(kMayInclude.contains(room));
      const std::string allowed = " " + room + " " + kMayInclude.at(room) + " ";
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("#include \"") || line.find('/') == std::string::npos) continue;
        INFO(name << ": " << line);
        CHECK(allowed.find(" " + room_of(line.substr(10, line.size() - 11)) + " ") != std::string::npos);
      }
      ++files;
    }
  CHECK(files > 300);
}

}  // namespace
