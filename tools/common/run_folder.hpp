// SPDX-License-Identifier: Apache-2.0
// RunFolder is the output folder of a training run. During the run it contains config.yaml, log.csv and
// checkpoint.ubs. At the end it also contains model.ply, metrics.json and renders/, and continue.ubs instead
// of checkpoint.ubs if the run can be continued. If the run refines cameras, it also contains cameras/. All
// files except the log are written atomically. With --overwrite, a run replaces files with these names and
// removes the renders that the metrics.json of an earlier run lists. It does not change other files.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/base/folder_lock.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/run/training_run.hpp"
#include "host/scene/splat_model.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/checkpoint.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

class RunFolder {
 public:
  // `writes`: false for all ranks of a job except the first. These ranks make the same calls, but do not
  // write.
  // `lock`: the lock of the folder, or null if nothing is written.
  explicit RunFolder(std::filesystem::path folder, bool writes = true, FolderLock* lock = nullptr)
      : folder_(std::move(folder)), writes_(writes), lock_(lock) {}
  bool writes() const { return writes_; }
  // Throws Error(data) if the folder was removed or replaced during the run. All functions below that write
  // call it first.
  void check_place() const;

  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;
  ~RunFolder();

  // These checks are made before anything is written. They throw Error(usage) if a file that the run would
  // write exists and `overwrite` is false, or if images of the views are in the folder; they throw
  // Error(data) if such a file is not an ordinary file, or if such a folder is a file or a link.
  void check_files(bool overwrite) const;
  void check_renders(const Split& split, int count, bool overwrite) const;
  void check_apart_from(const Split& views) const;
  // Creates the folder, removes the files of an earlier run, writes config.yaml and starts log.csv.
  void begin(TrainSettings settings);
  void write_config(TrainSettings settings);  // replaces the existing one
  // Called instead of begin() after reading the checkpoint: keeps the rows of log.csv up to `iteration` and
  // continues it.
  void resume(TrainSettings settings, int iteration);
  // Adds a row to log.csv. If writing fails, warns once and keeps the rows for sync_log().
  void log(const StepReport& report);
  // Returns the first row of log.csv; empty if there is none yet.
  std::string first_row() const;
  // Throws Error(data) if config.yaml or log.csv in the folder belong to another run than the checkpoint.
  // `from` is the file of the checkpoint.
  void check_same_run(const Checkpoint& checkpoint, const std::filesystem::path& from) const;
  // Ensures that all rows so far are on the disk. Throws Error(data) if some cannot be written.
  void sync_log();
  void save_model(const SplatModel& model, std::span<const std::string> comments = {});
  void save_metrics(const Json& metrics);
  // Writes the cameras of a run that refines them; does nothing for other runs. For a run that is not
  // finished, writes only those of the training views, without deviations.
  void save_cameras(TrainingRun& run, bool finished);
  // Returns the names of the files that save_renders() writes to renders().
  static std::vector<std::string> render_names(const Split& split, int count);
  // Writes one image per view, for at most `count` evenly spaced views (-1: all views). An image shows the
  // ground truth on the left and the render on the right. Uses the trainer's renderer. If an image cannot be
  // read or written, tries again after the other images, and throws Error if this fails too. In a job of
  // several ranks, throws Error at once. Returns the number of images.
  std::size_t save_renders(Trainer& trainer, const Split& split, int count);
  // Must be the last step of a run, because the end of the run can only be repeated from the checkpoint.
  void remove_checkpoint();
  // Renames checkpoint.ubs to continue.ubs, from which a finished run can be continued with more time.
  // Does nothing if there is no checkpoint.
  void keep_checkpoint();
  // Removes checkpoint.ubs and continue.ubs, which are older than the results.
  void remove_older_states();

  const std::filesystem::path& path() const { return folder_; }
  std::filesystem::path model() const { return folder_ / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder_ / "checkpoint.ubs"; }
  std::filesystem::path continuation() const { return folder_ / "continue.ubs"; }
  std::filesystem::path metrics() const { return folder_ / "metrics.json"; }
  std::filesystem::path renders() const { return folder_ / "renders"; }
  std::filesystem::path cameras() const { return folder_ / "cameras"; }  // refined cameras

 private:
  std::filesystem::path config_file() const { return folder_ / "config.yaml"; }
  std::filesystem::path log_file() const { return folder_ / "log.csv"; }
  std::vector<std::filesystem::path> files() const;
  void remove_renders() const;
  void start_log(std::string rows);

  std::filesystem::path folder_;
  bool writes_;
  FolderLock* lock_;
  std::string rows_;  // all rows of log.csv
  // log.csv, open for appending; -1 if the file lacks some rows.
  int log_ = -1;
  bool warned_ = false;
};

}  // namespace ubs::tools
