// SPDX-License-Identifier: Apache-2.0
// The plan of a run as text and as JSON.
#pragma once

#include <string>

#include "host/train/plan.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

Json plan_json(const RunPlan& plan, const DeviceInfo& device);
std::string plan_text(const RunPlan& plan, const DeviceInfo& device);

}  // namespace ubs::tools
