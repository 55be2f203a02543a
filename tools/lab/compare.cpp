// SPDX-License-Identifier: Apache-2.0
// ubs-lab compare: renders the same model and view on several devices, to compare results and speed. With
// --train-iterations it also trains for a short time on each device.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/statistics.hpp"
#include "host/base/stopwatch.hpp"
#include "host/device/registry.hpp"
#include "host/formats/ply.hpp"
#include "host/lab/accuracy/truth.hpp"
#include "host/run/open_data.hpp"
#include "host/run/training_run.hpp"
#include "host/scene/initialise.hpp"
#include "host/settings/fields.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/target_loss.hpp"
#include "host/train/trainer.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output_files.hpp"
#include "tools/lab/compare_report.hpp"
#include "tools/lab/lab_commands.hpp"

namespace ubs::tools {
namespace {

struct CompareOptions {
  explicit CompareOptions(CLI::App& app) : settings(app) {}
  SettingsOptions settings;
  RunData run;
  std::vector<std::string> devices;
  std::string model, data, split = "test", out;
  int view = 0, repeat = 20, train_iterations = 0;
  bool json = false, overwrite = false;
};

struct Inputs {
  TrainSettings settings;
  SplatModel model;
  Split split;
  std::vector<float> target;  // planar
};

// Result holds the image and the gradient that one device computes.
struct Result {
  std::vector<float> image;
  SplatModel gradient;
};

double milliseconds(const std::function<void()>& action) {
  const Stopwatch watch;
  action();
  return watch.milliseconds();
}

// ViewRun runs the forward pass, the loss and the backward pass of one view, as a training iteration does.
// The result is the gradient of the parameters.
class ViewRun {
 public:
  ViewRun(ModelSession& session, const Inputs& in, std::uint32_t view)
      : session_(session),
        in_(in),
        view_(view),
        target_(session.device(), "target", in.target.size()),
        sums_(session.device(), "loss sums", 8),
        v_params_(session.device(), session.model(), "parameter gradients") {
    target_.upload(in.target);
  }
  void forward(bool for_backward) {
    session_.renderer().forward(session_.model().view(), view_, session_.settings(), for_backward);
  }
  void backward() {
    session_.stages().image_loss({.shape = session_.renderer().shape(),
                                  .image = session_.renderer().image(),
                                  .target = {},
                                  .target_float = target_.view(),
                                  .weights = loss_weights(in_.settings),
                                  .v_image = session_.renderer().v_image(),
                                  .sums = sums_.view()});
    session_.renderer().backward(v_params_.view(), false);
  }
  double loss() const { return loss_value(loss_weights(in_.settings), sums_.download()); }
  SplatModel gradient() const {
    const DeviceModel& m = session_.model().groups().front();
    return download_rows(v_params_[0], m.layout(), m.count(), m.stride());
  }

