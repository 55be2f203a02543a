// SPDX-License-Identifier: Apache-2.0
// Tests that the files of each folder of the code (a "room") only include headers of the folders that
// kMayInclude lists. These rules keep the layers of docs/architecture.md apart: a folder includes no headers
// of higher layers, and only the files of a back end include its headers. Also tests that no two headers have
// the same name, that the rooms below training see no settings of a training, and which atomic functions
// kernels use.
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>

#include "tests/support/generated_list.hpp"

namespace {

namespace fs = std::filesystem;

// For each room, the rooms whose headers it may include in addition to its own.
const std::map<std::string, std::string> kMayInclude{
    {"base", ""},
    {"scene", "base kernels"},
    {"settings", "base scene"},
    {"device", "base scene kernels"},
    {"cluster", "base"},
    {"pipeline", "base cluster scene device kernels"},
    {"train", "base cluster scene settings device kernels pipeline"},
    {"formats", "base scene settings kernels"},
    {"dataset", "base scene settings formats"},
    {"opencl", "base scene device kernels"},
    {"cuda_backend", "base scene device kernels"},
    {"check", "base scene device kernels pipeline"},
    {"run", "base cluster scene settings dataset formats device pipeline train check"},
    {"model", "base scene settings dataset formats device pipeline train run"},
    {"capi", "base scene settings dataset formats device pipeline train run model include"},
    {"look", "base scene settings dataset formats device pipeline train model"},
    // The oracle must not include headers of the kernels, because its results are compared with theirs.
    {"lab/oracle", "base scene device pipeline"},
    {"lab", "base scene settings dataset device kernels pipeline train check lab/oracle"},
};

std::string room_of(const std::string& path) {
  std::istringstream parts(path);
  std::string first, second;
  std::getline(parts, first, '/');
  std::getline(parts, second, '/');
  if (path.starts_with("host/lab/oracle/")) return "lab/oracle";
  return first == "host" ? second : first;
}

TEST_CASE("files of a room only include headers that their room may include") {
  std::size_t files = 0;
  for (const char* folder : {"host", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".cpp" && extension != ".hpp" && extension != ".cu") continue;
      const std::string name = fs::relative(entry.path(), UBS_SOURCE_DIR).generic_string();
      if (name == "host/device/registry.cpp") continue;  // this file lists all back ends
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

// Adds the files that `file` includes, directly or through other files, to `reached`.
void add_included(const fs::path& file, std::set<std::string>& reached) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    if (!line.starts_with("#include \"")) continue;
    const std::string name = line.substr(10, line.rfind('"') - 10);
    const fs::path included = fs::path(UBS_SOURCE_DIR) / name;
    if (fs::exists(included) && reached.insert(name).second) add_included(included, reached);
  }
}

// The operations are described by plain structs, which code of training fills in. So the devices and the
// renderer do not depend on the settings of a training, and need not be compiled again when one is added.
TEST_CASE("devices, back ends and the pipeline see no settings of a training") {
  std::size_t files = 0;
  for (const char* room : {"host/device", "host/opencl", "cuda_backend", "host/pipeline", "host/check"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / room)) {
      if (!entry.is_regular_file()) continue;
      std::set<std::string> reached;
      add_included(entry.path(), reached);
      INFO(entry.path().string());
      for (const std::string& header : reached) {
        INFO(header);
        CHECK(!header.starts_with("host/settings/"));
      }
      if (reached.contains("host/device/stages.hpp")) ++files;
    }
  CHECK(files > 50);
}

// The README of a room says what the room is for, and which of its headers are for other rooms.
TEST_CASE("the README of a room lists the headers that other rooms include") {
  std::map<std::string, std::set<std::string>> used;  // by room
  for (const char* folder : {"host", "tools", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      const std::string name = fs::relative(entry.path(), UBS_SOURCE_DIR).generic_string();
      if (!entry.is_regular_file() || name.ends_with(".md")) continue;
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("#include \"host/")) continue;
        const std::string header = line.substr(10, line.rfind('"') - 10);
        const std::string room = header.substr(5, header.find('/', 5) - 5);
        if (!name.starts_with("host/" + room + "/")) used[room].insert(header.substr(6 + room.size()));
      }
    }
  for (const auto& entry : fs::directory_iterator(fs::path(UBS_SOURCE_DIR) / "host")) {
    if (!entry.is_directory()) continue;
    const std::string room = entry.path().filename().string();
    std::string list;
    for (const std::string& header : used[room]) list += "- `" + header + "`\n";
    if (list.empty()) list = "None.\n";
    ubs::test::check_list(("host/" + room + "/README.md").c_str(), "headers that other rooms include", list);
  }
}

// host/device/backend.hpp is the contract of a back end, so it must be complete.
TEST_CASE("back ends use only those headers of host/device that backend.hpp includes") {
  std::set<std::string> contract{"host/device/backend.hpp"};
  add_included(fs::path(UBS_SOURCE_DIR) / "host/device/backend.hpp", contract);
  std::size_t uses = 0;
  for (const char* room : {"host/opencl", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / room)) {
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("#include \"host/device/")) continue;
        INFO(entry.path().string() << ": " << line);
        CHECK(contract.contains(line.substr(10, line.rfind('"') - 10)));
        ++uses;
      }
    }
  CHECK(uses > 20);
}

// Names of back ends in quotes. Code that asks for a back end by its name treats every other one in the same
// way as one of those that exist, which is wrong for some future back end.
TEST_CASE("only back ends and the table of back ends contain the name of a back end") {
  std::size_t files = 0;
  const std::regex name(R"re("(cuda|opencl|cuda_backend/[^"]*)")re");
  for (const char* folder : {"host", "tools"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      const std::string path = fs::relative(entry.path(), UBS_SOURCE_DIR).generic_string();
      if (!path.ends_with("pp") || path.starts_with("host/opencl/") || path == "host/device/registry.cpp")
        continue;
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (line.find("//") < line.find('"') || line.starts_with("#include")) continue;
        if (std::regex_search(line, name)) FAIL_CHECK(path << ": " << line);
      }
      ++files;
    }
  CHECK(files > 300);
}

TEST_CASE("no two headers have the same name") {
  std::map<std::string, std::string> places;
  for (const char* folder : {"host", "tools", "cuda_backend", "kernels", "include", "tests"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".hpp" && extension != ".h" && extension != ".cuh") continue;
      const auto [place, added] = places.try_emplace(entry.path().filename().string(), entry.path().string());
      INFO(place->second << " and " << entry.path().string());
      CHECK(added);
    }
  CHECK(places.size() > 300);
}

// Some drivers compute wrong results for loops of compare-exchange, and for 64-bit atomics in kernels with
// sub-groups (docs/check.md). Atomic additions of floats are not allowed either, because their order varies,
// so the same inputs would give different bits.
TEST_CASE("kernels use no atomics except increment, or, and maximum of 32-bit words") {
  std::size_t uses = 0;
  const std::regex atomic(R"(\b(atom_\w+|atomic\w*)\s*\()");
  for (const char* folder : {"kernels", "cuda_backend"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(UBS_SOURCE_DIR) / folder)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);)
        for (std::sregex_iterator use(line.begin(), line.end(), atomic), end; use != end; ++use, ++uses) {
          INFO(entry.path().string() << ": " << line);
          const std::string name = (*use)[1];
          CHECK((name == "atomic_inc" || name == "atomic_or" || name == "atomic_max" || name == "atomicOr" ||
                 name == "atomicMax" || line.find("atomicAdd(pointer, 1u)") != line.npos));
        }
    }
  CHECK(uses > 8);
}

}  // namespace
