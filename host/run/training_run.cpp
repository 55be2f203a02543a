// SPDX-License-Identifier: Apache-2.0
#include "host/run/training_run.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/cluster/share.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/run/facts_of.hpp"
#include "host/run/open_data.hpp"
#include "host/run/verified_device.hpp"
#include "host/scene/camera_rig.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/initialise.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/fields.hpp"
#include "host/train/kernel_warm_up.hpp"
#include "host/train/measure_steps.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/shared_splats.hpp"

namespace ubs {
namespace {

// Steps are measured with the number of splats of a run with this many iterations.
constexpr int kFewIterations = 600;

// Returns at most `most` of the points, chosen at even intervals from the list, so that dense regions stay
// dense.
PointCloud thinned(PointCloud points, std::size_t most) {
  const std::size_t all = points.positions.size();
  if (all <= most) return points;
  for (std::size_t i = 0; i < most; ++i) {
    points.positions[i] = points.positions[i * all / most];
    points.colours[i] = points.colours[i * all / most];
  }
  points.positions.resize(most);
  points.colours.resize(most);
  return points;
}

// Removes points closer than `room` to any camera, because they would cover its image: a point behind the
// scene for one camera can be just in front of a camera on the other side. Keeps all points if this would
// remove three quarters of them or more.
void remove_points_near_cameras(PointCloud& cloud, std::span<const View> views, double room) {
  PointCloud kept;
  for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
    const auto& p = cloud.positions[i];
    const bool close = std::ranges::any_of(views, [&](const View& view) {
      const auto c = view.camera.centre();
      return std::hypot(p[0] - c[0], p[1] - c[1], p[2] - c[2]) < room;
    });
    if (close) continue;
    kept.positions.push_back(p);
    kept.colours.push_back(cloud.colours[i]);
  }
  if (4 * kept.positions.size() > cloud.positions.size()) cloud = std::move(kept);
}

// Returns the training views, which refer to the images in `data`.
Split training_views(const Dataset& data, const TrainSettings& asked) {
  const Split* found = data.find("train");
  if (asked.test_every == 1 && (!found || found->views.empty()))
    fail(ErrorKind::usage,
         "{}: --test-every 1 makes every image a test image, so none is left for training: choose 2 or more, "
         "or 0 for no test images",
         data.report.folder);
  return in_unit(need_split(data, "train"), 1);
}

Dataset without_views(const Dataset& data) {
  Dataset rest;
  rest.points = data.points;
  rest.depth_bounds = data.depth_bounds;
  rest.offset = data.offset;
  rest.report = data.report;
  return rest;
}

}  // namespace

TrainingRun::TrainingRun(std::shared_ptr<const Dataset> data, TrainSettings asked, bool begins)
    : data_(std::move(data)),
      asked_(std::move(asked)),
      rest_(without_views(*data_)),
      train_(training_views(*data_, asked_)),
      test_{"test", {}},
      data_print_(fingerprint(train_)) {
  if (asked_.refine_cameras != RefineCameras::none) align(rest_, train_);
  facts_ = facts_of(rest_, train_, asked_, begins);
  Settled settled = settle(asked_, facts_);
  plan_ = std::move(settled.plan);
  if (!begins) settled.notes.clear();  // the settings were decided when the run began
  for (std::string& note : settled.notes) rest_.report.notes.push_back(std::move(note));
  if (begins && facts_.points == 0)
    rest_.report.notes.push_back(fmt::format(
        "the data have no points: splats start at random positions {} (--init-points, --init-extent)",
        facts_.start));
  for (const std::string& warning : settled.warnings) warn("{}", warning);
  chosen_ = changed_keys(asked_, plan_->recorded());
  if (asked_.budget != "auto") std::erase(chosen_, "budget");
  const int dim = plan_->settings().dim;
  check_query(train_, dim);
  if (const Split* test = data_->find("test")) {
    test_ = in_unit(*test, 1);
    check_query(test_, dim);
    test_without_image_ = std::erase_if(test_.views, [](const View& view) { return !view.has_image(); });
  }
  cameras_ = cameras_of(train_);
  const double scale = 1 / plan_->unit();
  if (scale == 1) return;
  if (rest_.points) scale_lengths(*rest_.points, scale);
  for (auto& [near, far] : rest_.depth_bounds) near *= scale, far *= scale;
  for (Split* split : {&train_, &test_}) scale_lengths(*split, scale);
}

void TrainingRun::warn_about_test() const {
  const Split* test = data_->find("test");
  if (!test)
    warn("{} has no test split: nothing is measured, and no renders are written", data_->report.folder);
  else if (test_without_image_ > 0)
    warn("{} of {} test views have no image and are not used", test_without_image_, test->views.size());
}

check::Use TrainingRun::use() const { return training_use(plan_->settings()); }

