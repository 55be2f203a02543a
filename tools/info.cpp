// SPDX-License-Identifier: Apache-2.0
// ubs info: describes the content of a model file, a data folder or a packed data set. Needs no device.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/packed.hpp"
#include "host/dataset/view_names.hpp"
#include "host/formats/splat_file.hpp"
#include "host/run/open_data.hpp"
#include "host/scene/doubles.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/mixed_model.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"
#include "kernels/math/elementary.h"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_folder.hpp"
#include "tools/train_start.hpp"

namespace ubs::tools {
namespace {

struct InfoOptions {
  explicit InfoOptions(CLI::App& app) : settings(app, keys_used(kOfReading)) {}
  SettingsOptions settings;
  std::string model;
  bool json = false;
};

struct Summary {
  double min = 0, mean = 0, max = 0;
};

Summary summarise(const SplatModel& model, int first_row, int rows) {
  const std::size_t size = static_cast<std::size_t>(rows) * model.count;
  if (size == 0) return {};
  const std::span values(model.row(first_row).data(), size);
  const auto [low, high] = std::ranges::minmax(values);
  double sum = 0;
  for (const float v : values) sum += v;
  return {low, sum / static_cast<double>(size), high};
}

// Returns the activated values of a parameter with `rows` rows for the splats of all groups, in increasing
// order. `row_of` returns the first row of the parameter in a layout.
template <typename Row, typename Activation>
std::vector<double> activated(const MixedModel& model, const Row& row_of, int rows,
                              const Activation& activation) {
  std::vector<double> values;
  for (const SplatModel& group : model.groups) {
    const int first = row_of(group.layout());
    for (int r = first; r < first + rows; ++r)
      for (const float raw : group.row(r)) values.push_back(activation(raw));
  }
  std::ranges::sort(values);
  return values;
}

Json bounds(const MixedModel& model) {
  Json low = Json::array(), high = Json::array();
  for (int axis = 0; axis < 3; ++axis) {
    double least = HUGE_VAL, most = -HUGE_VAL;
    for (const SplatModel& group : model.groups) {
      const Summary s = summarise(group, group.layout().xyz + axis, 1);
      least = std::min(least, s.min), most = std::max(most, s.max);
    }
    low.push_back(least);
    high.push_back(most);
  }
  return {{"min", low}, {"max", high}};
}

Json describe_parameters(const SplatModel& model) {
  Json groups = Json::object();
  for (const ParameterGroup& g : parameter_groups(model.layout())) {
    const Summary s = summarise(model, g.first, g.count);
    groups[g.name] = {{"count", g.count}, {"min", s.min}, {"mean", s.mean}, {"max", s.max}};
  }
  return groups;
}

// Returns whether a spatial scale is below its minimum share of the largest scale.
bool flat(const SplatModel& model, std::size_t splat) {
  const ParameterLayout l = model.layout();
  double scale[3];
  for (int c = 0; c < 3; ++c) scale[c] = ubs_softplus(model.row(l.scale + c)[splat]);
  const auto [least, most] = std::ranges::minmax(scale);
  const double part = l.variant.cov_param == CovParam::skew_nd    ? UBS_SKEW_SCALE_RELATIVE
                      : l.variant.cov_param == CovParam::cholesky ? UBS_NEEDLE_CHOLESKY
                                                                  : UBS_NEEDLE_RELATIVE;
  return least < part * most;
}

// Counts splats whose parameters are beyond a limit of the formulas (kernels/limits.h), and strongly coupled
// splats, for which the kernels use the second method of docs/method.md 2.3. For skew_nd and direct
// conditioning, only betas and spatial scales are counted.
Json describe_clamps(const MixedModel& model) {
  std::size_t beta = 0, spatial_scale = 0, query_scale = 0, coupled = 0;
  for (const SplatModel& group : model.groups) {
    const ParameterLayout l = group.layout();
    const bool block_triangular = l.variant.cov_param != CovParam::skew_nd && !l.variant.direct();
    const double least =
        l.variant.cov_mode == CovMode::whiten ? UBS_QUERY_SCALE_WHITEN : UBS_QUERY_SCALE_RELATIVE;
    for (std::size_t i = 0; i < group.count; ++i) {
      if (l.variant.has_spatial_beta() && !(group.row(l.beta)[i] < UBS_BETA_RAW_MAX)) ++beta;
      spatial_scale += flat(group, i);
      bool lifted = false, thin = false, weak = false;
      for (int q = 3; block_triangular && q < 3 + l.query; ++q) {
        double square = 0;
        for (int k = 0; k < q; ++k) {
          const double entry = group.row(l.l_triangle + q * (q - 1) / 2 + k)[i];
          square += entry * entry;
        }
        const double ratio = ubs_softplus(group.row(l.scale + q)[i]) / std::sqrt(square);
        lifted = lifted || ratio < least;
        if (!(ratio < UBS_COUPLED_RELATIVE)) continue;
        thin = true;
        weak = weak || (l.variant.beta_cond == BetaCond::on &&
                        group.row(l.query_beta + q - 3)[i] <= -UBS_COUPLED_WEIGHT);
      }
      query_scale += lifted, coupled += thin && !weak;
    }
  }
  return {
      {"beta", beta}, {"spatial_scale", spatial_scale}, {"query_scale", query_scale}, {"coupled", coupled}};
}

Json describe_model(const std::string& path) {
  const LoadedModel loaded = load_splat_model(path);
  const MixedModel& model = loaded.model;
  const ParameterLayout layout = model.groups.front().layout();
  const std::vector<double> opacity = activated(
      model, [](const ParameterLayout& l) { return l.opacity; }, 1,
      [](double raw) { return ubs_sigmoid(raw); });
  const std::vector<double> scale = activated(
      model, [](const ParameterLayout& l) { return l.scale; }, 3,
      [](double raw) { return ubs_softplus(raw); });
  const auto dead = std::ranges::upper_bound(opacity, UBS_OPACITY_DEAD) - opacity.begin();
  Json json{{"file", path},
            {"format", loaded.format->title},
            {"offset", loaded.offset},
            {"remarks", loaded.remarks},
            {"bytes", std::filesystem::file_size(path)},
            {"dim", model.dim()},
            {"variant", to_string(model.variant())},
            {"splats", model.count()},
            {"parameters_per_splat", layout.count},
            {"dead", dead},
            {"doubles", share_of_doubles(model)},
            {"clamped", describe_clamps(model)},
            {"bounds", bounds(model)},
            {"opacity_quantiles", quantiles_json(opacity)},
            {"scale_quantiles", quantiles_json(scale)},
            {"groups", describe_parameters(model.groups.front())},
            {"comments", loaded.comments},
            {"noted_cameras", loaded.notes.cameras.size()},
            {"dimensions", groups_json(model)}};
  for (std::size_t g = 1; g < model.groups.size(); ++g) {
    json["dimensions"][g]["parameters_per_splat"] = model.groups[g].layout().count;
    json["dimensions"][g]["groups"] = describe_parameters(model.groups[g]);
  }
  return json;
}

void print_parameters(const Json& groups) {
  say("raw parameters{:>13}{:>13}{:>13}\n", "min", "mean", "max");
  for (const auto& [name, g] : groups.items())
    if (g["count"].get<int>() > 0)
      say("  {:<10}{:>2}{:>13.5g}{:>13.5g}{:>13.5g}\n", name, g["count"].get<int>(), g["min"].get<double>(),
          g["mean"].get<double>(), g["max"].get<double>());
}

std::string quantile_text(const Json& quantiles) {
  std::string text;
  for (const auto& [key, value] : quantiles.items())
    text += fmt::format("  {} {:.4g}", key, value.is_null() ? NAN : value.get<double>());
  return text;
}

// Describes a data set: cameras and report. No images are decoded.
Json describe_data(const Dataset& data) {
  Json splits = Json::object();
  for (const Split& split : data.splits) {
    Json sizes = Json::array();
    std::set<std::pair<int, int>> seen;
    std::size_t masks = 0;
    for (const View& view : split.views) {
      if (seen.insert({view.camera.width, view.camera.height}).second)
        sizes.push_back({view.camera.width, view.camera.height});
      masks += view.masked;
    }
    splits[split.name] = {{"views", split.views.size()}, {"sizes", sizes}, {"masks", masks}};
  }
  const Split* train = data.find("train");
  Json json{{"layout", data.report.layout},
            {"splits", splits},
            {"points", data.points ? data.points->positions.size() : 0},
            {"offset", data.offset},
            {"extent", train && !train->views.empty() ? scene_extent(train->views) : 0.0}};
  json["report"] = report_json(data.report);
  return json;
}

Dataset open_data(const InfoOptions& options) {
  TrainSettings settings = options.settings.resolve();
  if (is_packed(options.model)) settings.background.colour = PackedFile(options.model).background();
  // The data are opened in the same way as for training, so that both commands print the same.
  return open_undecoded(options.model, settings).data;
}

// Adds the properties of a packed file.
void add_packed(const std::string& path, Json& json) {
  const auto file = std::make_shared<const PackedFile>(path);
  json["bytes"] = std::filesystem::file_size(path);
  json["background"] = file->background();
  json["downscale"] = file->downscale();
  for (const std::string& name : file->split_names()) {
    const Split split = PackedFile::split_on_demand(file, name);
    json["splits"][safe_file_name(name)]["images"] =
        std::ranges::count_if(split.views, [](const View& view) { return view.has_image(); });
  }
}

std::string numbers_text(const Json& values) {
  return fmt::format("{:.4g}", fmt::join(values.get<std::vector<double>>(), " "));
}

std::string sizes_text(const Json& sizes) {
  std::vector<std::string> words;
  for (const Json& size : sizes)
    words.push_back(fmt::format("{}x{}", size[0].get<int>(), size[1].get<int>()));
  return fmt::format("{}", fmt::join(words, ", "));
}

int run_data(const InfoOptions& options) {
  const Dataset data = open_data(options);
  const bool packed = data.report.layout == "packed";
  Json json = describe_data(data);
  if (packed) add_packed(options.model, json);
  if (options.json) {
    print_json(json);
    return 0;
  }
  print_report(data.report);
  for (const auto& [name, split] : json["splits"].items()) {
    say("{:<8} {} views of {}", name, split["views"].get<std::size_t>(), sizes_text(split["sizes"]));
    if (packed) say(", {} images", split["images"].get<std::size_t>());
    if (split["masks"] != 0) say(", {} masks", split["masks"].get<std::size_t>());
    say("\n");
  }
  say("points   {}\nextent   {:.6g}\noffset   {}\n", json["points"].get<std::size_t>(),
      json["extent"].get<double>(), numbers_text(json["offset"]));
  if (packed)
    say("packed   {:.2f} MiB, images composited on background {}, downscaled by a factor of {}\n",
        json["bytes"].get<double>() / (1 << 20), json["background"].dump(), json["downscale"].get<int>());
  return 0;
}

// Throws an error if the extension or the content shows that the file is neither a data set nor a model.
void check_file(const std::filesystem::path& path) {
  if (!is_regular(path)) return;
  refuse_pictures(path);
  if (small_extension(path) != ".ply" && small_extension(path) != ".json" && describe_file(path).empty() &&
      camera_files_in(path).empty())
    fail(ErrorKind::data,
         "{}: neither a data set nor a model: pass a data folder, a transforms file (.json), a packed data "
         "set (.ubsd) or a splat file ({})",
         path.string(), splat_format_titles());
}

int run(InfoOptions& options) {
  if (!is_packed(options.model)) check_file(options.model);
  const bool folder = is_folder(options.model);
  // A data folder may also contain splats, such as those that its points were made from. JSON files may be
  // both.
  const bool may_be_data =
      folder ? !path_exists(RunFolder(options.model).model()) : small_extension(options.model) != ".json";
  const bool data = may_be_data && !camera_files_in(options.model).empty();
  const std::filesystem::path model = is_packed(options.model) || data ? std::filesystem::path()
                                      : folder                         ? model_in_folder(options.model)
                                                                       : find_splat_model(options.model);
  if (model.empty() && path_exists(RunFolder(options.model).checkpoint()))
    fail(ErrorKind::data,
         "{}: no model.ply in this folder; the run is not finished: continue it with 'ubs train --resume {}'",
         options.model, shell_word(options.model));
  if (model.empty()) return run_data(options);
  options.settings.limit({""}, fmt::format("only applies to data, but {} is a model", options.model));
  const Json info = describe_model(model.string());
  if (options.json) {
    print_json(info);
    return 0;
  }
  const Json& dimensions = info["dimensions"];
  std::vector<int> dims;
  for (const Json& group : dimensions) dims.push_back(group["dim"].get<int>());
  say("{}: N = {}, {} splats, {:.2f} MiB{}\n", info["file"].get<std::string>(), fmt::join(dims, ", "),
      info["splats"].get<std::size_t>(), info["bytes"].get<double>() / (1 << 20),
      dims.size() > 1 ? "" : fmt::format(", {} parameters each", info["parameters_per_splat"].get<int>()));
  say("variant   {}\n", info["variant"].get<std::string>());
  say("bounds    {} to {}\n", numbers_text(info["bounds"]["min"]), numbers_text(info["bounds"]["max"]));
  say("dead      {} (opacity at most {})\n", info["dead"].get<long>(), UBS_OPACITY_DEAD);
  say("doubles   {:.1f} % of the live splats (practically equal to another one)\n",
      100 * info["doubles"].get<double>());
  const Json& clamped = info["clamped"];
  say("clamped   {} spatial betas, {} spatial scales, {} query scales; {} strongly coupled "
      "(docs/method.md 3.5)\n",
      clamped["beta"].get<std::size_t>(), clamped["spatial_scale"].get<std::size_t>(),
      clamped["query_scale"].get<std::size_t>(), clamped["coupled"].get<std::size_t>());
  say("opacity {}\nscale   {}\n", quantile_text(info["opacity_quantiles"]),
      quantile_text(info["scale_quantiles"]));
  for (std::size_t g = 0; g < dims.size(); ++g) {
    if (dims.size() > 1)
      say("group of N = {}: {} splats\n", dims[g], dimensions[g]["splats"].get<std::size_t>());
    print_parameters(g == 0 ? info["groups"] : dimensions[g]["groups"]);
  }
  if (info["format"] != splat_format("ubs").title) say("format    {}\n", info["format"].get<std::string>());
  for (const auto& remark : info["remarks"]) say("import    {}\n", remark.get<std::string>());
  if (info["noted_cameras"] > 0)
    say("seen by   {} training cameras listed in the file\n", info["noted_cameras"].get<std::size_t>());
  for (const auto& comment : info["comments"])
    if (const auto text = comment.get<std::string>(); text.starts_with("ubs_drawn "))
      say("rendering {}\n", text.substr(10));
    else if (!text.starts_with("ubs_"))
      say("comment   {}\n", text);
  return 0;
}

}  // namespace

Command add_info(CLI::App& root) {
  CLI::App* app = root.add_subcommand("info", "Describe a model, a data folder or a packed data set");
  const auto options = std::make_shared<InfoOptions>(*app);
  app->add_option("model", options->model,
                  "model of any format, run folder, data folder, nerfstudio JSON file or packed data set")
      ->required()
      ->type_name("PATH");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