 private:
  ModelSession& session_;
  const Inputs& in_;
  std::uint32_t view_;
  Buffer<float> target_, sums_;
  GroupBuffers v_params_;
};

void measure(ModelSession& session, ViewRun& run, int repeat, Comparison& row) {
  std::vector<double> forward, both;
  for (int i = 0; i < repeat; ++i) {
    forward.push_back(milliseconds([&] { run.forward(false), session.device().finish(); }));
    both.push_back(milliseconds([&] { run.forward(true), run.backward(), session.device().finish(); }));
  }
  row.forward_ms = ubs::summarise(forward).median;
  row.iteration_ms = ubs::summarise(both).median;
  session.device().set_profiling(true);
  for (int i = 0; i < repeat; ++i) run.forward(true), run.backward();
  for (const TimerEntry& entry : session.device().timings())
    row.stages.push_back({entry.name, static_cast<double>(entry.calls) / repeat, entry.device_ms / repeat});
  session.device().set_profiling(false);
  std::ranges::sort(row.stages, std::greater<>(), &ComparedStage::ms);
}

void compare_with(const Result& reference, const Result& result, Comparison& row) {
  double square = 0;
  for (std::size_t i = 0; i < result.image.size(); ++i) {
    const double difference = std::abs(static_cast<double>(result.image[i]) - reference.image[i]);
    if (!(difference <= row.image_max)) row.image_max = difference;
    square += difference * difference;
  }
  row.image_psnr = -10 * std::log10(square / static_cast<double>(result.image.size()));
  for (const ParameterGroup& group : parameter_groups(result.gradient.layout())) {
    if (group.count == 0) continue;
    double difference = 0, norm = 0;
    for (int r = group.first; r < group.first + group.count; ++r)
      for (std::size_t i = 0; i < result.gradient.count; ++i) {
        const double a = result.gradient.row(r)[i], b = reference.gradient.row(r)[i];
        difference += (a - b) * (a - b);
        norm += b * b;
      }
    row.gradient.emplace_back(group.name, difference == 0 ? 0 : std::sqrt(difference / norm));
  }
}

TrainingResult train_on(Device& device, const CompareOptions& options, TrainSettings settings) {
  settings.iterations = options.train_iterations;
  auto data = std::make_shared<Dataset>(
      open_dataset(options.run.opened, options.data, {"train", "test"}, settings, Images::load));
  TrainingRun run(std::move(data), settings);
  Trainer& trainer = run.start(device, run.initial());
  TrainingResult result;
  TrainSettings recorded = run.plan().recorded();
  result.settings = to_json(bind_fields(recorded, train_fields()));
  trainer.run([&](const StepReport& report) {
    if (report.test) result.test = report.test->mean;
    return true;
  });
  result.iterations = trainer.iteration();
  result.seconds = trainer.seconds();
  const SplatModel model = trainer.model();
  result.splats = static_cast<std::uint32_t>(model.count);
  for (const ParameterGroup& group : parameter_groups(model.layout())) {
    if (group.count == 0) continue;
    double sum = 0, square = 0;
    for (int r = group.first; r < group.first + group.count; ++r)
      for (const float v : model.row(r)) sum += v, square += static_cast<double>(v) * v;
    const double n = static_cast<double>(group.count) * static_cast<double>(model.count), mean = sum / n;
    result.parameters.push_back({group.name, {mean, std::sqrt(std::max(0.0, square / n - mean * mean))}});
  }
  return result;
}

struct Request {
  std::string device, raster;  // raster: empty if none is requested
};

// Parses a request. "NAME@cpu", "NAME@gpu" and "NAME@auto" choose the rasteriser. Names of devices may also
// contain '@' ("... CPU @ 3.60GHz").
Request parse_request(const std::string& text) {
  for (const std::string raster : {"cpu", "gpu", "auto"})
    if (text.ends_with("@" + raster)) return {text.substr(0, text.size() - raster.size() - 1), raster};
  return {text, ""};
}

// Checks that all requested devices exist before the first one is measured.
void check_devices(const std::vector<std::string>& requests) {
  const std::vector<DeviceInfo> known = list_devices();
  for (const std::string& request : requests) {
    const Request parsed = parse_request(request);
    const DeviceInfo& device = known[choose_device(known, parsed.device)];
    if (!parsed.raster.empty()) raster_kind(parsed.raster, device);
  }
}

Comparison compare_one(const CompareOptions& options, const Inputs& in, const std::string& request,
                       Result& result) {
  TrainSettings settings = in.settings;
  const Request parsed = parse_request(request);
  if (!parsed.raster.empty()) settings.raster = parsed.raster;
  Comparison row;
  row.request = request;
  {
    // The device is not verified, because this command should also show how a faulty device differs.
    ModelSession session(open_device(parsed.device), in.model, settings, false, true);
    session.renderer().set_cameras(cameras_of(in.split));
    row.device = session.device().info();
    row.raster = raster_kind(settings.raster, row.device) == RasterKind::cpu ? "cpu" : "gpu";
    ViewRun run(session, in, static_cast<std::uint32_t>(options.view));
    run.forward(true);
    run.backward();
    row.loss = run.loss();
    if (!std::isfinite(row.loss))
      fail(ErrorKind::numerical, "the loss on {} is {}", row.device.name, row.loss);
    result = {session.renderer().download().rgb, run.gradient()};
    measure(session, run, options.repeat, row);
    row.peak_bytes = session.device().peak_bytes();
  }
  if (options.train_iterations > 0) {
    const std::unique_ptr<Device> device = open_device(parsed.device);
    row.training = train_on(*device, options, settings);
  }
  return row;
}

Inputs load_inputs(const CompareOptions& options) {
  LoadedModel loaded = open_model(options.model);
  Inputs in{drawing_settings(options.settings, loaded, options.model, options.run),
            loaded.model.single("ubs-lab compare"),
            {},
            {}};
  in.split = open_split_for(loaded.offset, options.data, options.split, in.settings, Images::load,
                            options.run.opened);
  if (options.view < 0 || static_cast<std::size_t>(options.view) >= in.split.views.size())
    fail(ErrorKind::usage, "--view {}: split '{}' has the views 0 to {}", options.view, in.split.name,
         in.split.views.size() - 1);
  require_images(in.split);
  check_query(in.split, in.model.dim);
  in.target = accuracy::planar_target(in.split.views[static_cast<std::size_t>(options.view)].load_image());
  in.settings.dim = in.model.dim;
  return in;
}

int run(CompareOptions& options) {
  options.run = use_run_data(options.model, options.data, options.settings.resolve());
  const auto held = lock_output_folder(options.out, {"compare.json", "compare.csv", "compare.md"},
                                       {options.data}, options.overwrite);
  const Inputs in = load_inputs(options);
  check_devices(options.devices);
  std::vector<Comparison> rows;
  Result reference;
  for (const std::string& request : options.devices) {
    Result result;
    rows.push_back(compare_one(options, in, request, result));
    if (rows.size() == 1) reference = result;
    compare_with(reference, result, rows.back());
  }
  const Json json{{"model", options.model},   {"data", options.data},
                  {"split", options.split},   {"view", options.view},
                  {"splats", in.model.count}, {"dim", in.model.dim},
                  {"repeat", options.repeat}, {"devices", comparison_json(rows)}};
  if (!options.out.empty()) {
    const std::filesystem::path folder(options.out);
    held->check_place();
    write_file_atomically(folder / "compare.json", json_file_text(json));
    write_file_atomically(folder / "compare.csv", comparison_csv(rows));
    write_file_atomically(folder / "compare.md",
                          comparison_page(rows, fmt::format("{} splats, N = {}, {} view {}", in.model.count,
                                                            in.model.dim, options.split, options.view)));
  }
  if (options.json)
    print_json(json);
  else
    say("{}", table_text(rows));
  return 0;
}

}  // namespace

Command add_compare(CLI::App& root) {
  CLI::App* app = root.add_subcommand("compare", "Compare the images, gradients and speed of devices");
  const auto options = std::make_shared<CompareOptions>(*app);
  app->add_option("--devices", options->devices,
                  "devices, as listed by 'ubs devices'; the first is the reference; NAME@cpu and NAME@gpu "
                  "choose the rasteriser of an OpenCL device")
      ->required()
      ->delimiter(',')
      ->type_name("A,B,...");
  add_model_option(*app, "model,--model", options->model)->required();
  app->add_option("data,--data", options->data, kRunDataHelp)->type_name("DIR|FILE");
  app->add_option("--split", options->split,
                  "split that contains the rendered view and the test views [test]")
      ->type_name("NAME");
  app->add_option("--view", options->view, "index of the view in the split [0]")->type_name("K");
  app->add_option("--repeat", options->repeat, "number of repetitions of the time measurements [20]")
      ->check(from_to(1, 100000))
      ->type_name("INT");
  app->add_option("--train-iterations", options->train_iterations,
                  "also train for this number of iterations on each device; 0: do not train [0]")
      ->check(from_to(0, 1000000))
      ->type_name("INT");
  app->add_option("--out", options->out, "folder for compare.json, compare.csv and the page compare.md")
      ->type_name("DIR");
  add_overwrite_option(*app, options->overwrite);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
