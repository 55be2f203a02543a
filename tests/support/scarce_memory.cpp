// SPDX-License-Identifier: Apache-2.0
// If a program loads this library with LD_PRELOAD, one of its C++ allocations fails. With
// UBS_SCARCE_MEMORY=BYTES,N, this is the N-th allocation of exactly BYTES bytes: it throws std::bad_alloc.
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <new>

namespace {

struct Scarce {
  unsigned long bytes = 0, nth = 0;
  std::atomic<unsigned long> seen{0};
  Scarce() {
    const char* text = std::getenv("UBS_SCARCE_MEMORY");
    if (text && std::sscanf(text, "%lu,%lu", &bytes, &nth) != 2) std::abort();
  }
};

}  // namespace

void* operator new(std::size_t bytes) {
  static Scarce scarce;
  if (bytes == scarce.bytes && ++scarce.seen == scarce.nth) throw std::bad_alloc();
  void* memory = std::malloc(bytes > 0 ? bytes : 1);
  if (!memory) throw std::bad_alloc();
  return memory;
}

void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
