// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_folder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/retry_on_eintr.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/image.hpp"
#include "host/formats/ply.hpp"
#include "host/run/open_data.hpp"
#include "host/run/run_cameras.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/settings/fields.hpp"
#include "tools/common/output_files.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLogHeader =
    "iteration,seconds,loss,splats,test_psnr,test_ssim,sample_psnr,sample_views";
constexpr const char* kConfigHeader =
    "# Settings of this run. `ubs train --spec` with this file repeats the run.\n";

// Returns the first row of a log after its header; empty if there is no complete row.
std::string first_row_of(const std::string& log) {
  const std::size_t header = log.find('\n');
  const std::size_t end = header == std::string::npos ? header : log.find('\n', header + 1);
  return end == std::string::npos ? "" : log.substr(header + 1, end - header - 1);
}

// Returns the indices of at most `count` evenly spaced views; -1: all views.
std::vector<std::size_t> rendered_views(const Split& split, int count) {
  const std::size_t views = split.views.size();
  const std::size_t wanted = count < 0 ? views : std::min(views, static_cast<std::size_t>(count));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < wanted; ++k) chosen.push_back(k * views / wanted);
  return chosen;
}

// Returns an image that shows two images of the same height next to each other.
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

RunFolder::~RunFolder() {
  if (log_ >= 0) ::close(log_);
}

void RunFolder::check_place() const {
  if (lock_) lock_->check_place();
}

std::vector<fs::path> RunFolder::files() const {
  std::vector<fs::path> files{model(), checkpoint(), continuation(), metrics(), config_file(), log_file()};
  for (const char* name : kRunCameraFiles) files.push_back(cameras() / name);
  return files;
}

void RunFolder::check_files(bool overwrite) const {
  if (!writes_) return;
  if (!overwrite && path_exists(checkpoint()) && !path_exists(model()))
    fail(ErrorKind::usage,
         "{} already exists: continue that run with --resume {}, or pass --overwrite to replace it",
         checkpoint().string(), shell_word(folder_.string()));
  for (const fs::path& folder : {renders(), cameras()}) {
    std::error_code ignored;  // is_folder() reports the error
    const bool link = fs::is_symlink(folder, ignored);
    if (link || (path_exists(folder) && !is_folder(folder)))
      fail(ErrorKind::data,
           "{}: this is {}, but results are written to a folder of this name: rename it, or choose another "
           "output folder",
           folder.string(), link ? "a symbolic link" : "not a folder");
  }
  check_free(files(), overwrite);
}

std::vector<std::string> RunFolder::render_names(const Split& split, int count) {
  std::vector<std::string> names;
  for (const std::size_t i : rendered_views(split, count)) names.push_back(split.views[i].name + ".png");
  return names;
}

void RunFolder::check_renders(const Split& split, int count, bool overwrite) const {
  if (!writes_) return;
  Paths files;
  for (const std::string& name : render_names(split, count)) files.push_back(renders() / name);
  check_free(files, overwrite);
}

void RunFolder::check_apart_from(const Split& views) const {
  for (const fs::path& folder : {folder_, renders(), cameras()}) check_apart_from_images(folder, views);
}

// Removes the renders that the metrics.json of an earlier run lists. The file may come from another user, so
// names that lead out of the folder are ignored. If the file cannot be parsed, nothing is removed.
void RunFolder::remove_renders() const {
  if (!path_exists(metrics())) return;
  const std::string text = read_text_file(metrics());
  Json json;
  try {
    json = parse_own_json(text, metrics().string());
  } catch (const std::exception&) {
    return;
  }
  const auto names = json.is_object() ? json.find("renders") : json.end();
  if (names == json.end() || !names->is_array()) return;
  for (const Json& name : *names) {
    const fs::path file = name.is_string() ? name.get<std::string>() : "";
    if (file.native().find('\0') != std::string::npos) continue;  // system calls would truncate such a name
    if (file.extension() == ".png" && file == file.filename() && is_regular(renders() / file))
      fs::remove(renders() / file);
  }
}

void RunFolder::begin(TrainSettings settings) {
  if (!writes_) return;
  remove_renders();
  for (const fs::path& file : files())
    if (path_exists(file)) fs::remove(file);
  for (const fs::path& folder : {renders(), cameras()}) ::rmdir(folder.c_str());  // only if they are empty
  make_folders(folder_);
  write_config(settings);
  start_log(std::string(kLogHeader) + '\n');
}

void RunFolder::write_config(TrainSettings settings) {
  if (!writes_) return;
  check_place();
  write_file_atomically(config_file(), kConfigHeader + to_yaml(bind_fields(settings, train_fields())));
}

// Removes an incomplete last row, and the rows after the checkpoint, because the continued run writes them
// again.
void RunFolder::resume(TrainSettings settings, int iteration) {
  if (!writes_) return;
  write_config(settings);
  std::string kept = kLogHeader;
  kept += '\n';
  if (path_exists(log_file())) {
    std::istringstream old(read_text_file(log_file()));
    for (std::string line; std::getline(old, line) && !old.eof();)
      if (const int row = std::atoi(line.c_str()); row > 0 && row <= iteration) kept += line + '\n';
  }
  start_log(std::move(kept));
}

std::string RunFolder::first_row() const { return first_row_of(rows_); }

