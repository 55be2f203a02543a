// SPDX-License-Identifier: Apache-2.0
// Tests that the memory for an image is checked before OpenCV allocates it (stated_image.hpp).
#include "host/dataset/stated_image.hpp"

#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/dataset/image.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using Catch::Contains;

// Limits the address space of this process to 4 GiB during its lifetime.
class LittleMemory {
 public:
  LittleMemory() {
    ::getrlimit(RLIMIT_AS, &before_);
    rlimit less = before_;
    less.rlim_cur = std::min<rlim_t>(less.rlim_cur, rlim_t{4} << 30);
    ::setrlimit(RLIMIT_AS, &less);
  }
  ~LittleMemory() { ::setrlimit(RLIMIT_AS, &before_); }
  LittleMemory(const LittleMemory&) = delete;
  LittleMemory& operator=(const LittleMemory&) = delete;

 private:
  rlimit before_{};
};

}  // namespace

TEST_CASE("the size of an image is read from the header of every format that OpenCV decodes") {
  for (const auto& [extension, type] :
       {std::pair{".bmp", CV_8UC3}, {".bmp", CV_8UC4}, {".webp", CV_8UC3}, {".webp", CV_8UC4}}) {
    INFO(extension << " " << type);
    std::vector<unsigned char> file;
    REQUIRE(cv::imencode(extension, cv::Mat(5, 7, type, cv::Scalar::all(9)), file));
    const StatedImage image = stated_image(std::as_bytes(std::span(file)), "a");
    CHECK(image.width == 7);
    CHECK(image.height == 5);
    for (std::size_t size = 0; size < file.size(); ++size) try {  // no read beyond the end
        stated_image(std::as_bytes(std::span(file).first(size)), "a");
      } catch (const Error& error) {
        CHECK(error.kind() == ErrorKind::data);
      }
  }
}

TEST_CASE("a small file that states a large image is refused before the memory is allocated") {
  const test::TempFolder folder;
  std::vector<unsigned char> bytes;
  REQUIRE(cv::imencode(".bmp", cv::Mat(5, 7, CV_8UC3, cv::Scalar::all(9)), bytes));
  std::string bmp(bytes.begin(), bytes.end());
  bmp.replace(18, 8, std::string("\x00\x7d\0\0\x00\x7d\0\0", 8));  // 32000 x 32000
  test::put(folder / "a.bmp", bmp);
  const LittleMemory limit;
  CHECK_THAT(test::message_of([&] { load_image(folder / "a.bmp"); }, ErrorKind::memory),
             Contains("a.bmp: an image of 32000 x 32000 pixels needs 6836 MiB of memory"));
  CHECK_THAT(test::message_of([] { require_image_memory(1u << 16, 1u << 16, 4, "b"); }),
             Contains("are too many"));
}

}  // namespace ubs
