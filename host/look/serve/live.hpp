// SPDX-License-Identifier: Apache-2.0
// LiveTraining and serve_model() show a training or a model in the browser (docs/web.md). In a build without
// cpp-httplib the constructor of Server throws Error(usage).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/api/model_session.hpp"
#include "host/api/scene_frame.hpp"
#include "host/base/time_source.hpp"
#include "host/look/serve/server.hpp"
#include "host/scene/dataset.hpp"
#include "host/train/trainer.hpp"

namespace ubs::serve {

inline constexpr double kShare = 5;              // percent
inline constexpr std::size_t kMaxCameras = 100;  // that the page offers

// What the page begins with.
struct Scene {
  std::string title;
  SceneFrame frame;
  std::vector<View> cameras;  // to jump to; at least one, images are not looked at
  bool has_time = false;
};

// All calls from the thread that trains. Pictures are drawn between steps, as many as fit the share of the
// time, and the bits of the training stay what they are without.
class LiveTraining {
 public:
  // Builds the kernels, draws a first picture, and answers from now on. `share`: percent of the time that
  // pictures may cost. `scene` is in the unit of the data, whatever settings.unit is. What is referred to must
  // outlive this.
  LiveTraining(Server& server, double share, Device& device, Trainer& trainer, const TrainSettings& settings,
               const Scene& scene, const TimeSource& time = steady_time());
  ~LiveTraining();

  void step(const StepReport& report);
  // Draws pictures of the last state for two seconds at most, and the picture that is drawn at that time. It
  // waits for requests only if pictures were drawn in the last ten seconds. To be called when the model is
  // saved.
  void end();
  std::string summary() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

// Shows a model and never returns: nothing is lost when a signal ends the program.
void serve_model(Server& server, ModelSession& session, const MixedModel& model, const Scene& scene);

}  // namespace ubs::serve
