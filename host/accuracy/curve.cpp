// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/curve.hpp"

#include <algorithm>

#include "host/accuracy/csv.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/report/svg_chart.hpp"
#include "host/train/kernel_warm_up.hpp"

namespace ubs::accuracy {
namespace {

struct Training {
  Curve curve;
  std::unique_ptr<Trainer> trainer;  // null when it does not run or has ended
  TrainSettings settings;
};

std::string settings_text(const Configuration& configuration) {
  return configuration.settings.empty() ? "default"
                                        : fmt::format("{}", fmt::join(configuration.settings, " "));
}

// Rethrows what the other trainings would meet too.
void end_with(Training& training, const Error& error) {
  constexpr ErrorKind kOwn[] = {ErrorKind::usage, ErrorKind::build, ErrorKind::memory, ErrorKind::numerical};
  if (std::ranges::find(kOwn, error.kind()) == std::end(kOwn)) throw;
  training.trainer.reset();
  training.curve.note = error.what();
  std::ranges::replace(training.curve.note, '\n', ' ');
}

Training start(Device& device, const Configuration& configuration, const CurveOptions& options,
               bool label_device) {
  Training training;
  training.settings = apply(options.base, configuration);
  training.curve = {.device = device.info().name,
                    .configuration = configuration.label,
                    .settings = settings_text(configuration),
                    .note = "",
                    .points = {},
                    .label_device = label_device};
  try {
    validate(training.settings);
    const CurveData& data = options.data(training.settings);
    const SplatModel initial = options.initial_model(data, training.settings);
    build_kernels(device, training.settings, data.train, data.test, initial);
    training.trainer = std::make_unique<Trainer>(device, training.settings, data.train, data.test, initial);
  } catch (const Error& error) {
    end_with(training, error);
  }
  return training;
}

CurvePoint point_of(const StepReport& report) {
  const ViewMetrics& mean = report.test->mean;
  return {report.iteration, report.seconds, report.splats, mean.psnr_channel_mean, mean.psnr, mean.ssim};
}

// Up to the next evaluation. Whether the training goes on after it.
bool advance(Training& training, const CurveOptions& options, bool& stopped) {
  bool evaluated = false;
  double seconds = 0;
  training.trainer->run([&](const StepReport& report) {
    seconds = report.seconds;
    if (report.test) {
      training.curve.points.push_back(point_of(report));
      evaluated = true;
    }
    stopped = stopped || (options.stop && options.stop());
    return !evaluated && !stopped;
  });
  const bool time_is_up = options.max_seconds > 0 && seconds >= options.max_seconds;
  return !stopped && !time_is_up && training.trainer->iteration() < training.settings.iterations;
}

ChartSeries series_of(const Curve& curve, bool by_time, bool psnr) {
  ChartSeries series{.name = curve.name(), .markers = true};
  for (const CurvePoint& p : curve.points) {
    series.x.push_back(by_time ? p.seconds : p.iteration);
    series.y.push_back(psnr ? p.psnr : p.ssim);
  }
  return series;
}

template <typename Curves>
auto find_curve(Curves& curves, const std::string& device, const std::string& configuration) {
  return std::ranges::find_if(
      curves, [&](const Curve& c) { return c.device == device && c.configuration == configuration; });
}

const CurvePoint* at_iteration(const Curve& curve, int iteration) {
  for (const CurvePoint& p : curve.points)
    if (p.iteration == iteration) return &p;
  return nullptr;
}

// Seconds at the iteration over those of the run's first curve there; NaN where that has none.
double time_ratio(std::span<const Curve> run, const Curve& curve, int iteration) {
  const CurvePoint *own = at_iteration(curve, iteration), *first = at_iteration(run.front(), iteration);
  return own && first && first->seconds > 0 ? own->seconds / first->seconds : std::nan("");
}

}  // namespace

std::string Curve::name() const {
  return label_device ? configuration + ", " + device.substr(0, 24) : configuration;
}

std::vector<Curve> measure_curves(const std::vector<std::shared_ptr<Device>>& devices,
                                  const CurveOptions& options) {
  std::vector<Training> trainings;
  std::vector<Curve> curves;
  for (const auto& device : devices)
    for (const Configuration& configuration : options.configurations) {
      trainings.push_back(start(*device, configuration, options, devices.size() > 1));
      curves.push_back(trainings.back().curve);
    }
  bool stopped = false, active = true;
  while (active && !stopped) {
    active = false;
    for (std::size_t i = 0; i < trainings.size() && !stopped; ++i) {
      Training& training = trainings[i];
      bool goes_on = training.trainer != nullptr;
      while (goes_on) {
        try {
          goes_on = advance(training, options, stopped);
        } catch (const Error& error) {
          end_with(training, error);
          goes_on = false;
        }
        curves[i] = training.curve;
        if (options.on_point) options.on_point(curves, curves[i]);
        if (!goes_on) training.trainer.reset();
        if (!options.sequential) break;
      }
      active = active || training.trainer != nullptr;
    }
  }
  return curves;
}

std::string curve_csv(std::span<const Curve> curves) {
  std::string text = "device,configuration,settings,iteration,seconds,splats,psnr,psnr_joint,ssim\n";
  for (const Curve& c : curves)
    for (const CurvePoint& p : c.points)
      text += fmt::format("{},{},{},{},{:.3f},{},{:.4f},{:.4f},{:.5f}\n", csv_field(c.device),
                          csv_field(c.configuration), csv_field(c.settings), p.iteration, p.seconds, p.splats,
                          p.psnr, p.psnr_joint, p.ssim);
  return text;
}

std::string curve_plot(std::span<const Curve> curves) {
  constexpr int kWidth = 520, kHeight = 380;
  std::vector<Html> plots;
  for (const bool psnr : {true, false})
    for (const bool by_time : {true, false}) {
      std::vector<ChartSeries> series;
      for (const Curve& c : curves) {
        series.push_back(series_of(c, by_time, psnr));
        series.back().colour = series.size() - 1;
      }
      plots.push_back(svg_chart({.title = psnr ? "Test PSNR" : "Test SSIM",
                                 .x_label = by_time ? "seconds of training" : "iterations",
                                 .y_label = psnr ? "PSNR [dB]" : "SSIM",
                                 .legend = true,
                                 .width = kWidth,
                                 .height = kHeight},
                                series));
    }
  return svg_sheet(plots, 2, kWidth, kHeight);
}

std::string curve_table(std::span<const Curve> curves) {
  std::string text =
      "| configuration | settings | iterations | seconds | splats | PSNR | SSIM "
      "|\n|---|---|---|---|---|---|---|\n";
  for (const Curve& c : curves) {
    if (c.points.empty()) {
      text += fmt::format("| {} | {} | {} | | | | |\n", c.name(), c.settings,
                          c.note.empty() ? "no evaluation" : c.note);
      continue;
    }
    const CurvePoint& p = c.points.back();
    const std::string why = c.note.empty() ? "" : "; ended early: " + c.note;
    text += fmt::format("| {} | {}{} | {} | {:.1f} | {} | {:.3f} | {:.4f} |\n", c.name(), c.settings, why,
                        p.iteration, p.seconds, p.splats, p.psnr, p.ssim);
  }
  return text;
}

Json curves_json(std::span<const Curve> curves) {
  Json all = Json::array();
  for (const Curve& c : curves) {
    Json points = Json::array();
    for (const CurvePoint& p : c.points)
      points.push_back({{"iteration", p.iteration},
                        {"seconds", p.seconds},
                        {"splats", p.splats},
                        {"psnr", p.psnr},
                        {"psnr_joint", p.psnr_joint},
                        {"ssim", p.ssim}});
    all.push_back({{"device", c.device},
                   {"configuration", c.configuration},
                   {"settings", c.settings},
                   {"note", c.note},
                   {"points", std::move(points)}});
  }
  return all;
}

std::vector<Curve> read_curves(const std::filesystem::path& file) {
  const Json json = parse_own_json(read_text_file(file), file.string());
  std::vector<Curve> curves;
  try {
    for (const Json& c : json.at("curves")) {
      Curve& curve = curves.emplace_back();
      c.at("device").get_to(curve.device);
      c.at("configuration").get_to(curve.configuration);
      for (const Json& p : c.at("points")) {
        CurvePoint& point = curve.points.emplace_back();
        p.at("iteration").get_to(point.iteration);
        p.at("seconds").get_to(point.seconds);
        p.at("psnr").get_to(point.psnr);
      }
    }
  } catch (const Json::exception&) {
    fail(ErrorKind::data, "{}: is no curve.json that 'ubs accuracy curve' wrote", file.string());
  }
  return curves;
}

std::vector<CurveComparison> compare_curves(std::span<const Curve> curves, std::span<const Curve> baseline) {
  std::vector<CurveComparison> all;
  for (const Curve& c : curves) {
    const auto before = find_curve(baseline, c.device, c.configuration);
    if (before == baseline.end()) continue;
    for (auto p = c.points.rbegin(); p != c.points.rend(); ++p)
      if (const CurvePoint* q = at_iteration(*before, p->iteration)) {
        all.push_back({c.name(), q->psnr, p->psnr, time_ratio(baseline, *before, p->iteration),
                       time_ratio(curves, c, p->iteration), !(p->psnr >= q->psnr - kWorseDecibel)});
        break;
      }
  }
  return all;
}

std::string comparison_text(std::span<const CurveComparison> comparisons) {
  if (comparisons.empty()) return "the baseline has no evaluation of these devices and configurations\n";
  std::string text = fmt::format("{:<32} {:>9} {:>9} {:>9}  {:>6} {:>6}\n", "against the baseline", "old dB",
                                 "new dB", "change", "time", "now");
  for (const CurveComparison& c : comparisons)
    text +=
        fmt::format("{:<32} {:>9.3f} {:>9.3f} {:>+9.3f}  {:>6.3f} {:>6.3f}{}\n", c.name, c.old_psnr, c.psnr,
                    c.psnr - c.old_psnr, c.old_time_ratio, c.time_ratio, c.regression ? "  WORSE" : "");
  return text;
}

}  // namespace ubs::accuracy
