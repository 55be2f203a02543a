// SPDX-License-Identifier: Apache-2.0
// These functions manage PoCL's cache of compiled kernels, which ubs places in its own cache folder. By
// default, PoCL uses $POCL_CACHE_DIR, or a folder in $XDG_CACHE_HOME or $HOME. If PoCL cannot write to this
// folder, it reports no devices at all. PoCL also does not remove its temporary files if it is interrupted.
#pragma once

#include <filesystem>

#include "host/base/environment.hpp"

namespace ubs::opencl {

// Allows prepare_driver_cache() to set environment variables with `set`. PoCL reads its folder from the
// environment, which belongs to the whole process, so only executables call this function (registry.hpp). In
// other processes PoCL uses its own folder.
void keep_driver_cache(SetVariable set);

// This function must be called before the first OpenCL call. Only its first call after keep_driver_cache()
// has an effect. It sets POCL_CACHE_DIR to `pocl` in kernel_cache_folder(), after removing old and damaged
// files there. A POCL_CACHE_DIR set by the user is kept if it is writable. With UBS_KERNEL_CACHE=off, or if
// there is no usable folder, PoCL gets a temporary folder for this process only, or the path of a folder that
// cannot exist. Otherwise PoCL would choose a folder in the temporary directory, which another user may have
// created, and run the code in it.
void prepare_driver_cache();

// Returns whether the environment specifies a folder for PoCL. This is always true after
// prepare_driver_cache() in a process that has called keep_driver_cache(). In other processes it may be
// false, and then PoCL must not be asked for devices.
bool driver_has_folder();

// Removes programs with damaged files and returns the number of these programs. (After a power failure, files
// may be empty, truncated or full of zeros, and PoCL would run them.) The file `sums` of the folder contains
// check sums. Files that have changed are compared with their check sums. After each start of the machine,
// all files are compared once. Never throws.
std::size_t heal_driver_cache(const std::filesystem::path& folder);

// Stores the check sums of new and changed files. It is called at the end of a process. Never throws.
void record_driver_cache(const std::filesystem::path& folder);

// Removes PoCL's temporary files that are older than ten minutes (a kernel compiles in seconds) and, once per
// day, programs that were not used for 90 days. Other processes may use the folder at the same time. Never
// throws.
void tidy_driver_cache(const std::filesystem::path& folder);

}  // namespace ubs::opencl
