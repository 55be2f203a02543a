// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for models in host memory.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>

#include "host/base/paths.hpp"
#include "host/base/warning.hpp"
#include "host/capi/handles.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/model/export_model.hpp"
#include "host/model/model_session.hpp"
#include "host/run/training_run.hpp"
#include "host/scene/scene_unit.hpp"

namespace ubs::facade {
namespace {

// Returns the name of a parameter group as a string with static lifetime.
const char* group_name(const std::string& name) {
  for (const GroupName& known : kParameterGroups)
    if (name == known.name) return known.name.data();
  fail(ErrorKind::internal, "unknown parameter group '{}'", name);
}

void check_count(std::uint64_t splats) {
  constexpr std::uint64_t kMaxSplats = 100'000'000;  // also the maximum of the setting cap_max
  if (splats < 1 || splats > kMaxSplats)
    fail(ErrorKind::usage, "a model can have 1 to {} splats, not {}", kMaxSplats, splats);
}

void save(const LoadedModel& loaded, const std::string& path, const std::string& format, double time) {
  check_splat_name(path);
  const SplatFormat* by_name = format_of_extension(path);
  if (format == "auto" && !by_name)
    fail(ErrorKind::usage, "{}: no format has the extension '{}': choose one of the formats {}", path,
         small_extension(path), fmt::join(written_formats(), ", "));
  const SplatFormat& kind = format == "auto" ? *by_name : splat_format(format);
  if (kind.ours()) return write_mixed_ply(path, loaded.model, loaded.comments);
  ReduceOptions options{.time = time, .opacity = "mean", .viewpoints = {}};
  for (const Camera& camera : loaded.notes.cameras) options.viewpoints.push_back(camera.centre());
  std::vector<std::string> remarks;
  const ImportedSplats splats = exported_splats(kind, loaded.model, loaded.offset, options, remarks);
  write_foreign_splats(kind, path, splats);
  for (const std::string& text : format_remarks(kind, splats)) remarks.push_back(text);
  for (const std::string& text : remarks) log_line(LogLevel::notice, text);
}

}  // namespace

void check_parameters(const MixedModel& model) {
  for (const SplatModel& group : model.groups) {
    bool bad = false;
    for (const float value : group.values)  // without a branch, so that the compiler can vectorise the loop
      bad |= (std::bit_cast<std::uint32_t>(value) & 0x7f800000u) == 0x7f800000u;
    if (!bad) continue;
    const auto at = std::ranges::find_if(group.values, [](float value) { return !std::isfinite(value); });
    const auto [row, splat] = std::div(at - group.values.begin(), static_cast<std::ptrdiff_t>(group.count));
    for (const ParameterGroup& found : parameter_groups(group.layout()))
      if (row >= found.first && row < found.first + found.count)
        fail(ErrorKind::numerical, "the parameter {} of splat {} with N = {} is {}, but must be finite",
             found.name, splat, group.dim, *at);
  }
}

}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_model_create(const ubs_settings* settings, uint64_t splats, ubs_model** model) {
  return made(model, [&] {
    const TrainSettings& values = given(settings, "settings").values;
    validate(values);
    if (values.dim == kAutoInt)
      fail(ErrorKind::usage, "dim = auto requires data: pass a number from 3 to 11");
    check_count(splats);
    auto created = std::make_unique<ubs_model>();
    created->loaded.model = SplatModel(values.dim, splats, values.variant);
    created->loaded.notes = notes_for(values, {});
    created->loaded.comments = comments_of(created->loaded.notes);
    return created;
  });
}

ubs_status ubs_model_create_initial(const ubs_data* data, const ubs_settings* settings, ubs_model** model) {
  return made(model, [&] {
    const TrainSettings values = settings ? settings->values : TrainSettings{};
    validate(values);
    const TrainingRun run(given(data, "data").set, values);
    auto created = std::make_unique<ubs_model>();
    SplatModel initial = run.initial();
    scale_lengths(initial, run.plan().unit());
    created->loaded.model = std::move(initial);
    created->loaded.offset = run.offset();
    created->loaded.notes = notes_for(run.plan().recorded(), run.cameras());
    created->loaded.comments = model_comments(run.offset(), run.plan().recorded(), run.cameras());
    return created;
  });
}

ubs_status ubs_model_copy(const ubs_model* model, ubs_model** copy) {
  return made(copy, [&] { return std::make_unique<ubs_model>(given(model, "model")); });
}

ubs_status ubs_model_create_like(const ubs_model* model, uint64_t splats, ubs_model** created) {
  return made(created, [&] {
    const LoadedModel& loaded = given(model, "model").loaded;
    const SplatModel& group = loaded.model.single("creating a model with another number of splats");
    check_count(splats);
    auto like = std::make_unique<ubs_model>();
    like->loaded.offset = loaded.offset;
    like->loaded.notes = loaded.notes;
    like->loaded.comments = loaded.comments;
    like->loaded.model = SplatModel(group.dim, splats, group.variant);
    return like;
  });
}

void ubs_model_free(ubs_model* model) { delete model; }

ubs_status ubs_model_load(const char* path, ubs_model** model) {
  return made(model, [&] {
    auto loaded = std::make_unique<ubs_model>();
    loaded->loaded = open_model(&given(path, "path"));
    return loaded;
  });
}

ubs_status ubs_model_save(const ubs_model* model, const char* path, const char* format, double time) {
  return guarded(
      [&] { save(given(model, "model").loaded, &given(path, "path"), format ? format : "ubs", time); });
}

ubs_status ubs_model_get_info(const ubs_model* model, ubs_model_info* info) {
  return guarded([&] {
    const LoadedModel& loaded = given(model, "model").loaded;
    ubs_model_info values{};
    values.dim = static_cast<std::uint32_t>(loaded.model.dim());
    values.groups = static_cast<std::uint32_t>(loaded.model.groups.size());
    values.splats = loaded.model.count();
    values.parameters = loaded.model.parameters();
    std::ranges::copy(loaded.offset, values.offset);
    put_text(values.form, to_string(loaded.model.variant()));
    put(info, values, "info");
  });
}

ubs_status ubs_model_get_parameter(ubs_model* model, uint32_t group, uint32_t index,
                                   ubs_parameter* parameter) {
  return guarded([&] {
    std::vector<SplatModel>& groups = given(model, "model").loaded.model.groups;
    if (group >= groups.size())
      fail(ErrorKind::usage, "group {} does not exist: the model has {} groups of splats", group,
           groups.size());
    SplatModel& splats = groups[group];
    ubs_parameter values{};
    values.dim = static_cast<std::uint32_t>(splats.dim);
    values.splats = splats.count;
    std::uint32_t at = 0;
    for (const ParameterGroup& found : parameter_groups(splats.layout())) {
      if (found.count == 0 || at++ != index) continue;
      values.name = group_name(found.name);
      values.rows = static_cast<std::uint32_t>(found.count);
      values.values = splats.row(found.first).data();
    }
    put(parameter, values, "parameter");
  });
}

ubs_status ubs_model_get_settings(const ubs_model* model, ubs_settings** settings) {
  return made(settings, [&] {
    const LoadedModel& loaded = given(model, "model").loaded;
    auto made_of = std::make_unique<ubs_settings>();
    made_of->values = noted_settings(loaded.notes, "the model");
    made_of->values.dim = loaded.model.dim();
    made_of->values.variant = loaded.model.variant();
    return made_of;
  });
}
