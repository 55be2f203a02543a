// SPDX-License-Identifier: Apache-2.0
#include "host/train/target_images.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/train/pyramid.hpp"

namespace ubs {
namespace {

// Returns an image from the pool. Reading from a network drive may fail once, so the function retries and
// only reports a second failure.
std::shared_ptr<const Image8> get_or_retry(ImagePool& pool, std::size_t index) {
  try {
    return pool.get(index);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception&) {
    return pool.get(index);
  }
}

}  // namespace

void TargetImages::add(const Split& split) {
  for (const View& view : split.views) {
    if (!view.has_image())
      fail(ErrorKind::data, "view '{}' of split '{}' has no image to compare with", view.name, split.name);
    if (const Image8* held = view.source ? view.source->held() : &view.image) {
      entries_.push_back({held, 0, {}});
      continue;
    }
    if (!pool_) pool_ = std::make_unique<ImagePool>(cache_);
    entries_.push_back({nullptr, pool_->add(view.source), {}});
  }
}

void TargetImages::reduce(std::size_t views, int factor) {
  device_.finish();  // no operation may still read the images that are released
  reduced_ = views;
  factor_ = factor;
  for (Entry& entry : entries_) entry.planes = {};
  for (Staging& staging : staging_) staging = {};
  used_ = 0;
}

const TargetImages::Staging* TargetImages::find_staged(std::size_t index) const {
  const auto found = std::ranges::find(staging_, index, &Staging::index);
  return found == staging_.end() ? nullptr : &*found;
}

Target TargetImages::get(std::size_t index) {
  upload(index);
  device_.join_uploads();
  const Entry& entry = entries_[index];
  return entry.planes.image ? entry.planes.view() : find_staged(index)->planes.view();
}

void TargetImages::fill(Planes& planes, const Image8& image) {
  const auto copy = [&](Buffer<std::uint8_t>& buffer, const char* label,
                        std::span<const std::uint8_t> values) {
    if (buffer.size() < values.size()) buffer = Buffer<std::uint8_t>(device_, label, values.size());
    device_.copy_async(*buffer.view().memory, std::as_bytes(values));
  };
  copy(planes.image, "target image", planar(image.rgb));
  planes.masked = !image.mask.empty();
  if (!planes.masked) return;
  copy(planes.mask, "target mask", image.mask);
  planes.counted = static_cast<std::uint32_t>(image.mask.size() -
                                              static_cast<std::size_t>(std::ranges::count(image.mask, 0)));
}

void TargetImages::upload(std::size_t index) {
  Entry& entry = entries_.at(index);
  if (entry.planes.image || find_staged(index)) return;
  const std::shared_ptr<const Image8> pooled = entry.image ? nullptr : get_or_retry(*pool_, entry.pooled);
  const Image8& full = entry.image ? *entry.image : *pooled;
  const Image8 small = index < reduced_ && factor_ > 1 ? reduced(full, factor_) : Image8{};
  const Image8& image = small.rgb.empty() ? full : small;
  if (used_ + image.bytes() <= budget_) {
    Planes planes;  // local until it is complete, because an allocation may fail
    fill(planes, image);
    entry.planes = std::move(planes);
    used_ += image.bytes();
    return;
  }
  Staging& staging = staging_[next_staging_];
  next_staging_ = (next_staging_ + 1) % staging_.size();
  staging.index = kNone;
  fill(staging.planes, image);
  staging.index = index;
}

void TargetImages::prefetch(std::size_t index) {
  const Entry& entry = entries_.at(index);
  if (!entry.image && !entry.planes.image) pool_->prefetch(entry.pooled);
}

}  // namespace ubs
