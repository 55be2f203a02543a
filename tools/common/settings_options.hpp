// SPDX-License-Identifier: Apache-2.0
// Options that fill TrainSettings: one for each field of its table, made from the table, and --spec and
// --set for the same fields. Later wins: defaults < --spec files < --set < explicit options.
#pragma once

#include <CLI/CLI.hpp>
#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/train_settings.hpp"

namespace ubs::tools {

// Of --dim where it is chosen by the data unless somebody says otherwise.
inline constexpr const char* kAutoDimHelp =
    "dimensions N of a splat: 3, 4 (+ time), 6 (+ view direction), 7 (+ both), more: query values; auto: "
    "chosen from what differs between the training views [auto]";

class SettingsOptions {
 public:
  // `keys` limits options and --set to these fields (empty: all); --spec always takes all, so that the
  // config.yaml of a training run tells render, eval and gradients how the model wants to be drawn.
  explicit SettingsOptions(CLI::App& app, std::vector<std::string_view> keys = {});
  SettingsOptions(const SettingsOptions&) = delete;

  // All of them are refused without `flag`.
  void need(CLI::App& app, CLI::Option* flag);
  TrainSettings resolve(TrainSettings base = {}) const;  // validated; `base`: in place of the defaults
  // From now on these fields alone. Throws Error(usage) for others that are given: "--OPTION `why`".
  void limit(std::vector<std::string_view> keys, std::string_view why);

 private:
  struct Entry {
    std::string key, text;
    CLI::Option* option;
  };
  bool offered(std::string_view key) const;

  std::vector<std::string_view> keys_;
  std::deque<Entry> entries_;  // the parser keeps references to their texts
  std::vector<std::string> specs_, assignments_;
};

// The fields that decide how a finished model is drawn and compared.
std::vector<std::string_view> drawing_keys();

}  // namespace ubs::tools
