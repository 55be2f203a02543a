// SPDX-License-Identifier: Apache-2.0
#include "host/bench/runner.hpp"

#include <algorithm>
#include <memory>
#include <new>

#include "host/base/error.hpp"
#include "host/bench/core_trip.hpp"
#include "host/bench/render_bench.hpp"
#include "host/bench/startup_bench.hpp"
#include "host/device/registry.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::bench {
namespace {

constexpr int kTrainedIterations = 300, kQuickIterations = 20;

std::string lists_text(const WorkCounts& c) {
  return fmt::format("lists a tile: mean {:.0f}, longest {}, {:.0f} % in lists above 4 means", c.mean_list(),
                     c.longest_list,
                     100.0 * static_cast<double>(c.long_pairs) /
                         static_cast<double>(std::max<std::uint64_t>(1, c.intersections)));
}

class Runner {
 public:
  Runner(const std::string& request, const RunOptions& options)
      : request_(request), options_(options), device_(open_device(request)) {
    raster_ = raster_kind(options.raster, device_->info());
    report_.info = device_->info();
    report_.raster = raster_ == RasterKind::cpu ? "cpu" : "gpu";
    report_.ceilings = measure_ceilings(*device_, options.quick);
  }

  DeviceReport run() {
    if (options_.on_begin) options_.on_begin(report_);
    for (const BenchCase& which : options_.cases) {
      if (options_.stop()) break;
      core_trip_ns_ = core_trip_ns();
      try {
        run_case(which);
      } catch (const Error& error) {
        if (options_.stop()) break;  // a start-up process has had the same signal
        if (error.kind() != ErrorKind::memory) throw;
        add_failed(which, error.what());
      } catch (const std::bad_alloc&) {  // of the host
        add_failed(which, "out of memory");
      }
    }
    return std::move(report_);
  }

 private:
  void run_case(const BenchCase& which) {
    if (which.stage.starts_with("startup")) return run_startup(which);
    prepare_scene(which);
    if (which.stage == "render") return run_render(which);
    if (which.stage.starts_with("iteration")) return run_iteration(which);
    CaseResult result = result_of(which);
    const Measured measured = step().measure(which.stage, options_.limits);
    set_times(result, measured);
    result.peak_bytes = step().peak_bytes();
    count(result, which.stage);
    if (which.stage == "raster_forward" || which.stage == "raster_backward")
      result.note = fmt::format("{:.2f} G blended/s, {:.0f} a pixel",
                                1e-6 * static_cast<double>(result.counts.blended) / measured.wall_ms.median,
                                result.counts.blended_per_pixel());
    if (which.stage == "raster_backward")
      result.note += fmt::format(", lanes a blended: {:.1f}", result.counts.block_lanes_per_blended());
    if (which.stage == "lists") result.note = lists_text(result.counts);
    add(result);
  }

  void run_render(const BenchCase& which) {
    CaseResult result = result_of(which);
    const bool mixed = scene_->mixed.mixed();  // has no training step, whose work could be counted
    if (!mixed) count(result, which.stage);
    step_.reset();  // its buffers do not belong to the peak of drawing
    RenderBench bench(*device_, *scene_, raster_, options_.training);
    const Measured measured = bench.measure(options_.limits);
    set_times(result, measured);
    result.peak_bytes = bench.peak_bytes();
    result.note = fmt::format("{:.1f} FPS{}", 1e3 / measured.wall_ms.median,
                              mixed ? "; " + to_string(scene_->mixed) : "");
    add(result);
  }

  void run_iteration(const BenchCase& which) {
    CaseResult result = result_of(which);
    count(result, "iteration");
    step_.reset();  // its buffers do not belong to the trainer's peak
    const IterationMeasurement measured =
        measure_iterations(*device_, *scene_,
                           {.raster = raster_,
                            .guard = which.stage != "iteration_unguarded",
                            .list_counts = which.stage == "iteration_wait"    ? ListCounts::wait
                                           : which.stage == "iteration_bound" ? ListCounts::bound
                                                                              : options_.training.list_counts,
                            .limits = options_.limits,
                            .work = options_.training});
    set_times(result, measured.time);
    result.peak_bytes = measured.peak_bytes;
    result.note = fmt::format("{:.1f} it/s, {:.0f} blended a pixel", 1e3 / result.wall_ms.median,
                              result.counts.blended_per_pixel());
    add(result);
  }

