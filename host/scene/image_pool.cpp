// SPDX-License-Identifier: Apache-2.0
// One mutex guards the whole pool. Images are decoded without holding it.
#include "host/scene/image_pool.hpp"

#include <algorithm>
#include <utility>

namespace ubs {
namespace {

// Maximum number of images that are prefetched and not yet fetched. A larger number would fill the memory
// budget without saving time.
constexpr std::size_t kMaxAhead = 8;

}  // namespace

ImagePool::ImagePool(std::size_t budget_bytes, unsigned threads) : budget_(budget_bytes) {
  try {
    for (unsigned i = 0; i < std::max(1u, threads); ++i) threads_.emplace_back([this] { work(); });
  } catch (...) {  // the destructor does not run if the constructor throws
    stop();
    throw;
  }
}

ImagePool::~ImagePool() { stop(); }

void ImagePool::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_ready_.notify_all();
  threads_.clear();  // joins the threads while the other members still exist
}

std::size_t ImagePool::add(std::shared_ptr<const ImageSource> source) {
  const std::lock_guard lock(mutex_);
  entries_.push_back({std::move(source), nullptr, nullptr, State::absent, false, recent_.end()});
  return entries_.size() - 1;
}

void ImagePool::prefetch(std::size_t index) {
  {
    const std::lock_guard lock(mutex_);
    Entry& entry = entries_.at(index);
    if (entry.wanted || wanted_ >= kMaxAhead) return;
    if (entry.state == State::ready) {  // mark as recently used, so that it is kept until it is fetched
      recent_.splice(recent_.end(), recent_, entry.place);
      return;
    }
    if (entry.state != State::absent) return;
    if (wanted_ > 0 && (wanted_ + 1) * largest_ > budget_) return;
    entry.state = State::queued;
    entry.wanted = true;
    ++wanted_;
    queue_.push_back(index);
  }
  work_ready_.notify_one();
}

std::shared_ptr<const Image8> ImagePool::get(std::size_t index) {
  std::unique_lock lock(mutex_);
  // Before this thread wakes up, other threads may have dropped the image that it waited for, and requested
  // it again.
  while (entries_.at(index).state != State::ready) {
    if (entries_[index].state == State::decoding) {
      image_ready_.wait(lock);
      continue;
    }
    std::erase(queue_, index);  // no thread has started to decode it, so decode it here
    decode(lock, index);
  }
  Entry& entry = entries_[index];
  if (entry.wanted) {
    entry.wanted = false;
    --wanted_;
  }
  if (entry.error) {
    const std::exception_ptr error = std::exchange(entry.error, nullptr);
    entry.state = State::absent;
    std::rethrow_exception(error);
  }
  recent_.splice(recent_.end(), recent_, entry.place);
  return entry.image;
}

// Decodes an image. On return the entry is ready. It either has an image and a place in recent_, or it has an
// error and no place in recent_.
void ImagePool::decode(std::unique_lock<std::mutex>& lock, std::size_t index) {
  entries_[index].state = State::decoding;
  const std::shared_ptr<const ImageSource> source = entries_[index].source;
  lock.unlock();
  std::shared_ptr<const Image8> image;
  std::exception_ptr error;
  try {
    image = std::make_shared<const Image8>(source->load());
  } catch (...) {
    error = std::current_exception();
  }
  lock.lock();
  Entry& entry = entries_[index];
  entry.state = State::ready;
  entry.error = error;
  ++decoded_;
  if (image) {
    entry.image = image;
    entry.place = recent_.insert(recent_.end(), index);
    bytes_ += image->bytes();
    largest_ = std::max(largest_, image->bytes());
    peak_ = std::max(peak_, bytes_);
    make_room(index);
  }
  image_ready_.notify_all();
}

// Drops the least recently used images until the rest fits into the budget. Image `keep`, and images that
// were prefetched and not yet fetched, are not dropped.
void ImagePool::make_room(std::size_t keep) {
  for (auto it = recent_.begin(); bytes_ > budget_ && it != recent_.end();) {
    Entry& entry = entries_[*it];
    if (entry.wanted || *it == keep) {
      ++it;
      continue;
    }
    bytes_ -= entry.image->bytes();
    entry.image.reset();
    entry.state = State::absent;
    it = recent_.erase(it);
  }
}

void ImagePool::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    work_ready_.wait(lock, [&] { return stop_ || !queue_.empty(); });
    if (stop_) return;
    const std::size_t index = queue_.front();
    queue_.pop_front();
    decode(lock, index);
  }
}

std::size_t ImagePool::peak_bytes() const {
  const std::lock_guard lock(mutex_);
  return peak_;
}

std::size_t ImagePool::decoded() const {
  const std::lock_guard lock(mutex_);
  return decoded_;
}

}  // namespace ubs
