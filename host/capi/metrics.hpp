// SPDX-License-Identifier: Apache-2.0
// metrics_to() converts the metrics of a view to the struct of the C interface.
#pragma once

#include "host/capi/handles.hpp"
#include "host/train/evaluate.hpp"

namespace ubs::facade {

ubs_metrics metrics_to(const ViewMetrics& metrics);

}  // namespace ubs::facade
