// SPDX-License-Identifier: Apache-2.0
// The state of `ubs view` without its window: events in; camera, choice of splats and orders out. Everything
// is deterministic; time passes only through advance().
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "host/scene/pose.hpp"
#include "host/view/decompose.hpp"
#include "host/view/picture.hpp"
#include "host/view/scene_frame.hpp"

namespace ubs {

struct ViewerScene {
  SceneFrame frame;
  std::vector<Camera> views;  // keys 1 to 9, and N for the next one
  double fov = 0.87;          // horizontal [rad], where no view says otherwise
  bool has_time = false;
  std::array<bool, 3> has_beta{true, false, false};  // by BetaKind
};

enum class Drag { none, orbit, pan, dolly };

// What the program has to do once, beyond drawing.
enum class Order { save_picture, save_keyframes };

class Viewer {
 public:
  Viewer(ViewerScene scene, int width, int height);

  // Events. Unknown keys do nothing. Mouse positions are in pixels of the picture.
  void key(char key);
  void press(Drag drag, double x, double y);
  void move(double x, double y);
  void release() { drag_ = Drag::none; }
  void wheel(double steps);    // positive: nearer
  void set_time(double time);  // clamped to [0, 1]
  // Ends of the range of quantiles, clamped to [0, 1]; one that passes the other takes it along.
  void set_beta_low(BetaKind kind, double low);
  void set_beta_high(BetaKind kind, double high);
  void resize(int width, int height);
  void advance(double seconds);  // moves time on while it plays
  void quit() { quit_ = true; }

  // State.
  Camera camera() const;  // at the full size
  const Pose& pose() const { return pose_; }
  int width() const { return canvas_.width; }
  int height() const { return canvas_.height; }
  Channel channel() const { return channel_; }
  const BetaRange& beta(BetaKind kind) const { return betas_[static_cast<std::size_t>(kind)]; }
  const ViewerScene& scene() const { return scene_; }
  bool playing() const { return playing_; }
  bool help() const { return help_; }
  bool overlay() const { return overlay_; }
  // The view of the scene that the camera stands at, where its photograph is asked for (key G); else -1.
  int truth() const { return truth_ ? at_view_ : -1; }
  bool finished() const { return quit_; }
  const std::vector<Pose>& keyframes() const { return keyframes_; }
  // Grow with everything that makes another picture, and with every other choice of splats.
  std::uint64_t changes() const { return changes_; }
  std::uint64_t choices() const { return choices_; }
  std::vector<Order> take_orders();

 private:
  void reset();
  void go_to(std::size_t view);
  void orbit(double yaw, double pitch);
  void shift(double right, double down, double forward);
  void dolly(double factor);
  double depth() const;  // of the pivot
  void set_beta(BetaKind kind, const BetaRange& range);

  ViewerScene scene_;
  Canvas canvas_;
  Pose pose_;
  Vec3 pivot_{};  // what the mouse turns around
  Channel channel_ = Channel::rgb;
  std::array<BetaRange, 3> betas_{};
  Drag drag_ = Drag::none;
  double x_ = 0, y_ = 0;
  bool playing_ = false, help_ = false, overlay_ = true, quit_ = false, truth_ = false;
  int at_view_ = -1;
  std::vector<Pose> keyframes_;
  std::vector<Order> orders_;
  std::uint64_t changes_ = 1, choices_ = 1;
};

// Lines of the help overlay: input, tabulator, effect.
std::vector<std::string> viewer_help(const ViewerScene& scene);

// The part of the full resolution at which pictures are drawn while something moves, so that one takes about
// as long as 50 ms, from a sixteenth of the width to all of it.
class AdaptiveScale {
 public:
  double scale() const { return scale_; }
  // `seconds`: that a picture at `scale` took.
  void measured(double scale, double seconds);

 private:
  static constexpr double kTarget = 0.05;  // seconds
  double scale_ = 0.5;
};

}  // namespace ubs
