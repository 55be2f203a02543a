// SPDX-License-Identifier: Apache-2.0
// Manages PoCL's cache of compiled kernels, which is placed in the cache folder of ubs. By default PoCL uses
// $POCL_CACHE_DIR, or a folder in $XDG_CACHE_HOME or $HOME. If it cannot write there, it reports no devices
// at all. It also leaves temporary files behind.
#pragma once

#include <filesystem>

#include "host/base/environment.hpp"

namespace ubs::opencl {

// Allows prepare_driver_cache() to set environment variables with `set`. PoCL reads its folder from the
// environment, which belongs to the whole process, so only executables call this function (registry.hpp). In
// other processes PoCL uses its own folder.
void keep_driver_cache(SetVariable set);

// Must be called before the first OpenCL call; only the first call has an effect. Sets POCL_CACHE_DIR to
// `pocl` in kernel_cache_folder(), after removing old and damaged files there. A POCL_CACHE_DIR set by the
// user is kept if it is writable. With UBS_KERNEL_CACHE=off, or if there is no usable folder, PoCL gets a
// temporary folder for this process only, or one that cannot exist. Without this setting, PoCL would choose a
// folder in the temporary directory that any user may have created, and run the code in it.
void prepare_driver_cache();

// Returns whether the environment specifies a folder for PoCL. It always does after prepare_driver_cache() in
// a process that has called keep_driver_cache(). In other processes, PoCL must not be asked for devices
// unless this returns true.
bool driver_has_folder();

// Removes programs with damaged files and returns their number. (A power failure leaves files empty,
// truncated or full of zeros, and PoCL runs them.) The file `sums` of the folder contains check sums. They
// are compared for files that have changed, and for all files once after each start of the machine. Never
// throws.
std::size_t heal_driver_cache(const std::filesystem::path& folder);

// Stores check sums of new files. Called at the end of a process. Never throws.
void record_driver_cache(const std::filesystem::path& folder);

// Removes PoCL's temporary files that are older than ten minutes (a kernel compiles in seconds) and, once per
// day, programs that were not used for 90 days. Safe while other processes use the folder. Never throws.
void tidy_driver_cache(const std::filesystem::path& folder);

}  // namespace ubs::opencl
