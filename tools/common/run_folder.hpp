// SPDX-License-Identifier: Apache-2.0
// The output folder of a training run: config.yaml, log.csv and checkpoint.ubs while it runs, then model.ply,
// metrics.json, renders/, and cameras/ of a run that refines them. Files other than the log appear whole or
// not at all. With --overwrite a run replaces files of these names, and removes the renders that the
// metrics.json of an earlier run lists; it touches nothing else.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/checkpoint.hpp"
#include "host/train/trainer.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

class RunFolder {
 public:
  // `writes`: false for all ranks of a job but the first. They call the same, and leave nothing.
  explicit RunFolder(std::filesystem::path folder, bool writes = true)
      : folder_(std::move(folder)), writes_(writes) {}
  bool writes() const { return writes_; }

  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;
  ~RunFolder();

  // Before anything is written. They throw Error(usage) if a file that the run would write exists and
  // `overwrite` is false, or if images of the views are in the folder; Error(data) if such a file is not an
  // ordinary one.
  void check_files(bool overwrite) const;
  void check_renders(const Split& split, int count, bool overwrite) const;
  void check_apart_from(const Split& views) const;
  // Makes the folder, removes what an earlier run left, writes config.yaml and starts log.csv.
  void begin(TrainSettings settings);
  void write_config(TrainSettings settings);  // in the place of the one that is there
  // Instead of begin(), with the checkpoint read: log.csv keeps its rows up to `iteration` and is continued.
  void resume(TrainSettings settings, int iteration);
  // Adds a row to log.csv. A row that cannot be written is a warning, once; it is kept for sync_log().
  void log(const StepReport& report);
  // The first row of log.csv; empty before there is one.
  std::string first_row() const;
  // Throws Error(data) where config.yaml or log.csv of the folder are those of another run than the
  // checkpoint.
  void check_same_run(const Checkpoint& checkpoint) const;
  // Rows so far are on the disk. Throws Error(data) if some cannot be written.
  void sync_log();
  void save_model(const SplatModel& model, std::span<const std::string> comments = {});
  void save_metrics(const Json& metrics);
  // Of a run that refines cameras; nothing of others. Of one that is not finished those of the training
  // views, without deviations. `unit`: of the training, in the data.
  void save_cameras(Trainer& trainer, const Split& train, const Split& test,
                    const std::array<double, 3>& offset, double unit, bool finished);
  // Names of the files in renders() that save_renders() writes.
  static std::vector<std::string> render_names(const Split& split, int count);
  // Ground truth | render of evenly spaced views (at most `count`; -1: all). Uses the trainer's renderer.
  // What cannot be written is tried once more after the others. Throws Error.
  std::size_t save_renders(Trainer& trainer, const Split& split, int count);
  // The last thing that a run does: as long as there is a checkpoint its end can be had again.
  void remove_checkpoint();

  const std::filesystem::path& path() const { return folder_; }
  std::filesystem::path model() const { return folder_ / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder_ / "checkpoint.ubs"; }
  std::filesystem::path metrics() const { return folder_ / "metrics.json"; }
  std::filesystem::path renders() const { return folder_ / "renders"; }
  std::filesystem::path cameras() const { return folder_ / "cameras"; }  // refined ones

 private:
  std::filesystem::path config_file() const { return folder_ / "config.yaml"; }
  std::filesystem::path log_file() const { return folder_ / "log.csv"; }
  std::vector<std::filesystem::path> files() const;
  void remove_renders() const;
  void start_log(std::string rows);

  std::filesystem::path folder_;
  bool writes_;
  std::string rows_;  // of log.csv, all of them
  int log_ = -1;      // log.csv, open for appending; -1 if some rows are missing there
  bool warned_ = false;
};

}  // namespace ubs::tools
