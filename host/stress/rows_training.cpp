// SPDX-License-Identifier: Apache-2.0
// Rows about training: few or equal views, poisoned models, long runs, the same bits again.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "host/base/error.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/data/ply.hpp"
#include "host/stress/row.hpp"
#include "host/stress/row_scene.hpp"
#include "host/train/trainer.hpp"

namespace ubs::stress {
namespace {

// `views` cameras around the scene (or all the same one), with images of a fixed model.
Split make_views(RowRun& run, int count, bool equal) {
  const Case truth = ordinary_case("truth", 3, 30, 5);
  Split split{"train", {}};
  for (int i = 0; i < count; ++i) {
    Case c = truth;
    const double angle = equal ? 0 : 0.15 * i, s = std::sin(angle), k = std::cos(angle);
    c.camera.rotation = {k, 0, s, 0, 1, 0, -s, 0, k};
    c.camera.translation = {-2.25 * s, 0, 2.25 - 2.25 * k};
    c.camera.time = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
    const DeviceResult drawn = run.runner().run(c, {});
    View view;
    view.name = fmt::format("view{}", i);
    view.camera = c.camera;
    view.image = {c.camera.width, c.camera.height, {}};
    const std::size_t pixels = drawn.alpha.size();
    for (std::size_t p = 0; p < pixels; ++p)
      for (std::size_t channel = 0; channel < 3; ++channel)
        view.image.rgb.push_back(static_cast<std::uint8_t>(
            std::lround(255 * std::clamp(drawn.image[channel * pixels + p], 0.0f, 1.0f))));
    split.views.push_back(std::move(view));
  }
  return split;
}

TrainSettings settings_for(RowRun& run, int dim, int iterations) {
  TrainSettings settings;
  settings.dim = dim;
  settings.iterations = iterations;
  settings.cap_max = 120;
  settings.background = {0.1, 0.2, 0.3};
  settings.raster = run.runner().raster() == RasterKind::cpu ? "cpu" : "gpu";
  settings.log_every = 50;
  return settings;
}

struct Training {
  SplatModel model;
  double first_loss = 0, last_loss = 0;
  int iterations = 0;
};

Training train(RowRun& run, const TrainSettings& settings, const Split& views, const SplatModel& initial) {
  const Split none{"test", {}};
  Trainer trainer(run.runner().device(), settings, views, none, initial);
  Training result;
  trainer.run([&](const StepReport& report) {
    if (report.loss) {
      if (result.first_loss == 0) result.first_loss = *report.loss;
      result.last_loss = *report.loss;
    }
    return true;
  });
  result.model = trainer.model();
  result.iterations = trainer.iteration();
  return result;
}

bool finite(const SplatModel& model) {
  return std::ranges::all_of(model.values, [](float v) { return std::isfinite(v); });
}

void few_views(RowRun& run) {
  for (const int dim : {3, 6, 7})
    for (const auto& [count, equal] : {std::pair{1, false}, {3, false}, {3, true}}) {
      run.count(1);
      const Training t = train(run, settings_for(run, dim, 120), make_views(run, count, equal),
                               ordinary_case("start", dim, 60).model);
      run.require(finite(t.model), fmt::format("N = {}, {} views{}: the model is not finite", dim, count,
                                               equal ? " (equal)" : ""));
      run.require(t.last_loss < t.first_loss,
                  fmt::format("N = {}, {} views: the loss goes from {:.4f} to {:.4f}", dim, count,
                              t.first_loss, t.last_loss));
    }
}

// The model ends finite and is written, or the guard stops training: it names the splat, the stage and,
// unless the value was there from the start, the view.
void poisoned_models(RowRun& run) {
  const TemporaryFolder folder;
  const Split views = make_views(run, 2, false);
  constexpr std::size_t kPoisoned = 3;
  std::size_t stopped = 0;
  for (const int dim : {3, 6})
    for (const float value : {NAN, INFINITY, -INFINITY, 3.4e38f})
      for (int row = 0; row < ParameterLayout(dim).count; row += 3) {
        run.count(1);
        SplatModel start = ordinary_case("start", dim, 20).model;
        start.row(row)[kPoisoned] = value;
        const auto say = [&](const std::string& problem) {
          return fmt::format("N = {}, row {} = {}: {}", dim, row, value, problem);
        };
        try {
          const Training t = train(run, settings_for(run, dim, 40), views, start);
          write_splat_ply(folder.path() / "model.ply", t.model);
          run.require(finite(t.model), say("a model that is not finite was written"));
        } catch (const Error& error) {
          ++stopped;
          const std::string_view text = error.what();
          const auto names = [&](std::string_view part) { return text.find(part) != text.npos; };
          run.require(error.kind() == ErrorKind::numerical && names(fmt::format("splat {}", kPoisoned)) &&
                          (names("stage parameters") || (names("stage ") && names("view '"))),
                      say(fmt::format("the guard does not name splat, view and stage: {}", text)));
        }
      }
  run.note(fmt::format("{} stopped by the guard", stopped));
}

// One splat too many in every place: training ends with a finite model whatever the scale of its start.
void stiff_models(RowRun& run) {
  const Split views = make_views(run, 2, false);
  for (const int dim : {3, 7})
    for (const double scale : {1e-7, 1e3})
      for (const double beta : {-12.0, 12.0}) {
        run.count(1);
        Case c = row_case("stiff", dim, 20);
        for (std::size_t i = 0; i < 20; ++i) {
          SplatPlan plan;
          plan.scale = {scale, 0.3, 0.3}, plan.beta_raw = beta, plan.query_beta_raw = -beta,
          plan.opacity_raw = 12;
          plan.position = {0.1 * static_cast<double>(i % 5) - 0.2, 0.1 * static_cast<double>(i / 5) - 0.2, 2};
          put_splat(c, i, plan);
        }
        const Training t = train(run, settings_for(run, dim, 60), views, c.model);
        run.require(finite(t.model),
                    fmt::format("N = {}, scale {}, beta {}: the model is not finite", dim, scale, beta));
      }
}

void soak(RowRun& run) {
  run.count(1);
  TrainSettings settings = settings_for(run, 6, 3000);
  const Training t = train(run, settings, make_views(run, 3, false), ordinary_case("start", 6, 60).model);
  run.require(finite(t.model), "the model is not finite");
  run.require(t.iterations == 3000 && t.last_loss < t.first_loss,
              fmt::format("{} iterations, loss {:.4f} to {:.4f}", t.iterations, t.first_loss, t.last_loss));
  run.note(fmt::format("3000 iterations, loss {:.4f} to {:.4f}, {} splats", t.first_loss, t.last_loss,
                       t.model.count));
}

void repeated_training(RowRun& run) {
  const Split views = make_views(run, 3, false);
  for (const int dim : {3, 7}) {
    run.count(1);
    const SplatModel start = ordinary_case("start", dim, 50).model;
    const Training a = train(run, settings_for(run, dim, 150), views, start),
                   b = train(run, settings_for(run, dim, 150), views, start);
    run.require(a.model.values.size() == b.model.values.size() &&
                    std::memcmp(a.model.values.data(), b.model.values.data(),
                                a.model.values.size() * sizeof(float)) == 0,
                fmt::format("N = {}: two runs of the same seed differ", dim));
    run.require(a.model.values != start.values, "training changes nothing");
  }
}

}  // namespace

std::vector<Row> training_rows() {
  return {{"28.few_views", "one view, three, three equal ones", few_views},
          {"29.soak", "3000 iterations on a tiny scene, with relocation, growth and noise", soak},
          {"p5.poisoned_training", "training from models with NaN, infinities, FLT_MAX", poisoned_models},
          {"p5.stiff_training", "training from scales 1e-7, 1e3 and betas -12, 12", stiff_models},
          {"p6.same_bits", "two trainings of one seed", repeated_training}};
}

}  // namespace ubs::stress
