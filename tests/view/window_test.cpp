// SPDX-License-Identifier: Apache-2.0
// `ubs view` on a screen of its own (Xvfb, whose frame buffer is a file): what is to be seen there is the
// rendered picture. Skipped, and said so, where Xvfb is missing.
#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "host/data/image.hpp"
#include "host/data/ply.hpp"
#include "host/data/resample.hpp"
#include "host/oracle/scenes.hpp"
#include "host/view/keyframes.hpp"
#include "tests/support/images.hpp"
#include "tests/support/run_ubs.hpp"

using namespace ubs;
using Catch::Contains;
using test::TempFolder;

namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr int kScreenWidth = 640, kScreenHeight = 800;

// A command in the background; ended with the object.
class Process {
 public:
  explicit Process(const std::string& command) : pid_(fork()) {
    if (pid_ != 0) return;
    execl("/bin/sh", "sh", "-c", fmt::format("exec {}", command).c_str(), nullptr);
    _exit(127);
  }
  ~Process() {
    if (pid_ <= 0) return;
    kill(pid_, SIGTERM);
    wait();
  }
  Process(const Process&) = delete;

  void signal(int number) { kill(pid_, number); }
  int wait() {
    int status = 0;
    waitpid(std::exchange(pid_, -1), &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t pid_;
};

template <typename Condition>
bool eventually(std::chrono::seconds limit, const Condition& condition) {
  for (const auto end = std::chrono::steady_clock::now() + limit; std::chrono::steady_clock::now() < end;
       std::this_thread::sleep_for(50ms))
    if (condition()) return true;
  return false;
}

// An XWD file with 32 bits a pixel: header of big-endian words, colour map, B G R x.
Image8 read_screen(const fs::path& path) {
  const std::string bytes = test::get(path);
  const auto word = [&](std::size_t i) {
    std::uint32_t value = 0;
    for (std::size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<unsigned char>(bytes.at(4 * i + k));
    return value;
  };
  const std::size_t width = word(4), height = word(5), pitch = word(12);
  const std::size_t start = word(0) + 12 * word(19);
  REQUIRE(word(11) == 32);
  Image8 screen{static_cast<int>(width), static_cast<int>(height), {}};
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      for (std::size_t c = 3; c-- > 0;)
        screen.rgb.push_back(static_cast<std::uint8_t>(bytes.at(start + y * pitch + 4 * x + c)));
  return screen;
}

bool matches(const Image8& screen, const Image8& part, std::size_t left, std::size_t top) {
  const std::size_t sw = static_cast<std::size_t>(screen.width), w = static_cast<std::size_t>(part.width);
  for (std::size_t y = 0; y < static_cast<std::size_t>(part.height); ++y)
    if (std::memcmp(&screen.rgb[3 * ((top + y) * sw + left)], &part.rgb[3 * y * w], 3 * w) != 0) return false;
  return true;
}

// Whether the picture is anywhere on the screen, each pixel the same.
bool on_screen(const Image8& screen, const Image8& part) {
  for (int top = 0; top + part.height <= screen.height; ++top)
    for (int left = 0; left + part.width <= screen.width; ++left)
      if (matches(screen, part, static_cast<std::size_t>(left), static_cast<std::size_t>(top))) return true;
  return false;
}

class Screen {
 public:
  Screen()
      : xvfb_(fmt::format("Xvfb -displayfd 3 -screen 0 {}x{}x24 -fbdir '{}' 3>'{}' >/dev/null 2>&1",
                          kScreenWidth, kScreenHeight, folder_.path().string(),
                          (folder_ / "display").string())) {
    REQUIRE(eventually(600s, [&] { return test::get(folder_ / "display").ends_with("\n"); }));
    display_ = fmt::format(":{}", test::get(folder_ / "display"));
    display_.pop_back();
  }
  const std::string& display() const { return display_; }
  Image8 look() const { return read_screen(folder_ / "Xvfb_screen0"); }

 private:
  TempFolder folder_;
  Process xvfb_;
  std::string display_;
};

// Without the settings of whoever runs the test.
std::string view(const TempFolder& folder, const std::string& environment, const std::string& arguments) {
  return fmt::format(
      "env -C '{}' -u WAYLAND_DISPLAY -u QT_QPA_PLATFORM {} XDG_CONFIG_HOME='{}' '{}' view {} "
      ">'{}' 2>'{}' </dev/null",
      folder.path().string(), environment, folder.path().string(), UBS_EXECUTABLE, arguments,
      (folder / "out.txt").string(), (folder / "err.txt").string());
}

}  // namespace

TEST_CASE("view: the window shows the rendered picture") {
  if (std::system("command -v Xvfb >/dev/null") != 0) {
    WARN("SKIPPED: Xvfb is not installed (package xvfb)");
    return;
  }
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", oracle::regular_scene({.count = 300, .dim = 7, .seed = 11}).model);
  const Screen screen;
  Process viewer(view(folder, fmt::format("DISPLAY={}", screen.display()),
                      "m.ply --size 320x240 --keys dwwwwwwwwwwwwwKO --screenshot s.png --quit-after 600"));
  REQUIRE(eventually(600s, [&] { return fs::exists(folder / "s.png"); }));
  const Image8 picture = load_image(folder / "s.png");
  CHECK(picture.width == 320);
  CHECK(picture.height == 240);
  Image8 black = picture;
  std::ranges::fill(black.rgb, std::uint8_t{0});
  CHECK(test::image_difference(picture, black) > 10);
  CHECK(eventually(600s, [&] { return on_screen(screen.look(), picture); }));

  // The keyframe that key K saved leads `ubs render` to the same picture.
  const KeyframeFile keys = read_keyframes(folder / "keyframes.json", {});
  CHECK(keys.poses.size() == 1);
  test::ubs_ok(folder, "render m.ply --path keyframes.json --path-frames 1 --size 320x240 --out r");
  // The same camera up to the rounding of its rotation: at most a level here and there.
  CHECK(test::image_difference(load_image(folder / "r/frame_0000.png"), picture) < 0.01);
}

TEST_CASE("view: a photograph beside the picture") {
  if (std::system("command -v Xvfb >/dev/null") != 0) {
    WARN("SKIPPED: Xvfb is not installed (package xvfb)");
    return;
  }
  const TempFolder folder;
  test::ubs_ok(folder, "synth glossy --out data --size 64 --views 2 --test-views 1 --supersampling 1");
  test::ubs_ok(folder, "train data --out run --dim 3 --iterations 1 --init-points 20 --quiet");
  const Screen screen;
  Process viewer(view(folder, fmt::format("DISPLAY={}", screen.display()),
                      "run data --size 320x240 --keys 2G --screenshot s.png --quit-after 0"));
  REQUIRE(viewer.wait() == 0);
  const Image8 shown = load_image(folder / "s.png");
  REQUIRE(shown.width == 320);
  // 160x160 on the left, 40 below the top.
  const Image8 photograph = load_image(folder / "data/train/r_001.png");
  Image8 left{160, 160, {}, {}};
  for (int y = 40; y < 200; ++y)
    left.rgb.insert(left.rgb.end(), shown.rgb.begin() + 3 * 320 * y, shown.rgb.begin() + 3 * (320 * y + 160));
  CHECK(test::image_difference(left, resize_bicubic(photograph, 160, 160)) == 0);
}

TEST_CASE("view: a signal ends it in order, twice at once, at any moment") {
  if (std::system("command -v Xvfb >/dev/null") != 0) {
    WARN("SKIPPED: Xvfb is not installed (package xvfb)");
    return;
  }
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", oracle::regular_scene({.count = 300, .dim = 3, .seed = 11}).model);
  const Screen screen;
  const std::string command = view(folder, fmt::format("DISPLAY={}", screen.display()),
                                   "m.ply --size 320x240 --keys KO --screenshot s.png --quit-after 600");
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    for (const char* file : {"s.png", "keyframes.json"}) fs::remove(folder / file);
    Process viewer(command);
    REQUIRE(eventually(600s, [&] { return fs::exists(folder / "s.png"); }));
    for (int i = 0; i < 2; ++i) viewer.signal(number);  // as `timeout` does
    INFO("signal " << number << "\n" << test::get(folder / "err.txt"));
    CHECK(viewer.wait() == 130);
    for (const auto& left : fs::recursive_directory_iterator(folder.path()))
      CHECK_FALSE(left.path().filename().string().starts_with(".ubs-tmp-"));
    CHECK_NOTHROW(read_keyframes(folder / "keyframes.json", {}));
  }
}

TEST_CASE("view: without a display, one line") {
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", oracle::regular_scene({.count = 20, .dim = 3}).model);
  for (const std::string environment : {"-u DISPLAY", "DISPLAY=:987"}) {
    CHECK(Process(view(folder, environment, "m.ply --quit-after 0")).wait() == 4);
    const std::string error = test::get(folder / "err.txt");
    CHECK_THAT(error, Contains("ubs: error: no window can be opened"));
    CHECK(error.find('\n') == error.size() - 1);
  }
}
