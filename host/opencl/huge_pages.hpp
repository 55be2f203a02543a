// SPDX-License-Identifier: Apache-2.0
// Allocates buffers of CPU devices in huge pages (2 MiB on Linux). The kernels read from dozens of rows at
// the same time, which takes more small pages than the processor's TLB holds. docs/performance.md has the
// speed-up.
#pragma once

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// Returns a buffer of at least `bytes` bytes in host memory, which is freed together with the buffer. Returns
// an empty handle if the buffer is too small to benefit, if the system has no huge pages, or with the
// environment variable UBS_HUGE_PAGES=0; the caller then lets the driver allocate the buffer. The system may
// still provide small pages; this only affects speed.
MemHandle make_in_huge_pages(cl_context context, std::size_t bytes);

}  // namespace ubs::opencl
