// SPDX-License-Identifier: Apache-2.0
// Images of many views within a memory budget: decoded ahead in background threads, the least recently
// used dropped. What get() returns never depends on threads or budget, only its speed does.
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
  // At least the image asked for and one ahead stay, whatever the budget.
  explicit ImagePool(std::size_t budget_bytes, unsigned threads = 2);
  ~ImagePool();
  ImagePool(const ImagePool&) = delete;
  ImagePool& operator=(const ImagePool&) = delete;

  // The number under which the image is known; it is not decoded yet.
  std::size_t add(std::shared_ptr<const ImageSource> source);
  // Waits when a thread is decoding it, decodes it itself when none is. Rethrows what decoding threw.
  std::shared_ptr<const Image8> get(std::size_t index);
  // Asks for an image that will be wanted soon; ignored when it is there or the budget is full of
  // images that were asked for and not yet fetched.
  void prefetch(std::size_t index);

  std::size_t peak_bytes() const;  // most memory ever held
  std::size_t decoded() const;     // how often an image was decoded

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
