// SPDX-License-Identifier: Apache-2.0
// TargetImages holds the ground-truth images on the device as planar 8-bit data, with their masks if they
// have one. Images stay on the device while they fit into a budget. The others pass through two staging
// buffers in turn, so that one buffer is filled while the other one is read. Images that are not in host
// memory are decoded when they are needed, by an ImagePool with a separate memory budget.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/image_pool.hpp"

namespace ubs {

// Target is the data that an image is compared with. Its fields are the values for the fields `target`,
// `mask` and `counted` of ImageLoss.
struct Target {
  BufferView<std::uint8_t> image;  // (3, height, width)
  BufferView<std::uint8_t> mask;   // (height, width); empty: no pixel is masked
  std::uint32_t counted = 0;       // number of pixels that are not masked, if there is a mask
};

// Maximum size of the images that stay on the device, in bytes.
inline constexpr std::size_t kTargetBudgetBytes = std::size_t{1} << 30;

class TargetImages {
 public:
  // `budget_bytes` limits the images that stay on the device. `cache_bytes` limits the decoded images that
  // the ImagePool keeps in host memory.
  TargetImages(Device& device, std::size_t budget_bytes, std::size_t cache_bytes = std::size_t{4} << 30)
      : device_(device), budget_(budget_bytes), cache_(cache_bytes) {}

  // Registers the images of a split after those that are already registered. Every view must have an image.
  void add(const Split& split);
  // From now on, get() returns the first `views` images reduced by this factor (host/train/pyramid.hpp). The
  // function waits for the device.
  void reduce(std::size_t views, int factor);
  // Returns the image with the index `index`, counted over all splits. The result is valid until the second
  // following call of get() or upload() with another index.
  Target get(std::size_t index);
  // Starts to copy an image to the device, before get() needs it. The copy runs in parallel with the
  // operations that are enqueued after this call.
  void upload(std::size_t index);
  // Starts to decode an image that get() will need soon, if it is not in memory.
  void prefetch(std::size_t index);

 private:
  struct Planes {
    Buffer<std::uint8_t> image, mask;
    std::uint32_t counted = 0;
    // Whether the image has a mask. If not, `mask` of a staging buffer may still contain the mask of another
    // image.
    bool masked = false;
    Target view() const { return {image.view(), masked ? mask.view() : BufferView<std::uint8_t>{}, counted}; }
  };
  struct Entry {
    const Image8* image;  // null if the pool provides it
    std::size_t pooled;   // index of the image in the pool
    Planes planes;        // empty before the first use, and if it does not fit into the budget
  };
  Device& device_;
  std::size_t budget_, used_ = 0, cache_;
  std::size_t reduced_ = 0;          // number of reduced images, counted from the first
  int factor_ = 1;                   // factor of these images
  std::unique_ptr<ImagePool> pool_;  // created with the first image that needs it
  std::vector<Entry> entries_;
  struct Staging {
    Planes planes;
    std::size_t index = kNone;  // index of the image that it contains
  };
  static constexpr std::size_t kNone = ~std::size_t{0};
  const Staging* find_staged(std::size_t index) const;
  void fill(Planes& planes, const Image8& image);
  std::array<Staging, 2> staging_;
  std::size_t next_staging_ = 0;
};

}  // namespace ubs
