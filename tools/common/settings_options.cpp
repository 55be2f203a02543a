// SPDX-License-Identifier: Apache-2.0
#include "tools/common/settings_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <variant>

#include "host/base/error.hpp"
#include "host/settings/fields.hpp"
#include "tools/common/help.hpp"

namespace ubs::tools {
namespace {

std::string option_name(std::string key) {
  std::replace(key.begin(), key.end(), '_', '-');
  return "--" + key;
}

std::string type_word(const FieldValue& field) {
  constexpr auto kWords = std::to_array<const char*>(
      {"INT", "INT", "NUMBER", "", "TEXT", "R,G,B", "FIRST:END:STEP", ""});  // by index of the variant
  static_assert(kWords.size() == std::variant_size_v<FieldValue::Pointer>);
  return field.choices ? field.choices : kWords[field.value.index()];
}

std::string description(const FieldValue& field) {
  const std::string text = field_text(field);
  return fmt::format("{} [{}]", field.help, text.empty() ? "none" : text);
}

constexpr const char* kSettings = "Settings";

}  // namespace

SettingsOptions::SettingsOptions(CLI::App& app, std::vector<std::string_view> keys) : keys_(std::move(keys)) {
  TrainSettings defaults;
  for (const FieldValue& field : bind_fields(defaults, train_fields())) {
    if (!offered(field.key)) continue;
    Entry& entry = entries_.emplace_back(Entry{field.key, "", nullptr});
    const std::string name = option_name(field.key);
    const bool flag = std::holds_alternative<bool*>(field.value);
    entry.option = flag ? app.add_flag(name, entry.text, description(field))
                        : app.add_option(name, entry.text, description(field))->type_name(type_word(field));
    entry.option->group((field.uses & kSetFirst) ? kSettings : kRareGroup);
  }
  app.add_option("--spec", specs_, "YAML file of settings (repeatable; later files override earlier ones)")
      ->type_name("FILE")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->group(kSettings);
  app.add_option("--set", assignments_, "one setting, such as cap_max=50000 (repeatable)")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->group(kSettings);
}

bool SettingsOptions::offered(std::string_view key) const {
  return keys_.empty() || std::ranges::find(keys_, key) != keys_.end();
}

void SettingsOptions::need(CLI::App& app, CLI::Option* flag) {
  for (const Entry& entry : entries_) entry.option->needs(flag);
  for (const char* name : {"--spec", "--set"}) app.get_option(name)->needs(flag);
}

void SettingsOptions::limit(std::vector<std::string_view> keys, std::string_view why) {
  keys_ = std::move(keys);
  for (const Entry& entry : entries_)
    if (entry.option->count() > 0 && !offered(entry.key))
      fail(ErrorKind::usage, "{} {}", option_name(entry.key), why);
}

TrainSettings SettingsOptions::apply(TrainSettings settings) const {
  const std::vector<FieldValue> fields = bind_fields(settings, train_fields());
  std::vector<FieldValue> own;
  std::ranges::copy_if(fields, std::back_inserter(own), [&](const FieldValue& f) { return offered(f.key); });
  for (const std::string& spec : specs_)
    for (std::string& key : load_yaml(fields, spec)) settings.chosen.insert(std::move(key));
  for (const std::string& assignment : assignments_)
    settings.chosen.insert(set_field(own, assignment, "--set"));
  for (const Entry& entry : entries_)
    if (entry.option->count() > 0) {
      set_field(own, entry.key, entry.text, option_name(entry.key));
      settings.chosen.insert(entry.key);
    }
  return settings;
}

TrainSettings SettingsOptions::resolve(TrainSettings base) const {
  TrainSettings settings = apply(std::move(base));
  validate(settings);
  return settings;
}

std::vector<std::string_view> drawing_keys(std::initializer_list<std::string_view> more) {
  std::vector<std::string_view> keys = keys_used(kOfReading | kOfDrawing);
  keys.insert(keys.end(), {"raster", "math", "image_cache_mb"});
  keys.insert(keys.end(), more);
  return keys;
}

}  // namespace ubs::tools
