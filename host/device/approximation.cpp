// SPDX-License-Identifier: Apache-2.0
#include "host/device/approximation.hpp"

namespace ubs {

std::string to_string(const Approximation& a) {
  std::string text;
  const auto add = [&](bool given, const std::string& word) {
    if (!given) return;
    if (!text.empty()) text += ' ';
    text += word;
  };
  add(a.math == MathMode::native, "math=native");
  add(a.math == MathMode::rough, "math=rough");
  add(a.vector_width != 0, "vector_width=" + std::to_string(a.vector_width));
  return text.empty() ? "none" : text;
}

}  // namespace ubs
