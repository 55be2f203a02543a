// SPDX-License-Identifier: Apache-2.0
// Ground-truth images on the device as planar 8 bit, and their masks where they have one. They stay there
// while they fit a budget; beyond it images pass through two staging buffers in turn, so that one is filled
// while the other is read. Views whose images are not in memory are decoded on demand by a pool with a budget
// of its own.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/image_pool.hpp"

namespace ubs {

// What an image is compared with; the three fields of the same name of ImageLoss.
struct Target {
  BufferView<std::uint8_t> image;  // (3, height, width)
  BufferView<std::uint8_t> mask;   // (height, width); empty: all pixels count
  std::uint32_t counted = 0;       // pixels that count, where there is a mask
};

inline constexpr std::size_t kTargetBudgetBytes = std::size_t{1} << 30;  // of ground truth kept on the device

class TargetImages {
 public:
  TargetImages(Device& device, std::size_t budget_bytes, std::size_t cache_bytes = std::size_t{4} << 30)
      : device_(device), budget_(budget_bytes), cache_(cache_bytes) {}

  // Registers the images of a split behind those registered so far; every view must have one.
  void add(const Split& split);
  // From now on the first `views` images are reduced by this factor (host/train/pyramid.hpp). Waits.
  void reduce(std::size_t views, int factor);
  // The image registered as number `index`. Valid until the next but one call of get() or upload() with
  // another index.
  Target get(std::size_t index);
  // Starts to copy the image that get() will be asked for next; the copy runs beside the work given from now
  // on.
  void upload(std::size_t index);
  // Starts decoding an image that get() will want soon, where it is not in memory.
  void prefetch(std::size_t index);

 private:
  struct Planes {
    Buffer<std::uint8_t> image, mask;
    std::uint32_t counted = 0;
    bool masked = false;  // whether `mask` belongs to the image: staging keeps buffers
    Target view() const { return {image.view(), masked ? mask.view() : BufferView<std::uint8_t>{}, counted}; }
  };
  struct Entry {
    const Image8* image;  // null when the pool delivers it
    std::size_t pooled;   // its number there
    Planes planes;        // empty until first use, and where there is no room
  };
  Device& device_;
  std::size_t budget_, used_ = 0, cache_;
  std::size_t reduced_ = 0;          // images, from the first on
  int factor_ = 1;                   // that they are reduced by
  std::unique_ptr<ImagePool> pool_;  // made with the first image that needs it
  std::vector<Entry> entries_;
  struct Staging {
    Planes planes;
    std::size_t index = kNone;  // whose image it holds
  };
  static constexpr std::size_t kNone = ~std::size_t{0};
  const Staging* find_staged(std::size_t index) const;
  void fill(Planes& planes, const Image8& image);
  std::array<Staging, 2> staging_;
  std::size_t next_staging_ = 0;
};

}  // namespace ubs
