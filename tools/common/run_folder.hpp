// SPDX-License-Identifier: Apache-2.0
// The output folder of a training run: config.yaml, log.csv and checkpoint.ubs while it runs, then model.ply,
// metrics.json and renders/. Files other than the log appear whole or not at all. Only files that an earlier
// run made are deleted, and only they, or with --overwrite any files of these names, are replaced.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/trainer.hpp"
#include "tools/common/output.hpp"
#include "tools/common/row_log.hpp"

namespace ubs::tools {

class RunFolder {
 public:
  // `writes`: false for all ranks of a job but the first. They call the same, and leave nothing.
  explicit RunFolder(std::filesystem::path folder, bool writes = true)
      : folder_(std::move(folder)), writes_(writes) {}
  bool writes() const { return writes_; }

  // Without `overwrite` they throw Error(usage) when the folder holds a model or a checkpoint, or a file that
  // the run would write or remove and that is not the unchanged result of an earlier one; with it only when
  // such a file is a link or a folder. They change nothing.
  void check_new(bool overwrite) const;
  void check_renders(const Split& split, int count) const;
  // Makes the folder, removes what an earlier run left, writes config.yaml and starts log.csv.
  void begin(TrainSettings settings);
  void write_config(TrainSettings settings);  // in the place of the one that is there
  // Instead of begin(), with the checkpoint read: log.csv keeps its rows up to `iteration` and is continued.
  // Files of a run that an earlier version of this program began, or whose list a power cut has damaged, are
  // recognised by their content.
  void resume(TrainSettings settings, int iteration);
  void log(const StepReport& report);
  void sync_log() { log_.sync(); }  // throws Error(data) when rows cannot be written
  void save_model(const SplatModel& model, std::span<const std::string> comments = {});
  void save_metrics(const Json& metrics);
  // Of a run that refines cameras; nothing of others. Of one that is not finished those of the training
  // views, without deviations.
  void save_cameras(Trainer& trainer, const Split& train, const Split& test,
                    const std::array<double, 3>& offset, bool finished);
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
  std::filesystem::path render_file(const View& view) const { return renders() / (view.name + ".png"); }
  void adopt_earlier();

  std::filesystem::path folder_;
  bool writes_;
  RowLog log_;
};

}  // namespace ubs::tools
