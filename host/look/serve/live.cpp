// SPDX-License-Identifier: Apache-2.0
#include "host/look/serve/live.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/device/operations.hpp"
#include "host/look/serve/live_page.hpp"
#include "host/look/serve/painter.hpp"
#include "host/look/serve/picture_pause.hpp"
#include "host/look/web/steps.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::serve {
namespace {

constexpr std::size_t kMaxPoints = 400;  // maximum number of points of a curve
// An image may always have this number of intersections, which need about 0.1 GB.
constexpr std::uint64_t kIntersections = 4 << 20;
// This value means that there is no limit. It is used for a view of the training data, because training needs
// the same memory.
constexpr auto kUnlimited = std::numeric_limits<std::uint64_t>::max();
// These durations are in seconds. end() renders images for up to kLastPictures. It waits for requests only if
// an image was rendered in the last kWatched seconds. step() publishes the state if the last time was more
// than kFresh ago. If no request has arrived for kAway, the viewers have left.
constexpr double kLastPictures = 2, kWatched = 10, kFresh = 1, kAway = 90;
constexpr std::chrono::milliseconds kWait{1000};

// Returns the camera of the poster, which is the initial camera with fewer pixels.
Camera poster_camera(const Scene& scene) {
  Camera camera = scene.cameras.at(scene.start).camera;
  const double scale = std::min(1.0, double{web::kLongestPoster} / std::max(camera.width, camera.height));
  for (double* length : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *length *= scale;
  for (int* side : {&camera.width, &camera.height})
    *side = std::max(1, static_cast<int>(std::lround(scale * *side)));
  return camera;
}

}  // namespace

struct LiveTraining::Implementation {
  Server& server;
  double share;
  Device& device;
  Trainer& trainer;
  const TimeSource& time;
  double unit;  // length of the unit of training, measured in the unit of the data
  std::unique_ptr<Stages> stages{};
  std::unique_ptr<Painter> painter{};
  struct Point {
    int iteration = 0;
    double value = 0;
  };
  std::vector<Point> losses{}, tests{};
  StepReport report{};
  PicturePause pause{share, time};
  Stopwatch begun{time}, published{time}, last_picture{time};
  double spent = 0;  // seconds
  std::size_t pictures = 0;
  std::uint64_t requests = 0;  // number of requests at the last call of look_for_viewers()
  Stopwatch last_request{time};
  std::size_t sample_views = 0;  // number of views that `tests` are means of; 0: all test views
  bool ended = false;

  void look_for_viewers() {
    if (server.requests() == requests) return;
    requests = server.requests();
    last_request.restart();
  }

  // Converts the camera into the unit of training, and prepares the painter. Returns the present splats.
  RenderGroup prepare(Camera& camera) {
    scale_lengths(camera, 1 / unit);
    painter->use(render_settings(trainer.scene().settings_with_learnt_background()));
    return {stages.get(), trainer.scene().device_model().view()};
  }

  Image8 image(Camera camera) {
    const RenderGroup group = prepare(camera);
    return painter->image(std::span(&group, 1), camera, kUnlimited);
  }

  std::string draw(Camera camera, bool exact, std::uint64_t most) {
    const RenderGroup group = prepare(camera);
    return painter->draw(std::span(&group, 1), camera, exact, most);
  }

  // Answers the oldest request if one arrives within `wait`.
  bool serve(std::chrono::milliseconds wait = {}) {
    Stopwatch watch(time);
    const bool served = server.serve(wait, [&](const PictureRequest& request) -> Picture {
      watch.restart();
      const std::uint64_t most = std::max(kIntersections, trainer.scene().intersections().most);
      std::string bytes = draw(request.camera, request.exact, most);
      return {.bytes = std::move(bytes),
              .headers = {{"Ubs-Iteration", std::to_string(report.iteration)},
                          {"Ubs-Splats", std::to_string(report.splats)},
                          {"Ubs-Seconds",
                           fmt::format("{:.6f}", ended ? watch.seconds() : pause.period(watch.seconds()))}}};
    });
    if (!served) return false;
    spent += watch.seconds();
    ++pictures;
    pause.begin(watch.seconds());
    last_picture.restart();
    return true;
  }

  static void add(std::vector<Point>& points, int iteration, double value) {
    if (!std::isfinite(value)) return;
    while (!points.empty() && points.back().iteration >= iteration) points.pop_back();  // after a rollback
    points.push_back({iteration, value});
    if (points.size() < kMaxPoints) return;
    for (std::size_t i = 0; i < kMaxPoints / 2; ++i) points[i] = points[2 * i];
    points.resize(kMaxPoints / 2);
  }