  void run_startup(const BenchCase& which) {
    if (!startup_)  // one for both cases, which have one size
      startup_ = std::make_unique<StartupBench>(StartupOptions{.executable = options_.executable,
                                                               .device = request_,
                                                               .raster = options_.raster,
                                                               .dim = options_.dim,
                                                               .splats = which.splats,
                                                               .width = which.width,
                                                               .height = which.height,
                                                               .settings = assignments(),
                                                               .repetitions = options_.quick ? 1 : 5});
    CaseResult result = result_of(which);
    result.wall_ms = startup_->measure(which.stage == "startup_cold");
    add(result);
  }

  // Of a run that starts with the form and the kernels of the other cases.
  std::vector<std::string> assignments() const {
    std::vector<std::string> all = kernel_assignments(options_.training);
    if (!options_.training.freeze.empty()) all.emplace_back("refine=0:0:1");
    for (const auto& [key, value] : non_default_switches(options_.training.variant))
      all.push_back(key + '=' + value);
    return all;
  }

  // Scenes are in the order of the cases, so that one at a time is enough.
  void prepare_scene(const BenchCase& which) {
    BenchCase key = which;
    key.stage.clear();
    if (scene_ && key == scene_key_) return;
    step_.reset();
    scene_.reset();
    scene_key_ = key;
    const int dim = scene_dim(which.scene, options_.dim);
    const ModelVariant variant = options_.training.variant;
    if (which.scene == "synthetic")
      scene_ = std::make_unique<BenchScene>(synthetic_object(dim, which.splats, which.width, which.height));
    else if (which.scene == "random")
      scene_ =
          std::make_unique<BenchScene>(random_start(dim, which.splats, which.width, which.height, variant));
    else if (which.scene == "garden")
      scene_ = std::make_unique<BenchScene>(garden_scene(options_.garden, dim, variant));
    else if (which.scene == "model")
      scene_ = std::make_unique<BenchScene>(options_.open_model());
    else
      scene_ = std::make_unique<BenchScene>(
          trained_scene(*device_, which.scene,
                        {.dim = dim,
                         .splats = which.splats,
                         .width = which.width,
                         .height = which.height,
                         .iterations = options_.quick ? kQuickIterations : kTrainedIterations,
                         .raster = options_.raster,
                         .variant = variant}));
  }

  StepBench& step() {
    if (!step_) step_ = std::make_unique<StepBench>(*device_, *scene_, raster_, options_.training);
    return *step_;
  }

  CaseResult result_of(const BenchCase& which) const {
    CaseResult result;
    result.name = which.name();
    const bool of_scene = scene_ && !which.stage.starts_with("startup");
    result.dim = of_scene ? scene_->model.dim : options_.dim;
    result.form = to_string(of_scene ? scene_->model.variant : options_.training.variant);
    return result;
  }
  void set_times(CaseResult& result, const Measured& measured) const {
    result.wall_ms = measured.wall_ms;
    result.device_ms = measured.device_ms.value_or(0);
    if (report_.info.type == DeviceType::cpu) result.cpu_ms = measured.cpu_ms / report_.info.compute_units;
  }
  void count(CaseResult& result, const std::string& stage) {
    result.counts = step().counts();
    result.cost = stage_cost(stage, result.counts);
    result.bound = bound_of(result.cost, report_.ceilings, raster_ == RasterKind::cpu);
  }
  double core_trip_ns() const { return report_.info.type == DeviceType::cpu ? core_round_trip_ns() : 0; }
  void add_failed(const BenchCase& which, const std::string& why) {
    step_.reset();
    CaseResult failed = result_of(which);
    failed.note = why;
    add(failed);
  }
  void add(CaseResult result) {
    result.core_trip_ns = std::max(core_trip_ns_, core_trip_ns());
    report_.results.push_back(result);
    if (options_.on_result) options_.on_result(result);
  }

  std::string request_;
  const RunOptions& options_;
  std::unique_ptr<Device> device_;
  RasterKind raster_;
  DeviceReport report_;
  double core_trip_ns_ = 0;  // before the case
  BenchCase scene_key_;
  std::unique_ptr<BenchScene> scene_;
  std::unique_ptr<StepBench> step_;
  std::unique_ptr<StartupBench> startup_;
};

}  // namespace

int scene_dim(const std::string& scene, int dim) {
  return scene == "orbit" && (dim == 3 || dim == 6) ? dim + 1 : dim;
}

DeviceReport run_cases(const std::string& device_request, const RunOptions& options) {
  return Runner(device_request, options).run();
}

}  // namespace ubs::bench
