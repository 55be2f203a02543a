// SPDX-License-Identifier: Apache-2.0
// A thread can be asked to end what it does early: it has a pointer to a number that another thread sets to a
// value other than 0. check_stop() throws Stopped if this has happened. parallel_for() calls it, and so does
// the compilation of kernels.
#pragma once

#include <atomic>
#include <cstdint>
#include <exception>

namespace ubs {

struct Stopped : std::exception {
  const char* what() const noexcept override { return "stopped by the caller"; }
};

// The number of this thread, or null. It belongs to the caller of ubs_set_stop_flag().
inline thread_local std::int32_t* stop_flag = nullptr;

inline void check_stop() {
  if (stop_flag && std::atomic_ref(*stop_flag).load(std::memory_order_relaxed) != 0) throw Stopped();
}

}  // namespace ubs
