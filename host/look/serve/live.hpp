// SPDX-License-Identifier: Apache-2.0
// LiveTraining and serve_model() show live training or a model in the browser (docs/web.md). In a build
// without the server (without cpp-httplib or OpenCV, or with UBS_SERVE=OFF), the constructor of Server throws
// Error(usage).
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/look/serve/server.hpp"
#include "host/model/model_session.hpp"
#include "host/model/scene_frame.hpp"
#include "host/scene/dataset.hpp"
#include "host/train/trainer.hpp"

namespace ubs::serve {

inline constexpr double kShare = 5;              // default share of the time for rendering [percent]
inline constexpr std::size_t kMaxCameras = 100;  // maximum number of cameras in the page

// Scene is the initial state of the page.
struct Scene {
  std::string title;
  SceneFrame frame;
  std::vector<View> cameras;  // selectable cameras, at least one; images are not used
  std::size_t start = 0;      // index of the initial camera
  bool captured = false;      // see web::ViewerPage
  bool has_time = false;
};

// LiveTraining shows a training run in the browser. All functions must be called from the training thread.
// Images are rendered between training steps, as many as fit into their share of the time. Rendering does not
// change the result: the model is bit-identical to that of a training run without a server.
class LiveTraining {
 public:
  // Compiles the kernels, renders a first image, and starts to answer requests. `share` is the percentage of
  // the time that rendering may take. Lengths in `scene` are in the unit of the data, for any settings.unit.
  // All arguments passed by reference must outlive this object.
  LiveTraining(Server& server, double share, Device& device, Trainer& trainer, const TrainSettings& settings,
               const Scene& scene, const TimeSource& time = steady_time());
  ~LiveTraining();

  // Records the report of a step. Publishes the state if the report contains a loss or a test, or if more
  // than a second has passed since the last time. Then renders an image if one is requested, if the share of
  // the time allows it, and if training `continues`. After a signal or the last step, `continues` is false,
  // so that the model is saved before images are rendered.
  void step(const StepReport& report, bool continues);
  // Renders images of the final state. No image is started after two seconds. The function waits for requests
  // only if images were rendered in the last ten seconds. Call it after saving the model.
  void end();
  // Returns whether a browser that shows the page has sent a request in the last 90 seconds. The page sends
  // requests at least once per minute, even if it is hidden.
  bool has_viewer() const;
  // Renders images of the final state until `ends` returns true or has_viewer() returns false. Both are
  // checked after each image, and at least once per second while no image is requested. Call it after end().
  void stay(const std::function<bool()>& ends);
  // Returns a string with the number of rendered images, the time that they took, and the percentage of the
  // time since the constructor.
  std::string summary() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

// Serves a model and never returns. A signal ends the program, because nothing needs to be saved.
void serve_model(Server& server, ModelSession& session, const MixedModel& model, const Scene& scene);

}  // namespace ubs::serve
