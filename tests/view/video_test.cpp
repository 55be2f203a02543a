// SPDX-License-Identifier: Apache-2.0
// Tests writing videos by reading them with OpenCV: the number of frames, their order, and that each frame is
// similar to the image that was written. Also tests errors when videos are written or read.
#include "host/dataset/video.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <opencv2/videoio.hpp>

#include "host/dataset/video_writer.hpp"
#include "tests/support/images.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using Catch::Contains;
using test::TempFolder;

namespace {

constexpr int kFrames = 7, kShift = 20;

std::vector<Image8> read_back(const std::filesystem::path& path, double* fps = nullptr) {
  cv::VideoCapture capture(path.string(), cv::CAP_FFMPEG);
  REQUIRE(capture.isOpened());
  if (fps) *fps = capture.get(cv::CAP_PROP_FPS);
  std::vector<Image8> frames;
  for (cv::Mat bgr; capture.read(bgr);) {
    Image8 frame{bgr.cols, bgr.rows, {}};
    for (int i = 0; i < bgr.cols * bgr.rows; ++i)
      for (int c = 2; c >= 0; --c) frame.rgb.push_back(bgr.data[3 * i + c]);
    frames.push_back(std::move(frame));
  }
  return frames;
}

void write(const std::filesystem::path& path) {
  VideoWriter writer(path, 96, 64, 24);
  for (int i = 0; i < kFrames; ++i) writer.write(test::gradient_image(96, 64, kShift * i));
  CHECK(!std::filesystem::exists(path));
  writer.commit();
}

}  // namespace

TEST_CASE("video: every supported format contains the frames in order") {
  const std::string possible = writable_videos();
  INFO(possible);
  CHECK_THAT(possible, Contains(".avi (MJPG)"));  // OpenCV contains this encoder, so it does not need FFmpeg
  for (const std::string& extension : video_extensions()) {
    if (possible.find(extension + " ") == std::string::npos) {
      WARN("SKIPPED: no encoder for " << extension);
      continue;
    }
    INFO(extension);
    const TempFolder folder;
    write(folder / ("v" + extension));
    CHECK(test::file_count(folder.path()) == 1);
    double fps = 0;
    const std::vector<Image8> frames = read_back(folder / ("v" + extension), &fps);
    CHECK(fps == Approx(24).epsilon(1e-3));
    REQUIRE(frames.size() == kFrames);
    for (int i = 0; i < kFrames; ++i) {
      // The observed errors are 3.1 for H.264 and 1.7 for Motion JPEG. Consecutive frames differ by at least
      // 18.8.
      CHECK(test::image_difference(frames[static_cast<std::size_t>(i)],
                                   test::gradient_image(96, 64, kShift * i)) < 6);
      CHECK(test::image_difference(frames[static_cast<std::size_t>(i)],
                                   test::gradient_image(96, 64, kShift * (i + 1))) > 12);
    }
  }
}

TEST_CASE("video: .AVI is treated like .avi") {
  const TempFolder folder;
  write(folder / "V.AVI");
  CHECK(read_back(folder / "V.AVI").size() == kFrames);
}

TEST_CASE("video: searching for supported formats does not overwrite files of other users") {
  const TempFolder folder;
  const test::Variable temporary("TMPDIR", folder.path().c_str());
  test::put(folder / "precious", "precious");
  // writable_videos() writes a small video. If its name were predictable, another user could create a link
  // with this name, and the target of the link would be overwritten.
  std::filesystem::create_symlink(folder / "precious", folder / fmt::format("ubs-codec-{}.avi", ::getpid()));
  CHECK_THAT(writable_videos(), Contains(".avi (MJPG)"));
  CHECK(test::get(folder / "precious") == "precious");
  CHECK(test::file_count(folder.path()) == 2);
}

TEST_CASE("video: an unfinished video leaves no file") {
  const TempFolder folder;
  {
    VideoWriter writer(folder / "v.avi", 64, 64, 10);
    writer.write(test::gradient_image(64, 64));
  }
  CHECK(test::file_count(folder.path()) == 0);
  {
    VideoWriter writer(folder / "none.avi", 64, 64, 10);
    CHECK_THAT(test::message_of([&] { writer.commit(); }), Contains("0 of 0 frames"));
  }
  CHECK(test::file_count(folder.path()) == 0);
}

