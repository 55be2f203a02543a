// SPDX-License-Identifier: Apache-2.0
#include "host/base/time_source.hpp"

#include <chrono>

namespace ubs {
namespace {

class SteadyTime final : public TimeSource {
 public:
  double seconds() const override {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};

}  // namespace

const TimeSource& steady_time() {
  static const SteadyTime time;
  return time;
}

}  // namespace ubs