  static Json points_json(const std::vector<Point>& points) {
    Json list = Json::array();
    for (const Point& point : points) list.push_back({point.iteration, point.value});
    return list;
  }

  void publish() {
    published.restart();
    Json state{{"iteration", report.iteration},
               {"iterations", report.iterations},
               {"seconds", report.seconds},
               {"left", report.expected_left()},
               {"splats", report.splats},
               {"memory", device.allocated_bytes()},
               {"peak", device.peak_bytes()},
               {"share", share},
               {"pictures", pictures},
               {"spent", spent},
               {"loss", points_json(losses)},
               {"test", points_json(tests)},
               {"ended", ended},
               {"sample_views", sample_views}};
    server.publish(json_text(state));
  }
};

LiveTraining::LiveTraining(Server& server, double share, Device& device, Trainer& trainer,
                           const TrainSettings& settings, const Scene& scene, const TimeSource& time)
    : own_(new Implementation{server, share / 100, device, trainer, time, settings.unit}) {
  Implementation& own = *own_;
  const DeviceModel& model = trainer.scene().device_model();
  KernelConfig config = kernel_config(model.dim(), settings.variant, settings, device.info());
  config.backward = false;  // images need no gradients
  own.stages = make_stages(device, config);
  own.painter = std::make_unique<Painter>(device, *own.stages, trainer.scene().render_settings());
  const std::string poster = web::poster_uri(own.image(poster_camera(scene)));  // also compiles the kernels
  own.report = {.iteration = trainer.iteration(),
                .iterations = settings.iterations,
                .seconds = trainer.seconds(),
                .splats = model.count()};
  own.publish();
  server.start(live_page(scene, true, poster));
  own.begun.restart();
}

LiveTraining::~LiveTraining() = default;

void LiveTraining::step(const StepReport& report, bool continues) {
  Implementation& own = *own_;
  own.report = report;
  own.look_for_viewers();
  if (report.loss) Implementation::add(own.losses, report.iteration, *report.loss);
  if (report.sample) {
    own.sample_views = report.sample->views;
    Implementation::add(own.tests, report.iteration, report.sample->psnr);
  } else if (report.test && own.sample_views == 0) {
    Implementation::add(own.tests, report.iteration, report.test->mean.psnr_channel_mean);
  }
  if (report.loss || report.test || own.published.seconds() > kFresh) own.publish();
  if (continues && own.pause.over()) own.serve();
}

void LiveTraining::end() {
  Implementation& own = *own_;
  own.ended = true;
  own.publish();
  const bool watched = own.pictures > 0 && own.last_picture.seconds() < kWatched;
  const Stopwatch watch(own.time);
  for (double left; (left = kLastPictures - watch.seconds()) > 0;)
    if (!own.serve(std::chrono::milliseconds(watched ? static_cast<int>(1000 * left) : 0))) return;
}

bool LiveTraining::has_viewer() const {
  own_->look_for_viewers();
  return own_->requests > 0 && own_->last_request.seconds() < kAway;
}

void LiveTraining::stay(const std::function<bool()>& ends) {
  while (!ends() && has_viewer()) own_->serve(kWait);
}

std::string LiveTraining::summary() const {
  return fmt::format("{} images rendered in {}, {:.1f} % of the training time", own_->pictures,
                     duration_text(own_->spent), 100 * own_->spent / own_->begun.seconds());
}

void serve_model(Server& server, ModelSession& session, const MixedModel& model, const Scene& scene) {
  Painter painter(session.device(), session.stages(), session.settings());
  // An intersection takes 24 bytes and additional memory for sorting, so allow one per 64 bytes of device
  // memory.
  const std::uint64_t most = session.device().info().memory_bytes / 64;
  server.publish(json_text({{"splats", model.count()}, {"memory", session.device().allocated_bytes()}}));
  std::string poster;
  try {
    poster = web::poster_uri(painter.image(session.model().view(), poster_camera(scene), most));
  } catch (const Error& error) {  // the page shows this error when it requests the image
    if (error.kind() != ErrorKind::memory) throw;
  }
  server.start(live_page(scene, false, poster));
  for (;;)
    server.serve(kWait, [&](const PictureRequest& request) -> Picture {
      const Stopwatch watch;
      std::string bytes = painter.draw(session.model().view(), request.camera, request.exact, most);
      return {.bytes = std::move(bytes),
              .headers = {{"Ubs-Seconds", fmt::format("{:.6f}", watch.seconds())}}};
    });
}

}  // namespace ubs::serve
