// SPDX-License-Identifier: Apache-2.0
// These functions convert the plan of a run to text and to JSON.
#pragma once

#include <string>

#include "host/train/plan.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

Json plan_json(const RunPlan& plan, const DeviceInfo& device);
std::string plan_text(const RunPlan& plan, const DeviceInfo& device);

}  // namespace ubs::tools
