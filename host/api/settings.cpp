// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for settings, which are accessed by name.
#include "host/scene/settings.hpp"

#include <algorithm>
#include <set>
#include <vector>

#include "host/api/handles.hpp"

namespace ubs::facade {
namespace {

// What an object of the interface takes from the settings.
struct ObjectUse {
  const char* name;
  unsigned uses;                       // FieldUse
  std::vector<std::string_view> more;  // keys without such a use
  bool form;                           // dim and variant
};

ObjectUse object_use(ubs_use use) {
  switch (use) {
    case UBS_USE_DATA:
      return {"data", kOfReading, {"background", "image_cache_mb"}, false};
    case UBS_USE_MODEL:
      return {"a new model", kOfDrawing, {}, true};
    case UBS_USE_RENDERER:
      return {"a renderer", kOfKernels | kOfDrawing, {"raster"}, false};
  }
  fail(ErrorKind::usage, "use {} is unknown", static_cast<int>(use));
}

bool is_form(std::string_view key) { return key == "dim" || variant_values(key); }

void check_effect(const std::set<std::string, std::less<>>& keys, const ObjectUse& object) {
  const std::vector<std::string_view> used = keys_used(object.uses);
  for (const std::string& key : keys) {
    if (std::ranges::count(used, key) + std::ranges::count(object.more, key) > 0) continue;
    if (!is_form(key)) fail(ErrorKind::usage, "{} has no effect on {}", key, object.name);
    if (!object.form)
      fail(ErrorKind::usage, "{} has no effect on {}: the form is that of the model", key, object.name);
  }
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
  return guarded([&] { check_effect(given(settings, "settings").values.chosen, object_use(use)); });
}

ubs_status ubs_settings_describe(size_t index, const char** key, const char** help) {
  return guarded([&] {
    const bool there = index < train_fields().size();
    if (key) *key = there ? train_fields()[index].key : nullptr;
    if (help) *help = there ? train_fields()[index].help : nullptr;
  });
}
