// SPDX-License-Identifier: Apache-2.0
// Buffers of CPU devices in huge pages (2 MiB on Linux): the kernels walk through dozens of rows at a time,
// whose small pages are more than the processor's page tables hold in cache. docs/performance.md has the
// gain.
#pragma once

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// A buffer that is at least `bytes` long, in memory of the host that is freed with it. Empty where it would
// not pay (small buffers), where the system has no such pages, or with the environment variable
// UBS_HUGE_PAGES=0: the caller lets the driver allocate then. The system may still give small pages; nothing
// else depends on it.
MemHandle make_in_huge_pages(cl_context context, std::size_t bytes);

}  // namespace ubs::opencl
