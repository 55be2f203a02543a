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
// kernel_cache_folder(), tidied and healed; a POCL_CACHE_DIR of the user stays if it can be written. With
// UBS_KERNEL_CACHE=off, and where nothing can be kept, PoCL gets a folder of this process alone, or one that
// cannot exist: left to itself it takes a folder of the temporary one that anybody may have made, and runs
// what is there.
void prepare_driver_cache();

// Whether the environment gives PoCL a folder. Always true behind prepare_driver_cache() in a process that
// has called keep_driver_cache(); in others PoCL must not be asked for devices without one.
bool driver_has_folder();

// Removes programs with damaged files (a power cut leaves files empty, cut off or full of zeros, and PoCL
// runs them) and returns how many. Check sums are in the file `sums` of the folder. They are compared where a
// file has changed, and once after each start of the machine. Never throws.
std::size_t heal_driver_cache(const std::filesystem::path& folder);

// Writes down check sums of what is new. At the end of a process. Never throws.
void record_driver_cache(const std::filesystem::path& folder);

// Removes PoCL's temporary files that are older than ten minutes (a kernel compiles in seconds) and, once a
// day, programs that were not used for 90 days. Safe while other processes use the folder. Never throws.
void tidy_driver_cache(const std::filesystem::path& folder);

}  // namespace ubs::opencl
