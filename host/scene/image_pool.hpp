// SPDX-License-Identifier: Apache-2.0
// ImagePool holds the images of many views within a memory budget. Background threads decode images ahead of
// time, and the least recently used images are dropped. The result of get() never depends on the number of
// threads or the budget; only its speed does.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <list>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

class ImagePool {
 public:
  // The requested image and one prefetched image are always kept, even if they exceed the budget.
  explicit ImagePool(std::size_t budget_bytes, unsigned threads = 2);
  ~ImagePool();
  ImagePool(const ImagePool&) = delete;
  ImagePool& operator=(const ImagePool&) = delete;

  // Adds an image and returns its index for get() and prefetch(). Does not decode it yet.
  std::size_t add(std::shared_ptr<const ImageSource> source);
  // Returns an image. If the image is not in memory, the call waits for the thread that is decoding it, or
  // decodes it in the calling thread if no other thread is decoding it. Rethrows errors of decoding.
  std::shared_ptr<const Image8> get(std::size_t index);
  // Requests an image that will be needed soon. Does nothing if the image is already in memory, or if enough
  // images were prefetched and not yet fetched: eight, or as many as fit into the budget.
  void prefetch(std::size_t index);

  std::size_t peak_bytes() const;  // maximum of the memory in use so far
  std::size_t decoded() const;     // number of decoded images; an image counts each time it is decoded

 private:
  enum class State { absent, queued, decoding, ready };
  struct Entry {
    std::shared_ptr<const ImageSource> source;
    std::shared_ptr<const Image8> image;
    std::exception_ptr error;
    State state = State::absent;
    bool wanted = false;  // prefetched and not yet fetched
    std::list<std::size_t>::iterator place;
  };

  void stop();
  void work();
  void decode(std::unique_lock<std::mutex>& lock, std::size_t index);
  void make_room(std::size_t keep);

  mutable std::mutex mutex_;
  std::condition_variable work_ready_, image_ready_;
  std::vector<Entry> entries_;
  std::deque<std::size_t> queue_;
  std::list<std::size_t> recent_;  // ready images, least recently used first
  std::size_t budget_, bytes_ = 0, peak_ = 0, decoded_ = 0, wanted_ = 0, largest_ = 0;
  bool stop_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace ubs
