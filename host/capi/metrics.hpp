// SPDX-License-Identifier: Apache-2.0
// metrics_to() converts the metrics of a view to the struct of the C interface. ubs_meter is the handle of an
// object that compares images.
#pragma once

#include <memory>
#include <optional>

#include "host/capi/handles.hpp"
#include "host/model/image_comparison.hpp"
#include "host/train/evaluate.hpp"

struct ubs_meter {
  std::shared_ptr<ubs::facade::OpenDevice> open;
  std::optional<ubs::ImageComparison> comparison;
};

namespace ubs::facade {

ubs_metrics metrics_to(const ViewMetrics& metrics);

}  // namespace ubs::facade
