// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/measure.hpp"

#include "host/base/error.hpp"
#include "host/experiment/child_process.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> eval_command(const Job& job, const fs::path& folder, const RunOptions& options,
                                      bool lpips) {
  std::vector<std::string> command{options.executable.string(),
                                   "eval",
                                   "--model",
                                   (folder / "model.ply").string(),
                                   "--data",
                                   job.data.string(),
                                   "--out",
                                   (folder / "eval.json").string(),
                                   "--spec",
                                   (folder / "config.yaml").string(),
                                   "--fps-views",
                                   std::to_string(options.measure.fps_views)};
  if (!options.device.empty()) command.insert(command.end(), {"--device", options.device});
  if (lpips)
    command.insert(command.end(), {"--lpips", "vgg", "--lpips-range", "unit", "--lpips-weights",
                                   options.measure.lpips_weights.string()});
  return command;
}

// Empty when it measured, else why not.
std::string run_eval(const Job& job, const fs::path& folder, const RunOptions& options, bool lpips) {
  const fs::path log = folder / "measure.log";
  const ChildResult end = run_child(eval_command(job, folder, options, lpips), log, [&] {
    return options.interrupted() ? Request::interrupt : Request::none;
  });
  if (end.code == 0 && end.signal == 0) return "";
  if (options.interrupted()) return "interrupted; --resume measures it";
  return reason_of(end.code, end.signal, log);
}

}  // namespace

void measure(const Job& job, const fs::path& folder, const RunOptions& options, JobResult& result) {
  if (!result.values.contains("psnr")) return;  // without test images there is nothing to measure with
  const bool fps = options.measure.fps_views > 0 && !result.values.contains("fps");
  const bool lpips = !options.measure.lpips_weights.empty() && !result.values.contains("lpips");
  std::string why_no_fps, why_no_lpips;
  if (fps || lpips) {
    why_no_fps = run_eval(job, folder, options, lpips);
    if (lpips) why_no_lpips = why_no_fps;
    // Images that LPIPS cannot take, or no memory for its networks: the frames can be timed all the same.
    if (lpips && fps && !why_no_fps.empty() && !options.interrupted())
      why_no_fps = run_eval(job, folder, options, false);
    result.values = read_metrics(folder);
  }
  if (options.measure.fps_views == 0) why_no_fps = "not asked for (--fps-views 0)";
  if (options.measure.lpips_weights.empty()) why_no_lpips = options.measure.why_no_lpips;
  result.lacks.clear();
  if (!result.values.contains("fps")) result.lacks["fps"] = why_no_fps;
  if (!result.values.contains("lpips")) result.lacks["lpips"] = why_no_lpips;
}

}  // namespace ubs::experiment
