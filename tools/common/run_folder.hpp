// SPDX-License-Identifier: Apache-2.0
// The output folder of a training run: config.yaml, log.csv and checkpoint.ubs while it runs, then model.ply,
// metrics.json and renders/; nonfinite/ with reports of values that are not finite. Files other than the log
// appear whole or not at all.
#pragma once

#include <filesystem>
#include <fstream>
#include <span>
#include <string>

#include "host/scene/splat_model.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/trainer.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

class RunFolder {
 public:
  // Throws Error(usage) when the folder holds a model or a checkpoint, unless `overwrite`. Changes nothing
  // yet.
  RunFolder(std::filesystem::path folder, bool overwrite);

  // Makes the folder, removes what an earlier run left, writes config.yaml and starts log.csv.
  void begin(TrainSettings settings);
  // Instead of begin(): log.csv keeps its rows up to `iteration` and is continued.
  void resume(TrainSettings settings, int iteration);
  void log(const StepReport& report);
  void save_model(const SplatModel& model, std::span<const std::string> comments = {});
  void save_metrics(const Json& metrics);
  void remove_checkpoint();
  // Ground truth | render of evenly spaced views (at most `count`; -1: all). Uses the trainer's renderer.
  std::size_t save_renders(Trainer& trainer, const Split& split, int count);

  std::filesystem::path model() const { return folder_ / "model.ply"; }
  std::filesystem::path checkpoint() const { return folder_ / "checkpoint.ubs"; }
  std::filesystem::path nonfinite() const { return folder_ / "nonfinite"; }
  std::filesystem::path metrics() const { return folder_ / "metrics.json"; }
  std::filesystem::path renders() const { return folder_ / "renders"; }

 private:
  void write_config(TrainSettings settings);

  std::filesystem::path folder_;
  std::ofstream log_;
};

}  // namespace ubs::tools
