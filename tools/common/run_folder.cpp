// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_folder.hpp"

#include <algorithm>
#include <cstdlib>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/data/image.hpp"
#include "host/data/ply.hpp"
#include "host/spec/settings.hpp"
#include "tools/common/dataset.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLogHeader = "iteration,seconds,loss,splats,test_psnr,test_ssim";

// Two images of the same height next to each other.
Image8 side_by_side(const Image8& left, const Image8& right) {
  Image8 both{left.width + right.width, left.height, {}};
  both.rgb.resize(left.rgb.size() + right.rgb.size());
  auto to = both.rgb.begin();
  for (int y = 0; y < left.height; ++y)
    for (const Image8* image : {&left, &right})
      to = std::copy_n(image->rgb.begin() + std::ptrdiff_t{3} * y * image->width, 3 * image->width, to);
  return both;
}

}  // namespace

RunFolder::RunFolder(fs::path folder, bool overwrite) : folder_(std::move(folder)) {
  if (path_exists(folder_) && !is_folder(folder_))
    fail(ErrorKind::usage, "{}: is not a folder", folder_.string());
  if (overwrite) return;
  if (path_exists(model()))
    fail(ErrorKind::usage, "{} exists: choose another --out, or replace it with --overwrite",
         model().string());
  if (path_exists(checkpoint()))
    fail(ErrorKind::usage, "{} exists: go on with that run by --resume {}, or replace it with --overwrite",
         checkpoint().string(), folder_.string());
}

void RunFolder::begin(TrainSettings settings) {
  make_folders(folder_);
  remove_path(model());
  remove_path(metrics());
  remove_path(checkpoint());
  remove_tree(nonfinite());
  if (is_folder(renders()))
    for (const fs::path& entry : folder_entries(renders()))
      if (entry.extension() == ".png") remove_path(entry);
  write_config(settings);
  log_.open(folder_ / "log.csv", std::ios::trunc);
  log_ << kLogHeader << std::endl;
  if (!log_) fail(ErrorKind::data, "{}: cannot write", (folder_ / "log.csv").string());
}

void RunFolder::write_config(TrainSettings settings) {
  write_file_atomically(folder_ / "config.yaml",
                        "# Settings of this run; `ubs train --spec` of this file repeats it.\n" +
                            to_yaml(bind_fields(settings, train_fields())));
}

// Rows behind the checkpoint are made again.
void RunFolder::resume(TrainSettings settings, int iteration) {
  write_config(settings);
  const fs::path path = folder_ / "log.csv";
  std::string kept = kLogHeader;
  kept += '\n';
  if (path_exists(path)) {
    std::istringstream old(read_text_file(path));
    for (std::string line; std::getline(old, line);)
      if (const int row = std::atoi(line.c_str()); row > 0 && row <= iteration) kept += line + '\n';
  }
  write_file_atomically(path, kept);
  log_.open(path, std::ios::app);
  if (!log_) fail(ErrorKind::data, "{}: cannot write", path.string());
}

void RunFolder::log(const StepReport& report) {
  log_ << fmt::format("{},{:.3f},{},{},", report.iteration, report.seconds,
                      report.loss ? fmt::format("{:.6g}", *report.loss) : "", report.splats);
  if (report.test)
    log_ << fmt::format("{:.4f},{:.5f}", report.test->mean.psnr_channel_mean, report.test->mean.ssim);
  log_ << (report.test ? "" : ",") << std::endl;
  if (!log_) fail(ErrorKind::data, "{}: writing failed (disk full?)", (folder_ / "log.csv").string());
}

void RunFolder::save_model(const SplatModel& model_values, std::span<const std::string> comments) {
  write_splat_ply(model(), model_values, comments);
}

void RunFolder::save_metrics(const Json& json) { write_file_atomically(metrics(), json_file_text(json)); }

void RunFolder::remove_checkpoint() {
  std::error_code ignored;
  fs::remove(checkpoint(), ignored);
}

std::size_t RunFolder::save_renders(Trainer& trainer, const Split& split, int count) {
  const std::size_t views = split.views.size();
  const std::size_t wanted = count < 0 ? views : std::min(views, static_cast<std::size_t>(count));
  if (wanted == 0) return 0;
  make_folders(renders());
  Renderer& renderer = trainer.renderer();
  renderer.set_cameras(cameras_of(split));
  for (std::size_t k = 0; k < wanted; ++k) {
    const std::size_t i = k * views / wanted;
    renderer.forward(trainer.device_model().view(), static_cast<std::uint32_t>(i), trainer.render_settings(),
                     false);
    const RenderedView rendered = renderer.download();
    const View& view = split.views[i];
    save_png(renders() / (view.name + ".png"),
             side_by_side(view.load_image(),
                          image_from_interleaved(rendered.rgb, rendered.width, rendered.height)));
  }
  return wanted;
}

}  // namespace ubs::tools
