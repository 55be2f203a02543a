// SPDX-License-Identifier: Apache-2.0
// See distill.hpp.
#include "host/model/distill.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "host/base/philox.hpp"
#include "host/base/stopwatch.hpp"
#include "host/dataset/image.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/model/model_session.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/train/measure_steps.hpp"
#include "host/train/trainer.hpp"

namespace ubs {
namespace {

// Number of images for measuring the quality, and minimum number of images for training.
constexpr std::size_t kTestRenders = 4, kLeastRenders = 12;
constexpr double kShareOfRenders = 0.25;             // share of the time for rendering the training images
constexpr double kGoldenShare = 0.618;               // golden ratio - 1
constexpr std::uint32_t kColourStream = 0x64697374;  // number of the random stream of background colours

// Returns the same splats with spherical harmonics of this degree. Missing coefficients are zero, and those
// of higher degrees are dropped.
ImportedSplats with_degree(const ImportedSplats& splats, int degree) {
  ImportedSplats out = splats;
  out.sh_degree = degree;
  out.resize(splats.count());
  std::ranges::fill(out.sh, 0.0f);
  const std::size_t from = 3 * splats.coefficients(), to = 3 * out.coefficients();
  for (std::size_t i = 0; i < splats.count(); ++i)
    std::copy_n(&splats.sh[i * from], std::min(from, to), &out.sh[i * to]);
  return out;
}

// Returns the length that is 1 during training: the median depth of the splats, or 1 if it is unknown.
double unit_of(const Split& views, const SplatModel& model) {
  PointCloud centres;
  for (std::size_t i = 0; i < model.count; ++i)
    centres.positions.push_back({model.row(0)[i], model.row(1)[i], model.row(2)[i]});
  return median_depth(cameras_of(views), centres).value_or(1);
}

// Returns the numbers 0 to n - 1 in an order in which the first k numbers are spread over the whole range,
// for every k.
std::vector<std::size_t> scattered_order(std::size_t n) {
  std::size_t step =
      std::max<std::size_t>(1, static_cast<std::size_t>(kGoldenShare * static_cast<double>(n)));
  while (std::gcd(step, n) > 1) ++step;
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < n; ++i) order.push_back(i * step % n);
  return order;
}

Image8 rendered(ModelSession& session, std::uint32_t camera, const RenderSettings& settings) {
  session.renderer().forward(session.model().view(), camera, settings, false);
  const RenderedView drawn = session.renderer().download();
  return image_from_interleaved(drawn.rgb, drawn.width, drawn.height);
}

// Returns the settings for training the Gaussians in this unit of length. With these settings the number of
// splats stays constant.
TrainSettings distilling_settings(const TrainSettings& drawing, const SplatModel& initial, double unit) {
  TrainSettings s;
  s.dim = 3;
  s.unit = unit;
  s.variant = initial.variant;
  s.eps2d = kGaussianBlur;
  s.background = drawing.background;
  s.background.learnt = Background::Learnt::no;
  s.random_background = RandomBackground::off;  // each view has a background of its own
  s.near_plane = planes_of(drawing).near;
  s.far_plane = planes_of(drawing).far;
  s.cap_max = static_cast<int>(initial.count);
  s.refine = {0, 0, 1};  // never
  s.save_renders = 0;
  return s;
}

}  // namespace

Distiller::Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing,
                     Split views, int degree)
    : device_(std::move(device)),
      model_(model),
      drawing_(std::move(drawing)),
      views_{views.name, {}},
      degree_(degree) {
  // All views are rendered for the same time. So if several views differ only in their time, only the first
  // of them is used.
  std::vector<View> different;
  for (View& view : views.views) {
    view.camera.time = 0;
    if (std::ranges::find(different, view.camera, &View::camera) == different.end())
      different.push_back({.name = view.name, .camera = view.camera, .image = {}, .source = nullptr});
  }
  for (const std::size_t i : scattered_order(different.size()))
    views_.views.push_back(std::move(different[i]));
}

Split Distiller::test_renders(double time) {
  Split split{views_.name,
              {views_.views.begin(), views_.views.begin() + std::min(kTestRenders, views_.views.size())}};
  ModelSession session(device_, model_, drawing_, false);
  for (View& view : split.views) view.camera.time = time;
  session.renderer().set_cameras(cameras_of(split));
  for (std::uint32_t v = 0; v < split.views.size(); ++v)
    split.views[v].image = rendered(session, v, session.settings());
  return split;
}

Split Distiller::renders(double time, double seconds) {
  const Stopwatch watch;
  Split split{views_.name, {}};
  ModelSession session(device_, model_, drawing_, false);
  std::vector<Camera> cameras = cameras_of(views_);
  for (Camera& camera : cameras) camera.time = time;
  session.renderer().set_cameras(cameras);
  const CounterRandom random(drawing_.seed, kColourStream);
  for (std::uint32_t v = 0; v < cameras.size(); ++v) {
    if (v >= kLeastRenders && watch.seconds() > seconds) break;
    RenderSettings settings = session.settings();
    settings.sky.reset();
    for (std::uint32_t c = 0; c < 3; ++c)  // a colour that 8 bits represent exactly
      settings.background[c] = static_cast<float>(std::round(255 * random.uniform(v, c)) / 255);
    View view = views_.views[v];
    view.camera = cameras[v];
    view.image = rendered(session, v, settings);
    view.background = settings.background;
    split.views.push_back(std::move(view));
  }
  return split;
}

Distilled Distiller::at(double time, const ImportedSplats& closed_form, double seconds,
                        const std::function<bool(const DistillPlan&)>& start) {
  const Stopwatch watch;
  Split test = test_renders(time), train = renders(time, kShareOfRenders * seconds);
  SplatModel initial = exact_model(with_degree(closed_form, degree_));
  const double unit = unit_of(train, initial);
  const TrainSettings asked = distilling_settings(drawing_, initial, unit);
  Facts facts;
  facts.points = initial.count;
  const Plan least_plan = settle(with_iterations(asked, facts, kMinIterations), facts).plan;
  for (Split* split : {&test, &train}) scale_lengths(*split, 1 / unit);
  scale_lengths(initial, 1 / unit);
  if (costs_.empty()) costs_ = measure_steps(*device_, least_plan, train, initial, initial.count);
  const double left = seconds - watch.seconds();
  const double least = expected_seconds(kMinIterations, costs_, asked, facts, train);
  const bool enough = least <= left;
  const BudgetedRun run = enough ? choose_iterations({.seconds = left, .costs = costs_}, asked, facts, train)
                                 : BudgetedRun{{least_plan, {}, {}}, {}};
  const Plan& plan = run.settled.plan;
  Distilled out{.splats = closed_form};
  if (start({.renders = train.views.size(),
             .iterations = plan.settings().iterations,
             .seconds = enough ? left : least})) {
    Trainer trainer(*device_, plan, train, test, initial);
    if (enough) trainer.keep_to(run.budget);
    out.before = trainer.evaluate_test().mean.psnr_channel_mean;
    trainer.run([&](const StepReport& report) {
      if (report.test) out.after = report.test->mean.psnr_channel_mean;
      return true;
    });
    SplatModel model = trainer.model();
    scale_lengths(model, unit);
    if (out.after > out.before) out.splats = to_imported_splats(model);
    out.splats.offset = closed_form.offset;
    out.iterations = trainer.iteration();
  }
  out.seconds = watch.seconds();
  return out;
}

}  // namespace ubs
