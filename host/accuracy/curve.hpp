// SPDX-License-Identifier: Apache-2.0
// Quality on the test views against training time and iterations, for several configurations and devices that
// start from the same splats and see the same views in the same order. Trainings take turns between
// evaluations, so that what else the machine does falls on all of them.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/accuracy/configuration.hpp"
#include "host/train/trainer.hpp"

namespace ubs::accuracy {

struct CurvePoint {
  int iteration = 0;
  double seconds = 0;  // of training, without evaluations
  std::uint32_t splats = 0;
  double psnr = 0, psnr_joint = 0, ssim = 0;  // means over the test views
};

struct Curve {
  std::string device, configuration, settings;
  std::string note;  // not empty: why it does not run here or ended early
  std::vector<CurvePoint> points;
  std::string name() const;  // configuration, with the device where `label_device`
  bool label_device = false;
};

struct CurveData {
  Split train, test;
};

struct CurveOptions {
  std::vector<Configuration> configurations;
  TrainSettings base;       // iterations, eval_every and more
  double max_seconds = 0;   // of training, each; 0: to the last iteration
  bool sequential = false;  // one after the other instead of in turn
  // The data and the start of a configuration; the same data may serve several.
  std::function<const CurveData&(const TrainSettings&)> data;
  std::function<SplatModel(const CurveData&, const TrainSettings&)> initial_model;
  std::function<bool()> stop;                                             // asked after every iteration
  std::function<void(const std::vector<Curve>&, const Curve&)> on_point;  // all so far, and the one that grew
};

// One curve a device and configuration, the devices in the order given. What ends one training (settings,
// kernels, memory, numbers that are not finite) becomes its note, and the others go on.
std::vector<Curve> measure_curves(const std::vector<std::shared_ptr<Device>>& devices,
                                  const CurveOptions& options);

std::string curve_csv(std::span<const Curve> curves);
nlohmann::ordered_json curves_json(std::span<const Curve> curves);
// PSNR against seconds and iterations, SSIM against seconds and iterations.
std::string curve_plot(std::span<const Curve> curves);   // SVG
std::string curve_table(std::span<const Curve> curves);  // last points, as Markdown

struct CurveComparison {
  std::string name;
  double old_psnr = 0, psnr = 0;              // at the last iteration that both have
  double old_time_ratio = 0, time_ratio = 0;  // seconds at it over those of the first curve of the same run
  bool regression = false;                    // PSNR fell by more than kWorseDecibel
};
inline constexpr double kWorseDecibel = 0.5;
// The "curves" of a file, as curves_json() gives them. Throws Error(data).
std::vector<Curve> read_curves(const std::filesystem::path& file);
std::vector<CurveComparison> compare_curves(std::span<const Curve> curves, std::span<const Curve> baseline);
std::string comparison_text(std::span<const CurveComparison> comparisons);

}  // namespace ubs::accuracy
