// SPDX-License-Identifier: Apache-2.0
// A training, or a model, to be looked at in a browser while it is there (docs/web.md). In a build without
// Boost the constructor of Server says so.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/run/model_session.hpp"
#include "host/scene/dataset.hpp"
#include "host/serve/server.hpp"
#include "host/train/trainer.hpp"
#include "host/view/scene_frame.hpp"

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
  // visitors may cost. What is referred to must outlive this.
  LiveTraining(Server& server, double share, Device& device, Trainer& trainer, const TrainSettings& settings,
               const Scene& scene, const TimeSource& time = steady_time());
  ~LiveTraining();

  void step(const StepReport& report);
  void end();  // everybody gets a picture of the last state
  std::string summary() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> own_;
};

// Until `stop` says so, which is asked ten times a second.
void serve_model(Server& server, ModelSession& session, const MixedModel& model, const Scene& scene,
                 const std::function<bool()>& stop);

}  // namespace ubs::serve
