// SPDX-License-Identifier: Apache-2.0
// What the kernels leave out (docs/work-switches.md). All but alpha_min leave the results as they are, and
// are there so that their gain can be measured by switching them off; defaults are what is fastest. Compiled
// in: what is not chosen costs nothing.
#pragma once

#include <string>

namespace ubs {

enum class Extents {
  opacity,
  support
};  // footprint ends where alpha falls to its least value | with the kernel
enum class BlockCull { ellipse, box };  // 4x4 blocks of pixels: those the ellipse reaches | its bounding box

struct WorkSwitches {
  float alpha_min = 0;                 // contributions of alpha <= alpha_min are left out; 0: none are
  Extents extents = Extents::opacity;  // no difference where every alpha > 0 counts
  bool view_cull = true;               // only splats that meet the image are sorted
  BlockCull block_cull = BlockCull::ellipse;
  bool skip_finished = true;    // blocks of pixels that take no more light are left out
  bool masked_backward = true;  // backward visits the blocks that forward found, not the whole tile

  bool operator==(const WorkSwitches&) const = default;
};

// "default" or "alpha_min 0.004, view_cull off": what is not at its default.
std::string to_string(const WorkSwitches& work);

}  // namespace ubs
