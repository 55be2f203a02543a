// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_folder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/made_files.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/data/image.hpp"
#include "host/data/ply.hpp"
#include "host/run/open_data.hpp"
#include "host/run/run_cameras.hpp"
#include "host/spec/settings.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLogHeader = "iteration,seconds,loss,splats,test_psnr,test_ssim";
constexpr const char* kConfigHeader = "# Settings of this run; `ubs train --spec` of this file repeats it.\n";

// Evenly spaced views, at most `count`; -1: all.
std::vector<std::size_t> rendered_views(const Split& split, int count) {
  const std::size_t views = split.views.size();
  const std::size_t wanted = count < 0 ? views : std::min(views, static_cast<std::size_t>(count));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < wanted; ++k) chosen.push_back(k * views / wanted);
  return chosen;
}

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

void RunFolder::check_new(bool overwrite) const {
  if (!writes_) return;
  if (overwrite) allow_overwriting(folder_);
  if (!overwrite && path_exists(checkpoint()) && !path_exists(model()))
    fail(ErrorKind::usage, "{} exists: continue that run with --resume {}, or replace it with --overwrite",
         checkpoint().string(), shell_word(folder_.string()));
  for (const fs::path& file : {model(), checkpoint(), metrics(), config_file(), log_file()})
    if (!overwrite && path_exists(file) && (file == model() || !is_own_result(file)))
      fail(ErrorKind::usage, "{} exists: choose another --out, or replace it with --overwrite",
           file.string());
  for (const fs::path& folder : {folder_, renders(), cameras()}) check_removable(folder);
  check_replaceable({model(), checkpoint(), metrics(), config_file(), log_file()});
}

void RunFolder::check_renders(const Split& split, int count) const {
  if (!writes_) return;
  std::vector<fs::path> files;
  for (const std::size_t i : rendered_views(split, count)) files.push_back(render_file(split.views[i]));
  check_replaceable(files);
}

void RunFolder::begin(TrainSettings settings) {
  if (!writes_) return;
  for (const fs::path& folder : {renders(), cameras(), folder_}) remove_made(folder);
  make_folders(folder_);
  write_config(settings);
  log_.start(log_file(), std::string(kLogHeader) + '\n');
}

void RunFolder::write_config(TrainSettings settings) {
  write_file_atomically(config_file(), kConfigHeader + to_yaml(bind_fields(settings, train_fields())));
}

// What a run of this program leaves begins like that; the model is that of the run when its metrics say so.
void RunFolder::adopt_earlier() {
  const auto adopt_if = [](const fs::path& file, bool grows, const auto& is_ours) {
    if (path_exists(file) && !is_own_result(file) && is_ours(read_text_file(file))) adopt(file, grows);
  };
  const auto begins = [](std::string_view with) {
    return [with](const std::string& text) { return text.starts_with(with); };
  };
  bool interrupted = false;
  adopt_if(checkpoint(), false, [](const std::string&) { return true; });  // it has been read
  adopt_if(config_file(), false, begins(kConfigHeader));
  adopt_if(log_file(), true, begins(kLogHeader));
  adopt_if(metrics(), false, [&](const std::string& text) {
    const Json json = Json::parse(text, nullptr, false);
    interrupted = json.is_object() && json.contains("splats") && json.value("interrupted", false);
    return interrupted;
  });
  if (interrupted) adopt_if(model(), false, begins("ply\n"));
}

// Rows behind the checkpoint are made again, and so is a last one that is not whole.
void RunFolder::resume(TrainSettings settings, int iteration) {
  if (!writes_) return;
  adopt_earlier();
  write_config(settings);
  std::string kept = kLogHeader;
  kept += '\n';
  if (path_exists(log_file())) {
    std::istringstream old(read_text_file(log_file()));
    for (std::string line; std::getline(old, line) && !old.eof();)
      if (const int row = std::atoi(line.c_str()); row > 0 && row <= iteration) kept += line + '\n';
  }
  log_.start(log_file(), kept);
}

void RunFolder::log(const StepReport& report) {
  if (!writes_) return;
  log_.add(fmt::format(
      "{},{:.3f},{},{},{}", report.iteration, report.seconds,
      report.loss ? fmt::format("{:.6g}", *report.loss) : "", report.splats,
      report.test ? fmt::format("{:.4f},{:.5f}", report.test->mean.psnr_channel_mean, report.test->mean.ssim)
                  : ","));
}

void RunFolder::save_model(const SplatModel& model_values, std::span<const std::string> comments) {
  if (writes_) write_splat_ply(model(), model_values, comments);
}

void RunFolder::save_metrics(const Json& json) {
  if (writes_) write_file_atomically(metrics(), json_file_text(json));
}

void RunFolder::save_cameras(Trainer& trainer, const Split& train, const Split& test,
                             const std::array<double, 3>& offset, bool finished) {
  if (!trainer.refines_cameras() || !writes_) return;
  std::vector<FittedCamera> refined, held_out;
  if (finished) {
    refined = trainer.refined_cameras();
    held_out = trainer.held_out_cameras();
  } else {  // nobody waits for fits
    for (const Camera& camera : trainer.train_cameras()) refined.push_back({camera, {NAN, NAN}});
  }
  const std::array<RunCameras, 2> splits{{{train, refined}, {test, held_out}}};
  write_run_cameras(cameras(), splits, offset);
}

void RunFolder::remove_checkpoint() {
  if (!writes_) return;
  remove_path(checkpoint());
  sync_folder(folder_);
}

std::size_t RunFolder::save_renders(Trainer& trainer, const Split& split, int count) {
  std::vector<std::size_t> views = rendered_views(split, count);
  const std::size_t wanted = views.size();
  if (wanted == 0) return 0;
  if (writes_) make_folders(renders());
  trainer.set_cameras(trainer.test_cameras());
  const auto save = [&](std::size_t i) {
    trainer.draw(static_cast<std::uint32_t>(i));
    if (!writes_) return;
    const RenderedView rendered = trainer.renderer().download();
    const View& view = split.views[i];
    save_png(render_file(view),
             side_by_side(view.load_image(),
                          image_from_interleaved(rendered.rgb, rendered.width, rendered.height)));
  };
  std::vector<std::size_t> again;
  for (const std::size_t i : views) {
    try {
      save(i);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::data || trainer.ranks().size() > 1) throw;
      again.push_back(i);
    }
  }
  for (const std::size_t i : again) save(i);
  return wanted;
}

}  // namespace ubs::tools
