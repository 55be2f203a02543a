// SPDX-License-Identifier: Apache-2.0
#include "tools/common/version.hpp"

#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "host/base/paths.hpp"

#ifndef UBS_VERSION
#error "the build defines UBS_VERSION as the project's version"
#endif

namespace ubs::tools {
namespace {

// The note NT_GNU_BUILD_ID of one mapped segment, if it is there.
std::string find_build_id(const char* at, std::size_t size) {
  const auto padded = [](std::size_t n) { return (n + 3) / 4 * 4; };
  while (size >= sizeof(ElfW(Nhdr))) {
    ElfW(Nhdr) note;
    std::memcpy(&note, at, sizeof note);
    const std::size_t length = sizeof note + padded(note.n_namesz) + padded(note.n_descsz);
    if (length > size) return "";
    const char* name = at + sizeof note;
    if (note.n_type == NT_GNU_BUILD_ID && note.n_namesz == 4 && std::memcmp(name, "GNU", 4) == 0) {
      std::string id;
      for (std::size_t i = 0; i < note.n_descsz; ++i)
        id += fmt::format("{:02x}", static_cast<unsigned char>(name[padded(note.n_namesz) + i]));
      return id;
    }
    at += length;
    size -= length;
  }
  return "";
}

// The first object that dl_iterate_phdr visits is the executable itself.
int visit(dl_phdr_info* info, std::size_t, void* result) {
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const auto& segment = info->dlpi_phdr[i];
    if (segment.p_type != PT_NOTE) continue;
    const auto* start = reinterpret_cast<const char*>(info->dlpi_addr + segment.p_vaddr);
    std::string id = find_build_id(start, segment.p_memsz);
    if (!id.empty()) {
      *static_cast<std::string*>(result) = std::move(id);
      break;
    }
  }
  return 1;
}

}  // namespace

std::string version() { return UBS_VERSION; }

std::string build_id() {
  std::string id = "unknown";
  dl_iterate_phdr(visit, &id);
  return id;
}

std::string commit() {
  std::ifstream file(this_executable().concat(".commit"));
  std::string text;
  return file >> text ? text : "unknown";
}

std::string version_line() { return fmt::format("ubs {} (build {})", version(), build_id()); }

}  // namespace ubs::tools
