// SPDX-License-Identifier: Apache-2.0
#include "host/view/window.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"
#include "host/data/opencv_parts.hpp"

namespace ubs {
namespace {

constexpr int kTimeSteps = 1000, kBetaSteps = 100;
constexpr const char* kTimeSlider = "time";
constexpr int kLineHeight = 18, kColumn = 110;

void silence() {
  const int nowhere = ::open("/dev/null", O_WRONLY);
  dup2(nowhere, STDOUT_FILENO);
  dup2(nowhere, STDERR_FILENO);
  const rlimit none{0, 0};  // no core file of a toolkit that aborts
  setrlimit(RLIMIT_CORE, &none);
}

bool window_opens() {
  const pid_t child = fork();
  if (child < 0) return true;  // then the window itself will tell
  if (child == 0) {
    silence();
    try {
      opencv().namedWindow("ubs", cv::WINDOW_NORMAL | cv::WINDOW_GUI_NORMAL);
      _exit(0);
    } catch (...) {
      _exit(1);
    }
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

cv::Mat to_bgr(const Image8& picture) {
  const cv::Mat rgb(picture.height, picture.width, CV_8UC3, const_cast<std::uint8_t*>(picture.rgb.data()));
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

// White with a black rim: readable over anything.
void write_text(cv::Mat& canvas, const std::string& text, const cv::Point& at) {
  for (const auto& [colour, thickness] :
       {std::pair{cv::Scalar(0, 0, 0), 3}, std::pair{cv::Scalar(255, 255, 255), 1}})
    cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.45, colour, thickness, cv::LINE_AA);
}

void write_lines(cv::Mat& canvas, const std::vector<std::string>& lines, int y) {
  for (const std::string& line : lines) {
    y += kLineHeight;
    const std::size_t tabulator = line.find('\t');
    write_text(canvas, line.substr(0, tabulator), {8, y});
    if (tabulator != std::string::npos) write_text(canvas, line.substr(tabulator + 1), {kColumn, y});
  }
}

}  // namespace

// Keys that type nothing have X11's numbers from 0xff00 on: in their lower bits Shift is an 'a', Up an 'R'.
char typed_key(int code) {
  const int symbol = code & 0xffff;  // GTK puts Shift, Num Lock and the like above
  const bool keypad = symbol >= 0xffaa && symbol <= 0xffb9;
  return keypad || symbol < 0x80 ? static_cast<char>(symbol & 0x7f) : '\0';
}

void require_display() {
  if (window_opens()) return;
  const char* display = std::getenv("DISPLAY");
  fail(ErrorKind::device,
       "no window can be opened ({}): use a desktop or 'xvfb-run', or 'ubs render --path' without one",
       display && *display ? fmt::format("DISPLAY is {}", display) : "DISPLAY is not set");
}

Window::Window(std::string title, Viewer& viewer) : title_(std::move(title)), viewer_(viewer) {
  opencv().namedWindow(title_, cv::WINDOW_NORMAL | cv::WINDOW_FREERATIO | cv::WINDOW_GUI_NORMAL);
  opencv().resizeWindow(title_, {viewer.width(), viewer.height()});
  opencv().setMouseCallback(title_, on_mouse, this);
  add_sliders();
  fit_picture();
}

Window::~Window() {
  try {
    opencv().destroyAllWindows();
  } catch (const cv::Exception&) {  // closed by the user
  }
}

// The size of a window includes its sliders, whose height only the toolkit knows.
void Window::fit_picture() {
  const cv::Size wanted(viewer_.width(), viewer_.height());
  cv::Mat canvas(wanted, CV_8UC3, cv::Scalar::all(0));
  write_lines(canvas, {"kernels are being built ..."}, 0);
  opencv().imshow(title_, canvas);
  cv::Size window = wanted;
  for (int attempt = 0; attempt < 5; ++attempt) {
    opencv().waitKey(30);
    const cv::Size now = opencv().getWindowImageRect(title_).size();
    if (now == wanted || now.width < 1 || now.height < 1) return;
    window += wanted - now;
    opencv().resizeWindow(title_, window);
  }
}

void Window::add_sliders() {
  if (viewer_.scene().has_time)
    opencv().createTrackbar(kTimeSlider, title_, nullptr, kTimeSteps, on_time, this);
  for (const BetaKind kind : kBetaKinds)
    if (viewer_.scene().has_beta[static_cast<std::size_t>(kind)])
      for (const bool high : {false, true})
        sliders_.push_back(
            {this, kind, high, fmt::format("{} beta {}", to_string(kind), high ? "to %" : "from %")});
  for (Slider& slider : sliders_)
    opencv().createTrackbar(slider.name, title_, nullptr, kBetaSteps, on_beta, &slider);
  update_sliders();
}

// Where keys, playing time, or a range's other end changed what they stand for.
void Window::update_sliders() {
  updating_ = true;
  const auto put = [&](const std::string& name, double value, int steps) {
    const int position = static_cast<int>(std::lround(value * steps));
    if (opencv().getTrackbarPos(name, title_) != position) opencv().setTrackbarPos(name, title_, position);
  };
  if (viewer_.scene().has_time) put(kTimeSlider, viewer_.pose().time, kTimeSteps);
  for (const Slider& s : sliders_)
    put(s.name, s.high ? viewer_.beta(s.kind).high : viewer_.beta(s.kind).low, kBetaSteps);
  updating_ = false;
}

void Window::on_time(int position, void* window) {
  Window& self = *static_cast<Window*>(window);
  if (!self.updating_) self.viewer_.set_time(position / static_cast<double>(kTimeSteps));
}

void Window::on_beta(int position, void* slider) {
  const Slider& s = *static_cast<Slider*>(slider);
  if (s.window->updating_) return;
  const double value = position / static_cast<double>(kBetaSteps);
  if (s.high)
    s.window->viewer_.set_beta_high(s.kind, value);
  else
    s.window->viewer_.set_beta_low(s.kind, value);
}

void Window::on_mouse(int event, int x, int y, int flags, void* window) {
  Window& self = *static_cast<Window*>(window);
  Viewer& viewer = self.viewer_;
  switch (event) {
    case cv::EVENT_LBUTTONDOWN:
      viewer.press(flags & cv::EVENT_FLAG_SHIFTKEY  ? Drag::pan
                   : flags & cv::EVENT_FLAG_CTRLKEY ? Drag::dolly
                                                    : Drag::orbit,
                   x, y);
      break;
    case cv::EVENT_RBUTTONDOWN:
    case cv::EVENT_MBUTTONDOWN:
      viewer.press(Drag::pan, x, y);
      break;
    case cv::EVENT_LBUTTONUP:
    case cv::EVENT_RBUTTONUP:
    case cv::EVENT_MBUTTONUP:
      viewer.release();
      break;
    case cv::EVENT_MOUSEMOVE:
      viewer.move(x, y);
      break;
    case cv::EVENT_MOUSEWHEEL:
      viewer.wheel(opencv().getMouseWheelDelta(flags) / 120.0);
      // highgui on Qt enlarges the picture at a turn of the wheel, after this event. What it saves of the
      // window now is what undo_zoom() brings back: the only way to undo it that its interface has.
      if (self.zoomed_) break;  // several turns at once: what was before the first of them counts
      try {
        opencv().saveWindowParameters(self.title_);
        self.zoomed_ = true;
      } catch (const cv::Exception&) {  // not Qt: nothing is enlarged
      }
      break;
    default:
      break;
  }
}

void Window::undo_zoom() {
  if (!zoomed_) return;
  zoomed_ = false;
  updating_ = true;  // the sliders are put where they are
  opencv().loadWindowParameters(title_);
  updating_ = false;
}

void Window::show(const Image8& picture, const std::vector<std::string>& lines,
                  const std::vector<std::string>& help) {
  cv::Mat canvas = to_bgr(picture);
  if (canvas.cols != viewer_.width() || canvas.rows != viewer_.height())
    cv::resize(canvas, canvas, {viewer_.width(), viewer_.height()}, 0, 0, cv::INTER_LINEAR);
  write_lines(canvas, lines, 0);
  write_lines(canvas, help, static_cast<int>(lines.size() + 1) * kLineHeight);
  opencv().imshow(title_, canvas);
}

void Window::poll(int milliseconds) {
  const char key = typed_key(opencv().waitKeyEx(std::max(1, milliseconds)));
  undo_zoom();
  if (opencv().getWindowProperty(title_, cv::WND_PROP_VISIBLE) < 0.5) return viewer_.quit();
  if (key != '\0') viewer_.key(key);
  const cv::Rect area = opencv().getWindowImageRect(title_);
  if (area.width > 0 && area.height > 0) viewer_.resize(area.width, area.height);
  update_sliders();
}

}  // namespace ubs
