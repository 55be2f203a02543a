// SPDX-License-Identifier: Apache-2.0
// A window of the desktop (OpenCV's highgui): shows pictures, and turns mouse, keys and sliders into events
// of a Viewer. Nothing is known here of what the events mean.
#pragma once

#include <string>
#include <vector>

#include "host/view/viewer.hpp"

namespace ubs {

// Throws Error(device) where no window can be opened: no display, no driver. Found out in a process of its
// own, because toolkits abort when they find none; to be called before there are threads.
void require_display();

// The key that a code of cv::waitKeyEx() stands for; 0 for none, and for those that type nothing.
char typed_key(int code);

class Window {
 public:
  // With sliders for what the viewer's scene has. The viewer must outlive the window.
  Window(std::string title, Viewer& viewer);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  // Scaled up to the size of the viewer's picture where it is smaller, with lines of text over it (a
  // tabulator begins a second column).
  void show(const Image8& picture, const std::vector<std::string>& lines,
            const std::vector<std::string>& help);
  // Waits for events, at most about that long, and hands them on; closing the window ends the viewer.
  void poll(int milliseconds);

 private:
  static void on_mouse(int event, int x, int y, int flags, void* window);
  static void on_time(int position, void* window);
  struct Slider {
    Window* window;
    BetaKind kind;
    bool high;
    std::string name;
  };
  static void on_beta(int position, void* slider);
  void add_sliders();
  void fit_picture();
  void update_sliders();
  void undo_zoom();

  std::string title_;
  Viewer& viewer_;
  std::vector<Slider> sliders_;
  bool updating_ = false, zoomed_ = false;
};

}  // namespace ubs
