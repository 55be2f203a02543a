// SPDX-License-Identifier: Apache-2.0
#include "tools/common/model_session.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/report/run_record.hpp"
#include "host/run/open_data.hpp"
#include "host/spec/settings.hpp"
#include "host/train/checkpoint.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_folder.hpp"

namespace ubs::tools {

ModelOptions::ModelOptions(CLI::App& app, std::vector<std::string_view> keys)
    : import(app), settings(app, std::move(keys)) {
  accept_run_folder(*app.add_option("model,--model", model, kModelHelp)->required()->type_name("FILE|DIR"));
  app.add_option("data,--data", data, "data folder (Blender, nerfstudio, COLMAP, LLFF, N3V) or packed file")
      ->type_name("DIR|FILE");
  split_option_ = app.add_option("--split", split, "train, val or test [test]")->type_name("NAME");
  add_device_option(app, device);
}

LoadedModel ModelOptions::load() const {
  settings.resolve();
  return open_model(model, import.options());
}

void add_device_option(CLI::App& app, std::string& device) {
  app.add_option("--device", device,
                 "index, cpu, gpu, cuda, opencl, or part of a name, as listed by 'ubs devices'; opencl:NAME "
                 "looks in one "
                 "back end only [UBS_DEVICE, else the first GPU]")
      ->type_name("DEVICE");
}

ImportChoice::ImportChoice(CLI::App& app) {
  app.add_option("--import", form_,
                 "files of other tools: exact, as Gaussians with harmonics, or beta, the published form with "
                 "the error "
                 "that this causes [exact]")
      ->check(CLI::IsMember({"exact", "beta"}))
      ->type_name("exact|beta");
  app.add_option("--support", support_,
                 "support radius / sigma with --import beta: 3.0 as published, 3.08 fits best [3.08]")
      ->type_name("RATIO");
}

ImportOptions ImportChoice::options(int dim) const {
  return {.form = form_ == "beta" ? ImportForm::beta : ImportForm::exact, .dim = dim, .support = support_};
}

void accept_run_folder(CLI::Option& option) {
  option.transform(CLI::Validator(
      [](std::string& path) -> std::string {
        if (!is_folder(path)) return {};
        const RunFolder run(path);
        if (!path_exists(run.model()))
          return fmt::format("{}: no model.ply in this folder{}", path,
                             path_exists(run.checkpoint()) ? "; the run is not finished" : "");
        path = run.model().string();
        return {};
      },
      ""));
}

std::optional<TrainSettings> use_run_data(const std::string& model, std::string& data) {
  if (!data.empty()) return {};
  const std::filesystem::path folder = std::filesystem::path(model).parent_path();
  if (!path_exists(RunFolder(folder).metrics()))
    fail(ErrorKind::usage, "which data? {} is not in the output folder of a run: name the data after it",
         model);
  const RunRecord run = read_run(folder.empty() ? "." : folder);
  TrainSettings reading = run.settings;
  reading.image_cache_mb = 1;  // three images are looked at
  const std::string named = run.text({"data"});
  const auto print = run.number({"data_print"});
  std::string why = "is gone";
  for (const std::filesystem::path& place : data_places(named, folder)) {
    if (!path_exists(place)) continue;
    Dataset set = open_dataset(place, {"train"}, reading, Images::load);
    why = "holds other cameras, names or images than the run was trained on";
    if (print && fingerprint(take_split(set, "train")) != static_cast<std::uint32_t>(*print)) continue;
    data = place.string();
    remark("ubs: data of the run: {}\n", data);
    return run.settings;
  }
  fail(ErrorKind::data, "the data folder of the run ('{}') {}: name the data after the model", named, why);
}

TrainSettings drawing_settings(const SettingsOptions& options, const LoadedModel& model,
                               const std::string& path, const std::optional<TrainSettings>& run) {
  TrainSettings base = noted_settings(model.notes, path);
  if (run) {
    base.downscale = run->downscale;
    base.layout = run->layout;
    base.images = run->images;
    base.principal_point = run->principal_point;
    base.test_every = run->test_every;
    base.first_frame = run->first_frame;
    base.frames = run->frames;
    base.frame_step = run->frame_step;
  }
  const std::vector<FieldValue> fields = bind_fields(base, train_fields());
  TrainSettings settings = options.resolve(base);
  const std::vector<FieldValue> chosen = bind_fields(settings, train_fields());
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const bool noted = std::ranges::any_of(model.notes.drawing,
                                           [&](const auto& note) { return note.first == fields[i].key; });
    if (const std::string now = field_text(chosen[i]), then = field_text(fields[i]); noted && now != then)
      remark("ubs: drawn with {} = {}; the model was learnt with {}\n", fields[i].key, now, then);
  }
  return settings;
}

}  // namespace ubs::tools