void RunFolder::check_same_run(const Checkpoint& checkpoint, const fs::path& from) const {
  const auto refuse = [&](const fs::path& file, const std::string& why) {
    fail(ErrorKind::data,
         "{0}: belongs to another run than {1} in the same folder ({2}): move {3} into the folder of its "
         "run, or delete {1}",
         from.string(), file.filename().string(), why, from.filename().string());
  };
  if (path_exists(log_file())) {
    const std::string row = first_row_of(read_text_file(log_file()));
    // If the first row is of a later iteration than the checkpoint, the same run wrote it afterwards.
    if (!row.empty() && row != checkpoint.first_row &&
        (!checkpoint.first_row.empty() || std::atoi(row.c_str()) <= checkpoint.state.iteration))
      refuse(log_file(), fmt::format("whose first row is '{}', not '{}'", row, checkpoint.first_row));
  }
  if (!path_exists(config_file())) return;
  TrainSettings config;
  try {
    load_yaml(bind_fields(config, train_fields()), config_file());
    // These settings may change during the run, and config.yaml is written before the checkpoint.
    config.iterations = checkpoint.settings.iterations;
    config.work_shares = checkpoint.settings.work_shares;
    config.growth_end = checkpoint.settings.growth_end;
    check_same_settings(config, checkpoint.settings);
  } catch (const Error& error) {
    refuse(config_file(), error.what());
  }
}

void RunFolder::start_log(std::string rows) {
  check_place();
  rows_ = std::move(rows);
  write_file_atomically(log_file(), rows_);
  if (log_ >= 0) ::close(log_);
  log_ = ::open(log_file().c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (log_ < 0) fail(ErrorKind::data, "{}: cannot write: {}", log_file().string(), std::strerror(errno));
}

void RunFolder::log(const StepReport& report) {
  if (!writes_) return;
  const std::string row = fmt::format(
      "{},{:.3f},{},{},{},{}\n", report.iteration, report.seconds,
      report.loss ? fmt::format("{:.6g}", *report.loss) : "", report.splats,
      report.test ? fmt::format("{:.4f},{:.5f}", report.test->mean.psnr_channel_mean, report.test->mean.ssim)
                  : ",",
      report.sample ? fmt::format("{:.4f},{}", report.sample->psnr, report.sample->views) : ",");
  rows_ += row;
  if (log_ < 0) return;  // the file lacks rows: sync_log() writes all of them
  for (std::size_t done = 0; done < row.size();) {
    const auto bytes = retry_on_eintr([&] { return ::write(log_, row.data() + done, row.size() - done); });
    if (bytes >= 0) {
      done += static_cast<std::size_t>(bytes);
      continue;
    }
    if (!warned_)
      warn("{}: writing failed: {} (is the disk full?); the rows are kept in memory and written later",
           log_file().string(), std::strerror(errno));
    warned_ = true;
    ::close(log_);
    log_ = -1;
    return;
  }
}

void RunFolder::sync_log() {
  if (!writes_ || rows_.empty()) return;
  if (log_ < 0 || retry_on_eintr([&] { return ::fsync(log_); }) != 0) start_log(std::move(rows_));
}

void RunFolder::save_model(const SplatModel& model_values, std::span<const std::string> comments) {
  if (!writes_) return;
  check_place();
  write_splat_ply(model(), model_values, comments);
}

void RunFolder::save_metrics(const Json& json) {
  if (!writes_) return;
  check_place();
  write_file_atomically(metrics(), json_file_text(json));
}

void RunFolder::save_cameras(TrainingRun& run, bool finished) {
  Trainer& trainer = run.trainer();
  const double unit = run.plan().unit();
  if (!trainer.scene().cameras().refines() || !writes_) return;
  std::vector<FittedCamera> refined, held_out;
  if (finished) {
    refined = trainer.scene().cameras().learnt();
    held_out = trainer.scene().cameras().held_out();
  } else {  // an interrupted run does not compute deviations
    for (const Camera& camera : trainer.scene().cameras().train()) refined.push_back({camera, {NAN, NAN}});
  }
  for (std::vector<FittedCamera>* cameras : {&refined, &held_out})
    for (FittedCamera& fitted : *cameras) {
      scale_lengths(fitted.camera, unit);
      fitted.deviation.centre *= unit;
    }
  const std::array<RunCameras, 2> splits{{{run.train(), refined}, {run.test(), held_out}}};
  check_place();
  write_run_cameras(cameras(), splits, run.offset(), run.report().folder);
}

void RunFolder::remove_checkpoint() {
  if (!writes_) return;
  check_place();
  fs::remove(checkpoint());
  sync_folder(folder_);
}

void RunFolder::keep_checkpoint() {
  if (!writes_) return;
  check_place();
  if (!path_exists(checkpoint())) return;
  fs::rename(checkpoint(), continuation());
  sync_folder(folder_);
}

void RunFolder::remove_older_states() {
  if (!writes_) return;
  check_place();
  for (const fs::path& file : {checkpoint(), continuation()}) fs::remove(file);
  sync_folder(folder_);
}

std::size_t RunFolder::save_renders(Trainer& trainer, const Split& split, int count) {
  std::vector<std::size_t> views = rendered_views(split, count);
  const std::size_t wanted = views.size();
  if (wanted == 0) return 0;
  if (writes_) make_folders(renders());
  trainer.scene().set_cameras(trainer.scene().cameras().test());
  const auto save = [&](std::size_t i) {
    trainer.scene().draw(static_cast<std::uint32_t>(i));
    if (!writes_) return;
    check_place();
    const RenderedView rendered = trainer.scene().renderer().download();
    const View& view = split.views[i];
    save_png(renders() / (view.name + ".png"),
             side_by_side(view.load_image(),
                          image_from_interleaved(rendered.rgb, rendered.width, rendered.height)));
  };
  std::vector<std::size_t> again;
  for (const std::size_t i : views) {
    try {
      save(i);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::data || trainer.scene().ranks().size() > 1) throw;
      again.push_back(i);
    }
  }
  for (const std::size_t i : again) save(i);
  return wanted;
}

}  // namespace ubs::tools
