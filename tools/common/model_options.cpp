// SPDX-License-Identifier: Apache-2.0
#include "tools/common/model_options.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/formats/other_programs.hpp"
#include "host/formats/splat_file.hpp"
#include "host/look/report/run_record.hpp"
#include "host/run/open_data.hpp"
#include "host/run/same_run.hpp"
#include "host/settings/fields.hpp"
#include "host/train/checkpoint.hpp"
#include "tools/common/job.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_folder.hpp"

namespace ubs::tools {
namespace {

// Returns keys and values of the settings that determine what is read from the data of a run. This excludes
// settings that may change when a run is resumed.
std::vector<std::pair<std::string_view, std::string>> reading_of(TrainSettings settings) {
  std::vector<std::pair<std::string_view, std::string>> values;
  for (const FieldValue& field : bind_fields(settings, train_fields()))
    if ((field.uses & kOfReading) && !(field.uses & kFreeOnResume))
      values.emplace_back(field.key, field_text(field));
  return values;
}

// Sets the settings of a run that only the user may set. If the user has named the same folder of images as
// the run, it may be outside of the data folder.
void take_from_user(TrainSettings& settings, TrainSettings given) {
  const std::vector<FieldValue> from = bind_fields(given, train_fields());
  const std::vector<FieldValue> to = bind_fields(settings, train_fields());
  for (std::size_t i = 0; i < to.size(); ++i)
    if (to[i].uses & kOfUser) set_field(to, to[i].key, field_text(from[i]), "settings");
  if (given.chosen.contains("images") && given.images == settings.images) settings.chosen.insert("images");
}

// The user may have passed a data folder instead of a model. Returns a hint that names the run that 'ubs
// train' wrote next to this folder, or an empty string if there is no such run.
std::string run_beside(std::filesystem::path folder) {
  if (!folder.has_filename()) folder = folder.parent_path();  // after a trailing slash
  const std::filesystem::path run = folder.string() + "-ubs";
  if (!path_exists(RunFolder(run).model())) return "";
  return fmt::format("; did you mean {}, which was trained on it?", shell_word(run.string()));
}

}  // namespace

ModelOptions::ModelOptions(CLI::App& app, std::vector<std::string_view> keys)
    : settings(app, std::move(keys)) {
  add_model_option(app, "model,--model", model)->required();
  app.add_option("data,--data", data, fmt::format("data folder ({}) or packed file", layout_titles()))
      ->type_name("DIR|FILE");
  split_option_ = app.add_option("--split", split, "train, val or test [test]")->type_name("NAME");
  add_device_option(app, device);
}

LoadedModel ModelOptions::load() const {
  settings.resolve();
  if (split_given() && data.empty())
    fail(ErrorKind::usage, "--split requires a data folder: pass it after the model");
  return open_model(model);
}

std::filesystem::path model_in_folder(const std::filesystem::path& folder) {
  const std::filesystem::path model = find_splat_model(folder);
  const TrainerOutput output = trainer_output(folder);
  if (!output.models.empty() && model == output.models.back() && ranks().first())
    remark("ubs: output folder of {}: using {}{}\n", output.program, model.string(),
           output.models.size() > 1 ? fmt::format(", the last of {} models", output.models.size()) : "");
  return model;
}

void add_device_option(CLI::App& app, std::string& device) {
  app.add_option("--device", device,
                 "index, cpu, gpu, cuda, opencl, or part of a name, as listed by 'ubs devices'; cuda:1 and "
                 "opencl:NAME search one back end only [UBS_DEVICE, otherwise the first GPU]")
      ->type_name("DEVICE");
}

CLI::Option* add_model_option(CLI::App& app, const std::string& name, std::string& model,
                              const std::string& help) {
  return app.add_option(name, model, help)
      ->type_name("FILE|DIR")
      ->transform(CLI::Validator(
          [](std::string& path) -> std::string {
            if (!is_folder(path)) return {};
            const RunFolder run(path);
            const std::filesystem::path model = model_in_folder(path);
            if (const std::string what = model.empty() ? describe_splat_folder(path) : ""; !what.empty())
              return fmt::format("{}: {}", path, what);
            if (model.empty())
              return fmt::format(
                  "{}: no model.ply in this folder{}", path,
                  path_exists(run.checkpoint()) ? "; the run is not finished" : run_beside(path));
            path = model.string();
            return {};
          },
          ""));
}

void read_as(TrainSettings& settings, const RunData& run) {
  if (!run.settings) return;
  const std::vector<FieldValue> fields = bind_fields(settings, train_fields());
  for (const auto& [key, value] : reading_of(*run.settings))
    set_field(fields, key, value, "settings of the run");
  settings.run_cameras = run.settings->run_cameras;
}

RunData use_run_data(const std::string& model, std::string& data, const TrainSettings& given) {
  const std::filesystem::path folder = std::filesystem::path(model).parent_path();
  const bool in_run = !model.empty() && path_exists(RunFolder(folder).metrics());
  if (!in_run && !data.empty()) return {};
  if (!in_run && !path_exists(model)) fail(ErrorKind::data, "{}: no such file or folder", model);
  if (!in_run)
    fail(ErrorKind::usage,
         "no data folder given, and {} is not inside a run folder: pass the data folder after the model",
         model);
  RunRecord run = read_run(folder.empty() ? "." : folder, given.allow_outside);
  take_from_user(run.settings, given);
  const std::optional<std::uint32_t> print = run.data_print();
  RunData result{run.settings, {}};
  const auto trained_on = [&](const std::filesystem::path& place) {
    result.opened = open_undecoded(place, run.settings);
    return has_fingerprint(result.opened->data, *print);
  };
  if (!data.empty()) {
    try {
      if (!print || !trained_on(data)) return {};
    } catch (const std::exception&) {  // other data; the code that uses them reports the error
      return {};
    }
    if (reading_of(run.settings) != reading_of({}) || !run.settings.run_cameras.empty())
      remark("ubs: {} is the data that the run was trained on, and is read with the settings of the run\n",
             data);
    return result;
  }
  const std::string named = run.text({"data"});
  if (named.empty())
    fail(ErrorKind::data,
         "{}: does not name the data folder of the run: pass the data folder after the model",
         RunFolder(folder).metrics().string());
  if (!print)
    fail(ErrorKind::data,
         "{}: contains no fingerprint of the data, so '{}' may be other data than those of the run: pass the "
         "data folder after the model",
         RunFolder(folder).metrics().string(), named);
  std::string why = "does not exist";
  for (const std::filesystem::path& place : data_places(named, run.text({"data_from_run"}), run.folder)) {
    if (!path_exists(place)) continue;
    why = "contains other cameras, names or images than the data that the run was trained on";
    try {
      if (!trained_on(place)) continue;
    } catch (const std::exception& exception) {  // not the data of the run, which may be at the next place
      const Error error = as_error(exception);
      if (error.kind() != ErrorKind::data) throw;
      why = fmt::format("cannot be used ({})", error.what());
      continue;
    }
    data = place.string();
    remark("ubs: data of the run: {}\n", data);
    return result;
  }
  fail(ErrorKind::data, "the data folder of the run ('{}') {}: pass the data folder after the model", named,
       why);
}

TrainSettings drawing_settings(const SettingsOptions& options, const LoadedModel& model,
                               const std::string& path, const RunData& run) {
  TrainSettings base = noted_settings(model.notes, path);
  read_as(base, run);
  const std::vector<FieldValue> fields = bind_fields(base, train_fields());
  TrainSettings settings = options.resolve(base);
  if (settings.background.learnt != Background::Learnt::no) settings.background = base.background;
  const std::vector<FieldValue> chosen = bind_fields(settings, train_fields());
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const bool noted = std::ranges::any_of(model.notes.drawing,
                                           [&](const auto& note) { return note.first == fields[i].key; });
    if (const std::string now = field_text(chosen[i]), then = field_text(fields[i]); noted && now != then)
      remark("ubs: rendering with {} = {}, but the model was trained with {}\n", fields[i].key, now, then);
  }
  return settings;
}

}  // namespace ubs::tools
