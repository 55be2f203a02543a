// SPDX-License-Identifier: Apache-2.0
// What visitors wait for: at most one picture each, between the server's thread and the one that draws.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <optional>

#include "host/serve/server.hpp"

namespace ubs::serve {

class Wishes {
 public:
  void put(const Wish& wish) {
    const std::lock_guard lock(mutex_);
    wishes_[wish.visitor] = wish;
    changed_.notify_one();
  }
  // False where nothing of this visitor waits.
  bool replace(const Wish& wish) {
    const std::lock_guard lock(mutex_);
    const auto found = wishes_.find(wish.visitor);
    if (found == wishes_.end()) return false;
    found->second = wish;
    return true;
  }
  void drop(std::uint64_t visitor) {
    const std::lock_guard lock(mutex_);
    wishes_.erase(visitor);
  }
  // One visitor after the other; only if `take` says so of the one whose turn it is.
  std::optional<Wish> next(std::chrono::milliseconds wait, const std::function<bool(const Wish&)>& take) {
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, wait, [&] { return !wishes_.empty(); })) return {};
    auto found = wishes_.upper_bound(turn_);
    if (found == wishes_.end()) found = wishes_.begin();
    if (take && !take(found->second)) return {};
    turn_ = found->first;
    return wishes_.extract(found).mapped();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::uint64_t, Wish> wishes_;  // by visitor
  std::uint64_t turn_ = 0;                // who had the last one
};

}  // namespace ubs::serve
