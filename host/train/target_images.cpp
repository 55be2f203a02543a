// SPDX-License-Identifier: Apache-2.0
#include "host/train/target_images.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {
namespace {

std::vector<std::uint8_t> planar(const Image8& image) {
  const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  std::vector<std::uint8_t> planes(3 * pixels);
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pixels; ++i) planes[c * pixels + i] = image.rgb[3 * i + c];
  return planes;
}

// A file on a network drive may fail once; a second failure counts.
std::shared_ptr<const Image8> get_or_retry(ImagePool& pool, std::size_t index) {
  try {
    return pool.get(index);
  } catch (const Error&) {
    return pool.get(index);
  }
}

}  // namespace

void TargetImages::add(const Split& split) {
  for (const View& view : split.views) {
    if (!view.has_image())
      fail(ErrorKind::data, "view '{}' of split '{}' has no image to compare with", view.name, split.name);
    if (!view.source) {
      entries_.push_back({&view.image, 0, {}});
      continue;
    }
    if (!pool_) pool_ = std::make_unique<ImagePool>(cache_);
    entries_.push_back({nullptr, pool_->add(view.source), {}});
  }
}

const TargetImages::Staging* TargetImages::find_staged(std::size_t index) const {
  const auto found = std::ranges::find(staging_, index, &Staging::index);
  return found == staging_.end() ? nullptr : &*found;
}

View1<std::uint8_t> TargetImages::get(std::size_t index) {
  upload(index);
  device_.join_uploads();
  const Entry& entry = entries_[index];
  return entry.buffer ? entry.buffer.view() : find_staged(index)->buffer.view();
}

void TargetImages::upload(std::size_t index) {
  Entry& entry = entries_.at(index);
  if (entry.buffer || find_staged(index)) return;
  const std::vector<std::uint8_t> planes =
      entry.image ? planar(*entry.image) : planar(*get_or_retry(*pool_, entry.pooled));
  if (used_ + planes.size() <= budget_) {
    used_ += planes.size();
    entry.buffer = Buffer<std::uint8_t>(device_, "target image", planes.size());
    device_.upload_beside(*entry.buffer.view().memory, std::as_bytes(std::span(planes)));
    return;
  }
  Staging& staging = staging_[next_staging_];
  next_staging_ = (next_staging_ + 1) % staging_.size();
  if (staging.buffer.size() < planes.size()) staging.buffer = Buffer<std::uint8_t>(device_, "target image", planes.size());
  staging.index = index;
  device_.upload_beside(*staging.buffer.view().memory, std::as_bytes(std::span(planes)));
}

void TargetImages::prefetch(std::size_t index) {
  const Entry& entry = entries_.at(index);
  if (!entry.image && !entry.buffer) pool_->prefetch(entry.pooled);
}

}  // namespace ubs
