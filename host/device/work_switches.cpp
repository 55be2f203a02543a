// SPDX-License-Identifier: Apache-2.0
#include "host/device/work_switches.hpp"

#include <fmt/format.h>

namespace ubs {

std::string to_string(const WorkSwitches& work) {
  std::string text;
  const auto add = [&](bool other, const std::string& part) {
    if (other) text += (text.empty() ? "" : ", ") + part;
  };
  add(work.alpha_min > 0, fmt::format("alpha_min {}", work.alpha_min));
  add(work.extents == Extents::support, "extents support");
  add(!work.view_cull, "view_cull off");
  add(work.block_cull == BlockCull::box, "block_cull box");
  add(!work.skip_finished, "skip_finished off");
  add(!work.masked_backward, "masked_backward off");
  return text.empty() ? "default" : text;
}

}  // namespace ubs
