// SPDX-License-Identifier: Apache-2.0
// SettingsOptions has the options that fill TrainSettings: one option for each field in its table, and --spec
// and --set, which can set any of these fields. Later ones override earlier ones in this order: defaults,
// --spec files, --set, explicit options.
#pragma once

#include <CLI/CLI.hpp>
#include <deque>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "host/settings/train_settings.hpp"

namespace ubs::tools {

class SettingsOptions {
 public:
  // `keys` limits options and --set to these fields (empty: all). --spec always accepts all fields, so that
  // render, eval and gradients can read the rendering settings from the config.yaml of a training run.
  explicit SettingsOptions(CLI::App& app, std::vector<std::string_view> keys = {});
  SettingsOptions(const SettingsOptions&) = delete;

  // Makes all these options require the option `flag`.
  void need(CLI::App& app, CLI::Option* flag);
  // Returns the settings; `base` replaces the defaults. resolve() also validates them.
  TrainSettings apply(TrainSettings base) const;
  TrainSettings resolve(TrainSettings base = {}) const;
  // Allows only these fields from now on. Throws Error(usage) with the text "--OPTION `why`" if another one
  // was given.
  void limit(std::vector<std::string_view> keys, std::string_view why);

 private:
  struct Entry {
    std::string key, text;
    CLI::Option* option;
  };
  bool offered(std::string_view key) const;

  std::vector<std::string_view> keys_;
  std::deque<Entry> entries_;  // the parser keeps references to the texts
  std::vector<std::string> specs_, assignments_;
};

// Returns the fields that determine how a finished model is rendered and compared, and the fields `more`.
std::vector<std::string_view> drawing_keys(std::initializer_list<std::string_view> more = {});

}  // namespace ubs::tools
