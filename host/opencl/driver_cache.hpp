// SPDX-License-Identifier: Apache-2.0
// PoCL's cache of compiled kernels in our own folder. PoCL takes $POCL_CACHE_DIR, else a folder below
// $XDG_CACHE_HOME or $HOME; where it cannot write there it reports no device at all, and it leaves temporary
// files behind.
#pragma once

#include <filesystem>

#include "host/base/environment.hpp"

namespace ubs::opencl {

// PoCL is told its folder through the environment, which belongs to the whole process. So this is done only
// in a process that has called this function (registry.hpp); in others PoCL keeps its own folder.
void keep_driver_cache(SetVariable set);

// Must be called before the first call of OpenCL; does its work once. Sets POCL_CACHE_DIR to `pocl` in
// kernel_cache_folder(), tidied; a POCL_CACHE_DIR of the user stays if it can be written. With
// UBS_KERNEL_CACHE=off PoCL keeps nothing.
void prepare_driver_cache();

// Removes PoCL's temporary files that are older than ten minutes (a kernel compiles in seconds) and, once a
// day, programs that were not used for 90 days. Safe while other processes use the folder. Never throws.
void tidy_driver_cache(const std::filesystem::path& folder);

}  // namespace ubs::opencl
