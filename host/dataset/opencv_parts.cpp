// SPDX-License-Identifier: Apache-2.0
// See opencv_parts.hpp.
#include "host/dataset/opencv_parts.hpp"

#include <dlfcn.h>

#include <filesystem>

#include "host/base/error.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModule = UBS_OPENCV_MODULE;  // name of the module of this version of ubs

// Returns the path of the file that contains this code: the executable, or a library.
fs::path own_file() {
  Dl_info info{};
  const bool known = dladdr(reinterpret_cast<void*>(&opencv), &info) != 0 && info.dli_fname[0] == '/';
  return known ? fs::path(info.dli_fname) : fs::read_symlink("/proc/self/exe");
}

const OpencvParts& load() {
  const fs::path folder = own_file().parent_path();
  std::string tried;
  // The module is searched for next to the library, then in the build folder, then in the folder of an
  // installed ubs, and then in the folders that the dynamic loader searches.
  for (const fs::path& file :
       {folder / kModule, folder / "lib" / kModule, folder / "../lib" / kModule, fs::path(kModule)}) {
    void* module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (void* parts = module != nullptr ? dlsym(module, "ubs_opencv_parts") : nullptr)
      return *reinterpret_cast<const OpencvParts* (*)()>(parts)();
    tried += fmt::format("; {}", dlerror());
  }
  fail(ErrorKind::data,
       "{}: this file contains OpenCV's codecs for images and videos: put it next to the library, or into "
       "lib or ../lib of the program's folder{}",
       kModule, tried);
}

}  // namespace

const OpencvParts& opencv() {
  static const OpencvParts& parts = load();
  return parts;
}

}  // namespace ubs