// With several ranks, compiles the kernels for this rank's share of the splats.
void TrainingRun::warm_up(Device& device, const Plan& plan, const SplatModel& initial, Communicator& ranks,
                          ImageMetrics* networks) const {
  const auto all = static_cast<std::uint32_t>(initial.count);
  const std::uint32_t own = largest_share(all, ranks.size());
  if (own == all) return build_kernels(device, plan, train_, test_, initial, networks);
  TrainSettings s = plan.recorded();
  s.cap_max = static_cast<int>(largest_share(static_cast<std::uint32_t>(s.cap_max), ranks.size()));
  build_kernels(device, Plan(s), train_, test_, part_of(initial, {0, own}), networks);
}

void TrainingRun::fit_to_budget(Device& device,
                                const std::function<void(const Plan&, const SplatModel&)>& warm,
                                const std::function<double()>& spent) {
  const bool asked = asked_.budget != "auto";
  budget_ = {.seconds = budget_seconds(asked_),
             .most_iterations = asked ? kScheduleLength : kDefaultIterations};
  plan_ = settle(with_iterations(asked_, facts_, kFewIterations), facts_).plan;
  const SplatModel first = initial();
  warm(*plan_, first);
  budget_.costs = measure_steps(device, *plan_, train_, first, 2 * first.count);
  budget_.spent = spent();
  BudgetedRun run = choose_iterations(std::move(budget_), asked_, facts_, train_);
  plan_ = std::move(run.settled.plan);
  budget_ = std::move(run.budget);
}

TimeBudget TrainingRun::budget_from(double spent) const {
  TimeBudget budget = budget_;
  if (budget.seconds > 0) budget.spent = spent;
  return budget;
}

SplatModel TrainingRun::initial() const {
  const TrainSettings& s = plan_->settings();
  InitOptions init = init_options(s);
  const std::size_t points = first_splats(s, facts_);
  const auto from = [&](const PointCloud& cloud) {
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  };
  if (rest_.points) return from(thinned(*rest_.points, static_cast<std::size_t>(s.cap_max)));
  if (rest_.depth_bounds.size() == train_.views.size())
    return from(sample_frusta(train_.views, rest_.depth_bounds, points, s.seed));
  if (s.init_extent != kAuto) return initialise_random(s.dim, points, s.seed, init);
  const InitialSpace space = initial_space(cameras_of(train_), facts_.plain_background);
  if (space.half > 0) {
    init.centre = space.centre;
    init.box = space.half;
    return initialise_random(s.dim, points, s.seed, init);
  }
  // Maximum number of views that random points are placed in, because the images of these views must be
  // decoded.
  constexpr std::size_t kViews = 256;
  const std::size_t step = train_.views.size() / kViews + 1;
  std::vector<View> some;  // copies of every `step`-th view; empty if all views are used
  for (std::size_t v = 0; step > 1 && v < train_.views.size(); v += step) some.push_back(train_.views[v]);
  const std::span<const View> views = step > 1 ? some : train_.views;
  const std::vector<std::array<double, 2>> bounds(views.size(), {space.near, space.far});
  PointCloud cloud = sample_frusta(views, bounds, 2 * points, s.seed, PointColours::pixels);
  remove_points_near_cameras(cloud, views, space.near);
  return from(thinned(std::move(cloud), points));
}

Trainer& TrainingRun::start(Device& device, const SplatModel& initial, Communicator& ranks) {
  return trainer_.emplace(device, *plan_, train_, test_, initial, ranks);
}

SplatModel TrainingRun::model() const {
  SplatModel model = trainer_->model();
  scale_lengths(model, plan_->unit());
  return model;
}

TrainSettings TrainingRun::settings_with_learnt_background() const {
  TrainSettings drawn = plan().recorded();
  drawn.background = trainer_->scene().settings_with_learnt_background().background;
  return drawn;
}

ModelNotes TrainingRun::notes() const { return notes_for(settings_with_learnt_background(), cameras_); }

std::vector<std::string> TrainingRun::comments() const {
  return model_comments(rest_.offset, settings_with_learnt_background(), cameras_);
}

ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras) {
  TrainSettings copy = settings;
  copy.near_plane = planes_of(settings).near;
  copy.far_plane = planes_of(settings).far;
  std::vector<std::pair<std::string, std::string>> drawing;
  for (const FieldValue& field : bind_fields(copy, train_fields()))
    if (field.uses & kOfDrawing) drawing.emplace_back(field.key, field_text(field));
  return make_notes(std::move(drawing), cameras);
}

std::vector<std::string> model_comments(const std::array<double, 3>& offset, const TrainSettings& settings,
                                        std::span<const Camera> cameras) {
  std::vector<std::string> comments;
  if (offset != std::array<double, 3>{}) comments.push_back(make_offset_comment(offset));
  std::ranges::copy(comments_of(notes_for(settings, cameras)), std::back_inserter(comments));
  return comments;
}

}  // namespace ubs
