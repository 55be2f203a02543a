// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/huge_pages.hpp"

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstdlib>

#include "host/base/environment.hpp"

namespace ubs::opencl {

#ifdef MADV_HUGEPAGE

namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;
// Minimum size of a buffer that is allocated in huge pages [bytes]. With this minimum, rounding the size up
// to whole pages at most doubles it.
constexpr std::size_t kLeast = kHugePage / 2;

bool wanted() { return environment("UBS_HUGE_PAGES") != "0"; }

void CL_CALLBACK free_pages(cl_mem, void* pages) { std::free(pages); }

}  // namespace

MemHandle make_in_huge_pages(cl_context context, std::size_t bytes) {
  if (bytes < kLeast || !wanted()) return {};
  const std::size_t room = (bytes + kHugePage - 1) / kHugePage * kHugePage;
  void* pages = std::aligned_alloc(kHugePage, room);
  if (!pages) return {};
  madvise(pages, room, MADV_HUGEPAGE);  // a hint: with small pages, the buffer works too, but slower
  cl_int code = CL_SUCCESS;
  MemHandle memory(clCreateBuffer(context, CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR, bytes, pages, &code));
  if (code == CL_SUCCESS) code = clSetMemObjectDestructorCallback(memory.get(), free_pages, pages);
  if (code == CL_SUCCESS) return memory;
  memory.reset();
  std::free(pages);
  return {};
}

#else

MemHandle make_in_huge_pages(cl_context, std::size_t) { return {}; }

#endif

}  // namespace ubs::opencl
