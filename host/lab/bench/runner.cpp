// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/runner.hpp"

#include <algorithm>
#include <memory>
#include <new>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"
#include "host/lab/bench/render_bench.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::bench {
namespace {

constexpr int kTrainedIterations = 300, kQuickIterations = 20;

class Runner {
 public:
  Runner(Device& device, const RunOptions& options)
      : options_(options), device_(device), raster_(raster_kind(options.raster, device.info())) {
    report_.info = device.info();
    report_.raster = raster_ == RasterKind::cpu ? "cpu" : "gpu";
  }

  DeviceReport run() {
    if (options_.on_begin) options_.on_begin(report_);
    for (const BenchCase& which : options_.cases) {
      if (options_.stop()) break;
      try {
        run_case(which);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::memory) throw;
        add_failed(which, error.what());
      } catch (const std::bad_alloc&) {  // the host has run out of memory
        add_failed(which, "out of memory");
      }
    }
    return std::move(report_);
  }

 private:
  void run_case(const BenchCase& which) {
    prepare_scene(which);
    if (which.stage == "render") return run_render(which);
    if (which.stage.starts_with("iteration")) return run_iteration(which);
    CaseResult result = result_of(which);
    const Measured measured = step().measure(which.stage, options_.limits);
    set_times(result, measured);
    result.peak_bytes = step().peak_bytes();
    add(result);
  }

  void run_render(const BenchCase& which) {
    CaseResult result = result_of(which);
    step_.reset();  // release its buffers, so that they do not count in the peak memory of rendering
    RenderBench bench(device_, *scene_, raster_, options_.training);
    const Measured measured = bench.measure(options_.limits);
    set_times(result, measured);
    result.peak_bytes = bench.peak_bytes();
    result.note = fmt::format("{:.1f} FPS{}", 1e3 / measured.wall_ms.median,
                              scene_->mixed.mixed() ? "; " + to_string(scene_->mixed) : "");
    add(result);
  }

  void run_iteration(const BenchCase& which) {
    CaseResult result = result_of(which);
    step_.reset();  // release its buffers, so that they do not count in the peak memory of the trainer
    const IterationMeasurement measured =
        measure_iterations(device_, *scene_,
                           {.raster = raster_,
                            .guard = which.stage != "iteration_unguarded",
                            .list_counts = which.stage == "iteration_wait"    ? ListCounts::wait
                                           : which.stage == "iteration_bound" ? ListCounts::bound
                                                                              : options_.training.list_counts,
                            .limits = options_.limits,
                            .work = options_.training});
    set_times(result, measured.time);
    result.peak_bytes = measured.peak_bytes;
    result.note = fmt::format("{:.1f} it/s", 1e3 / result.wall_ms.median);
    add(result);
  }

  // Cases are ordered by scene, so only one scene is kept at a time.
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
          trained_scene(device_, which.scene,
                        {.dim = dim,
                         .splats = which.splats,
                         .width = which.width,
                         .height = which.height,
                         .iterations = options_.quick ? kQuickIterations : kTrainedIterations,
                         .raster = options_.raster,
                         .variant = variant}));
  }

  StepBench& step() {
    if (!step_) step_ = std::make_unique<StepBench>(device_, *scene_, raster_, options_.training);
    return *step_;
  }

  CaseResult result_of(const BenchCase& which) const {
    CaseResult result;
    result.name = which.name();
    result.dim = scene_ ? scene_->model.dim : options_.dim;
    result.form = to_string(scene_ ? scene_->model.variant : options_.training.variant);
    return result;
  }
  void set_times(CaseResult& result, const Measured& measured) const {
    result.wall_ms = measured.wall_ms;
    result.device_ms = measured.device_ms.value_or(0);
    if (report_.info.type == DeviceType::cpu) result.cpu_ms = measured.cpu_ms / report_.info.compute_units;
  }
  void add_failed(const BenchCase& which, const std::string& why) {
    step_.reset();
    CaseResult failed = result_of(which);
    failed.note = why;
    add(failed);
  }
  void add(const CaseResult& result) {
    report_.results.push_back(result);
    if (options_.on_result) options_.on_result(result);
  }

  const RunOptions& options_;
  Device& device_;
  RasterKind raster_;
  DeviceReport report_;
  BenchCase scene_key_;
  std::unique_ptr<BenchScene> scene_;
  std::unique_ptr<StepBench> step_;
};

}  // namespace

int scene_dim(const std::string& scene, int dim) {
  return scene == "orbit" && (dim == 3 || dim == 6) ? dim + 1 : dim;
}

DeviceReport run_cases(Device& device, const RunOptions& options) { return Runner(device, options).run(); }

}  // namespace ubs::bench
