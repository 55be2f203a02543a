// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for settings. Programs get and set a setting by its name.
#include <algorithm>

#include "host/capi/handles.hpp"
#include "host/settings/fields.hpp"

namespace ubs::facade {
namespace {

bool is_form(std::string_view key) { return key == "dim" || variant_values(key); }

bool is_used(std::string_view key, unsigned uses) { return std::ranges::count(keys_used(uses), key) > 0; }

// Returns whether a setting has an effect on objects that the C interface creates for this use.
bool has_effect(std::string_view key, ubs_use use) {
  switch (use) {
    case UBS_USE_DATA:
      return is_used(key, kOfReading) || key == "background" || key == "image_cache_mb";
    case UBS_USE_MODEL:
      return is_used(key, kOfDrawing) || is_form(key);
    case UBS_USE_RENDERER:
      return is_used(key, kOfKernels | kOfDrawing) || key == "raster";
    // The settings that may change when a run is resumed concern the reading of data, measurements and output
    // files. A trainer ignores them, because the data have been read already and the caller saves the
    // results. The exceptions are eval_every, on_nan and budget.
    case UBS_USE_TRAINER:
      return !is_used(key, kFreeOnResume) || key == "eval_every" || key == "on_nan" || key == "budget";
  }
  fail(ErrorKind::usage, "{} is not a value of ubs_use", static_cast<int>(use));
}

}  // namespace
}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_settings_create(ubs_settings** settings) {
  return made(settings, [] { return std::make_unique<ubs_settings>(); });
}

ubs_status ubs_settings_copy(const ubs_settings* settings, ubs_settings** copy) {
  return made(copy, [&] { return std::make_unique<ubs_settings>(given(settings, "settings")); });
}

void ubs_settings_free(ubs_settings* settings) { delete settings; }

ubs_status ubs_settings_load(ubs_settings* settings, const char* path) {
  return guarded([&] {
    TrainSettings changed = given(settings, "settings").values;
    for (std::string& key : load_yaml(bind_fields(changed, train_fields()), &given(path, "path")))
      changed.chosen.insert(std::move(key));
    settings->values = std::move(changed);
  });
}

ubs_status ubs_settings_set(ubs_settings* settings, const char* key, const char* value) {
  return guarded([&] {
    TrainSettings& values = given(settings, "settings").values;
    set_field(bind_fields(values, train_fields()), &given(key, "key"), &given(value, "value"), "settings");
    values.chosen.insert(key);
  });
}

ubs_status ubs_settings_get(const ubs_settings* settings, const char* key, char* value, size_t capacity,
                            size_t* length) {
  return guarded([&] {
    TrainSettings values = given(settings, "settings").values;
    const std::string wanted = &given(key, "key");
    for (const FieldValue& field : bind_fields(values, train_fields())) {
      if (wanted != field.key) continue;
      const std::string text = field_text(field);
      if (value && capacity > 0) {
        const std::size_t size = std::min(text.size(), capacity - 1);
        std::memcpy(value, text.data(), size);
        value[size] = 0;
      }
      if (length) *length = text.size();
      return;
    }
    fail(ErrorKind::usage, "settings: unknown key '{}'", wanted);
  });
}

ubs_status ubs_settings_check(const ubs_settings* settings, ubs_use use) {
  return guarded([&] {
    static constexpr const char* kNames[] = {"data", "a new model", "a renderer", "a trainer"};
    for (const std::string& key : given(settings, "settings").values.chosen)
      if (!has_effect(key, use))
        fail(ErrorKind::usage, "{} has no effect on {}{}", key, kNames[use],
             use == UBS_USE_RENDERER && is_form(key) ? ": a renderer uses the variant of the model" : "");
  });
}

ubs_status ubs_settings_describe(size_t index, const char** key, const char** help) {
  return guarded([&] {
    const bool there = index < train_fields().size();
    if (key) *key = there ? train_fields()[index].key : nullptr;
    if (help) *help = there ? train_fields()[index].help : nullptr;
  });
}
