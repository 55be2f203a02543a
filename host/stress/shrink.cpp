// SPDX-License-Identifier: Apache-2.0
// See shrink.hpp.
#include "host/stress/shrink.hpp"

#include <algorithm>
#include <cmath>

namespace ubs::stress {
namespace {

constexpr int kMaxEvaluations = 600;

Case without_splats(const Case& c, std::size_t first, std::size_t count) {
  Case smaller = c;
  const std::size_t left = c.model.count - count;
  smaller.model = SplatModel(c.model.dim, left, c.model.variant);
  for (int row = 0; row < c.model.layout().count; ++row) {
    const std::span<const float> from = c.model.row(row);
    const std::span<float> to = smaller.model.row(row);
    std::copy_n(from.begin(), first, to.begin());
    std::copy(from.begin() + static_cast<std::ptrdiff_t>(first + count), from.end(),
              to.begin() + static_cast<std::ptrdiff_t>(first));
  }
  return smaller;
}

// Rows and columns [x, x + width) x [y, y + height) of the image; weights change where x or y is not 0.
Case cropped(const Case& c, int x, int y, int width, int height) {
  Case smaller = c;
  smaller.camera.width = width, smaller.camera.height = height;
  smaller.camera.cx -= x, smaller.camera.cy -= y;
  return smaller;
}

class Shrinker {
 public:
  Shrinker(const Case& c, const Verdict& failed, const std::function<Verdict(const Case&)>& examine)
      : result_{c, failed, 0}, fault_(failed.fault), examine_(examine) {}

  Shrunk run() {
    bool smaller = true;
    while (smaller && result_.evaluations < kMaxEvaluations) {
      smaller = drop_splats();
      smaller = crop() || smaller;
    }
    simplify();
    return result_;
  }

 private:
  bool keeps_failing(const Case& c) {
    if (result_.evaluations >= kMaxEvaluations) return false;
    ++result_.evaluations;
    const Verdict verdict = examine_(c);
    if (verdict.outcome != Outcome::failed || verdict.fault != fault_) return false;
    result_.smallest = c, result_.verdict = verdict;
    return true;
  }

  // Runs of splats, from halves down to single ones.
  bool drop_splats() {
    bool any = false;
    for (std::size_t run = std::max<std::size_t>(1, result_.smallest.model.count / 2);; run /= 2) {
      for (std::size_t first = 0; first < result_.smallest.model.count;) {
        const std::size_t count = std::min(run, result_.smallest.model.count - first);
        if (keeps_failing(without_splats(result_.smallest, first, count)))
          any = true;
        else
          first += count;
      }
      if (run <= 1) return any;
    }
  }

  bool crop() {
    bool any = false;
    for (bool smaller = true; smaller;) {
      smaller = false;
      const int w = result_.smallest.camera.width, h = result_.smallest.camera.height;
      if (w > 1)
        smaller = keeps_failing(cropped(result_.smallest, 0, 0, w / 2, h)) ||
                  keeps_failing(cropped(result_.smallest, w / 2, 0, w - w / 2, h));
      const int width = result_.smallest.camera.width;
      if (h > 1)
        smaller = keeps_failing(cropped(result_.smallest, 0, 0, width, h / 2)) ||
                  keeps_failing(cropped(result_.smallest, 0, h / 2, width, h - h / 2)) || smaller;
      any = any || smaller;
    }
    return any;
  }

  // Each raw value: neutral, else with two significant digits.
  void simplify() {
    for (std::size_t i = 0; i < result_.smallest.model.values.size(); ++i) {
      const float value = result_.smallest.model.values[i];
      if (value == 0) continue;
      const float magnitude =
          std::isfinite(value) ? std::pow(10.0f, std::floor(std::log10(std::abs(value))) - 1) : 1;
      for (const float simpler : {0.0f, std::round(value / magnitude) * magnitude}) {
        if (simpler == value || !std::isfinite(simpler)) continue;
        Case c = result_.smallest;
        c.model.values[i] = simpler;
        if (keeps_failing(c)) break;
      }
    }
  }

  Shrunk result_;
  Fault fault_;
  const std::function<Verdict(const Case&)>& examine_;
};

}  // namespace

Shrunk shrink(const Case& c, const Verdict& failed, const std::function<Verdict(const Case&)>& examine) {
  return Shrinker(c, failed, examine).run();
}

}  // namespace ubs::stress
