// SPDX-License-Identifier: Apache-2.0
#include "host/base/version.hpp"

#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <cstring>

#ifndef UBS_VERSION
#error "UBS_VERSION is not defined: the build must define it as the version of the project"
#endif

namespace ubs {
namespace {

// Returns the build ID from the note NT_GNU_BUILD_ID of a mapped segment, or an empty string if the segment
// has no such note.
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

struct Search {
  ElfW(Addr) address;  // an address in the object to look for
  std::string id;
};

// Callback of dl_iterate_phdr(). If the object `info` contains the address, stores its build ID and ends the
// iteration.
int visit(dl_phdr_info* info, std::size_t, void* search_pointer) {
  Search& search = *static_cast<Search*>(search_pointer);
  bool holds = false;
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const auto& segment = info->dlpi_phdr[i];
    const ElfW(Addr) start = info->dlpi_addr + segment.p_vaddr;
    holds |= segment.p_type == PT_LOAD && search.address >= start && search.address < start + segment.p_memsz;
  }
  if (!holds) return 0;
  for (int i = 0; i < info->dlpi_phnum && search.id.empty(); ++i) {
    const auto& segment = info->dlpi_phdr[i];
    if (segment.p_type == PT_NOTE)
      search.id =
          find_build_id(reinterpret_cast<const char*>(info->dlpi_addr + segment.p_vaddr), segment.p_memsz);
  }
  return 1;
}

}  // namespace

const char* const kVersion = UBS_VERSION;

std::string version() { return kVersion; }

std::string build_id() {
  Search search{reinterpret_cast<ElfW(Addr)>(&build_id), ""};
  dl_iterate_phdr(visit, &search);
  return search.id.empty() ? "unknown" : search.id;
}

}  // namespace ubs
