// SPDX-License-Identifier: Apache-2.0
// make_in_huge_pages() allocates buffers of CPU devices in huge pages (2 MiB on Linux). The kernels read from
// dozens of rows at the same time. The rows are in different pages. With small pages, these would be more
// pages than the TLB of the processor can hold. docs/performance.md contains the measured speed-up.
#pragma once

#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

// Returns a buffer of at least `bytes` bytes in host memory. The memory is freed together with the buffer.
// Returns an empty handle if the buffer is too small to benefit, if the system does not support huge pages,
// or if the environment variable UBS_HUGE_PAGES is 0. Then the caller lets the driver allocate the buffer.
// The system may still provide small pages; this only affects the speed.
MemHandle make_in_huge_pages(cl_context context, std::size_t bytes);

}  // namespace ubs::opencl
