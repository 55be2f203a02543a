// SPDX-License-Identifier: Apache-2.0
// CaptureStages forwards every operation to other stages and stores the arguments of the last call of each
// operation. Benchmarks can then repeat a single operation of a training step with the buffer contents that
// the step left behind. The arguments refer to buffers of the renderer or trainer that made the call. They
// are valid as long as that renderer or trainer exists and its buffers do not grow.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "host/device/stages.hpp"

namespace ubs {

class CaptureStages final : public Stages {
 public:
  explicit CaptureStages(std::unique_ptr<Stages> stages) : stages_(std::move(stages)) {}

  const KernelConfig& config() const override { return stages_->config(); }
  Outcome run(const Operation& operation) override {
    last_[operation.index()] = operation;
    return stages_->run(operation);
  }

  // last() returns the arguments of the last call of an operation, and repeat() executes that call again. The
  // operation must have been called before.
  template <typename T>
  const T& last() const {
    return std::get<T>(last_[operation_index<T>()].value());
  }
  template <typename T>
  void repeat() {
    stages_->run(last_[operation_index<T>()].value());
  }
  // Returns the last call of the operation with this name in kOperationNames. Returns null if there is no
  // such operation or it was not called.
  const Operation* last(std::string_view name) const {
    const auto found = std::ranges::find(kOperationNames, name);
    if (found == kOperationNames.end()) return nullptr;
    const auto& last = last_[static_cast<std::size_t>(found - kOperationNames.begin())];
    return last ? &*last : nullptr;
  }
  Stages& real() { return *stages_; }

 private:
  std::unique_ptr<Stages> stages_;
  std::array<std::optional<Operation>, kOperationNames.size()> last_;
};

}  // namespace ubs
