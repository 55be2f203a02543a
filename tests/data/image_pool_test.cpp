// SPDX-License-Identifier: Apache-2.0
// Tests ImagePool, which keeps decoded images up to a budget of memory. Pixels must not depend on the budget
// and the number of threads, the budget must be respected, and errors must be reported.
#include "host/scene/image_pool.hpp"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <exception>
#include <thread>
#include <vector>

#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

class CountedSource : public ImageSource {
 public:
  explicit CountedSource(int value, std::size_t pixels = 100) : value_(value), pixels_(pixels) {}
  Image8 load() const override {
    ++loads;
    if (value_ < 0) fail(ErrorKind::data, "image {} is damaged", value_);
    return {10, static_cast<int>(pixels_ / 10),
            std::vector<std::uint8_t>(3 * pixels_, static_cast<std::uint8_t>(value_))};
  }
  mutable std::atomic<int> loads{0};

 private:
  int value_;
  std::size_t pixels_;
};

}  // namespace

TEST_CASE("pool: images do not depend on the order of requests, the budget and the threads", "[pool]") {
  for (const std::size_t budget : {1u, 700u, 100000u})
    for (const unsigned threads : {1u, 4u}) {
      ImagePool pool(budget, threads);
      for (int i = 0; i < 20; ++i) pool.add(std::make_shared<CountedSource>(i));
      for (std::size_t draw = 0; draw < 300; ++draw) {
        pool.prefetch((draw * 7 + 21) % 20);
        const auto image = pool.get(draw * 7 % 20);
        REQUIRE(image->rgb[0] == draw * 7 % 20);
      }
      // The budget may be exceeded by the requested image, a prefetched image, and one image per decoding
      // thread.
      CHECK(pool.peak_bytes() <= std::max<std::size_t>(budget, 300) + 300 * (threads + 2));
      if (budget == 100000) CHECK(pool.decoded() == 20);
    }
}

TEST_CASE("pool: an image in the pool is decoded only once", "[pool]") {
  ImagePool pool(1000);
  const auto source = std::make_shared<CountedSource>(5);
  pool.add(source);
  for (int i = 0; i < 10; ++i) {
    pool.prefetch(0);
    pool.get(0);
  }
  CHECK(source->loads == 1);
}

TEST_CASE("pool: every request for a broken image throws its error", "[pool]") {
  ImagePool pool(1000);
  pool.add(std::make_shared<CountedSource>(-3));
  pool.prefetch(0);
  for (int i = 0; i < 3; ++i) CHECK_THAT(message_of([&] { pool.get(0); }), Contains("image -3 is damaged"));
}

TEST_CASE("pool: several threads get the right images, although the pool only has space for one", "[pool]") {
  ImagePool pool(1, 4);
  for (int i = 0; i < 3; ++i) pool.add(std::make_shared<CountedSource>(i, 1000));
  std::atomic<int> wrong{0};
  {
    std::vector<std::jthread> threads;
    for (unsigned t = 0; t < 16; ++t)
      threads.emplace_back([&pool, &wrong, random = 7919 * t + 1]() mutable {
        for (int draw = 0; draw < 5000; ++draw) {
          random = random * 1664525 + 1013904223;
          const std::size_t index = (random >> 16) % 3;
          pool.prefetch(index);
          pool.prefetch((random >> 8) % 3);
          const auto image = pool.get(index);
          if (!image || image->rgb[0] != index) ++wrong;
        }
      });
  }
  CHECK(wrong == 0);
}

// Sanitizers reserve more address space than this test allows.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_CASE("pool: a thread that cannot be started is an error, not an endless wait", "[pool]") {
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    alarm(20);  // ends the process if the constructor waits for ever
    const rlimit limit{rlim_t{1} << 30, rlim_t{1} << 30};
    setrlimit(RLIMIT_AS, &limit);
    try {
      const ImagePool pool(1000, 1000);  // more stacks than the limit allows
    } catch (const std::exception&) {
      _exit(0);
    }
    _exit(1);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
}
#endif