// OpenCV does not report failed writes. A limit for the size of files simulates a full disk.
TEST_CASE("video: a video that could not be written completely is an error, and leaves no file") {
  const TempFolder folder;
  const auto write_noise = [&] {
    VideoWriter writer(folder / "v.avi", 96, 64, 10);
    Image8 noise{96, 64, std::vector<unsigned char>(std::size_t{3} * 96 * 64)};
    std::uint32_t state = 1;
    for (int i = 0; i < 16; ++i) {
      for (unsigned char& value : noise.rgb) {
        state = state * 1664525u + 1013904223u;
        value = static_cast<unsigned char>(state >> 24);
      }
      writer.write(noise);
    }
    writer.commit();
  };
  write_noise();
  const auto bytes = std::filesystem::file_size(folder / "v.avi");
  std::filesystem::remove(folder / "v.avi");
  rlimit before{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const double share : {0.3, 0.6, 0.95}) {
    INFO(share);
    const rlimit limit{static_cast<rlim_t>(share * static_cast<double>(bytes)), before.rlim_max};
    REQUIRE(setrlimit(RLIMIT_FSIZE, &limit) == 0);
    const std::string message = test::message_of(write_noise);
    REQUIRE(setrlimit(RLIMIT_FSIZE, &before) == 0);
    CHECK_THAT(message,
               Contains("v.avi: ") && (Contains("frames were written") || Contains("File too large")));
    CHECK(test::file_count(folder.path()) == 0);
  }
  std::signal(SIGXFSZ, handler);
}

TEST_CASE("video: a damaged frame gives an error at every attempt, and never a different frame") {
  const TempFolder folder;
  write(folder / "v.avi");
  std::string bytes = test::get(folder / "v.avi");
  std::size_t at = 0;
  for (int i = 0; i < 3; ++i) at = bytes.find("\xff\xd8\xff", at + 1);  // the start of frame 2
  REQUIRE(at != std::string::npos);
  bytes.replace(at, 200, 200, '\0');
  test::put(folder / "v.avi", bytes);
  const auto video = open_video(folder / "v.avi");
  const auto load = [&](int index) { return video_frame_source(video, index, 96, 64)->load(); };
  CHECK(test::image_difference(load(1), test::gradient_image(96, 64, kShift)) < 6);
  for (int i = 0; i < 3; ++i)
    CHECK_THAT(test::message_of([&] { load(2); }), Contains("v.avi: cannot decode frame 2"));
  for (int i = 0; i < 2; ++i)
    CHECK_THAT(test::message_of([&] { load(4); }), Contains("v.avi: the video ends before frame 4"));
  CHECK(test::image_difference(load(1), test::gradient_image(96, 64, kShift)) < 6);
}

// FFmpeg rejects this file, so OpenCV opens it with its own decoder, which throws a cv::Exception.
TEST_CASE("video: a frame whose size is wrong gives an error with the name of the file") {
  const TempFolder folder;
  {
    VideoWriter writer(folder / "v.avi", 16, 16, 10);
    for (int frame = 0; frame < 2; ++frame)
      writer.write({16, 16, std::vector<std::uint8_t>(768, static_cast<std::uint8_t>(60 * frame)), {}});
    writer.commit();
  }
  std::string bytes = test::get(folder / "v.avi");
  const std::size_t codec = bytes.find("MJPG", bytes.find("strf"));
  const std::size_t first = bytes.find("00dc", bytes.find("movi")), second = bytes.find("00dc", first + 4);
  REQUIRE(second != std::string::npos);
  bytes[codec + 3] = '\0';
  bytes[second + 7] = '\xc2';  // the last byte of the size of the frame
  test::put(folder / "v.avi", bytes);
  const auto video = open_video(folder / "v.avi");
  CHECK_THAT(test::message_of([&] { video_frame_source(video, 1, 16, 16)->load(); }),
             Contains("v.avi: cannot decode frame 1"));
}

TEST_CASE("video: names, sizes and rates that are not supported are rejected with a message") {
  const TempFolder folder;
  const auto refused = [&](const std::string& name, int width, double fps, ErrorKind kind) {
    return test::message_of([&] { VideoWriter(folder / name, width, 64, fps); }, kind);
  };
  CHECK_THAT(refused("v.gif", 64, 10, ErrorKind::usage),
             Contains("v.gif: the name of a video must end with one of .avi, "));
  CHECK_THAT(refused("v.avi", 63, 10, ErrorKind::usage),
             Contains("even width and height") && Contains("63x64"));
  CHECK_THAT(refused("v.avi", 64, 0, ErrorKind::usage), Contains("0 frames per second"));
  CHECK_THAT(refused("missing/v.avi", 64, 10, ErrorKind::data),
             Contains("missing: the folder does not exist"));
  test::put(folder / "d.avi/file", "");
  CHECK_THAT(refused("d.avi", 64, 10, ErrorKind::data), Contains("d.avi: this is a folder"));
  CHECK(test::file_count(folder.path()) == 1);
}
