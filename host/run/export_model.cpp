// SPDX-License-Identifier: Apache-2.0
#include "host/run/export_model.hpp"

#include <fmt/ranges.h>

#include <cmath>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/data/gaussian_model.hpp"

namespace ubs {
namespace {

constexpr const char* kLobesLost = "the spherical Beta lobes are lost: the format has no place for them";

}  // namespace

ImportedSplats foreign_splats(const std::string& format, const MixedModel& model,
                              const std::array<double, 3>& offset, const ReduceOptions& options,
                              std::vector<std::string>& remarks) {
  if (!std::isfinite(options.time)) fail(ErrorKind::usage, "time = {} is not finite", options.time);
  if (format == "dbs") {
    if (model.groups.size() > 1 || model.groups[0].dim != 3 || model.variant().kernel != SpatialKernel::beta)
      fail(ErrorKind::usage, "a DBS file holds Beta splats of N = 3: this model has {}, {}", to_string(model),
           to_string(model.variant()));
    ImportedSplats splats = foreign_splats(model.groups[0]);
    splats.offset = offset;
    return splats;
  }
  std::size_t exact = 0;
  for (const SplatModel& group : model.groups) exact += is_gaussian_model(group);
  if (exact > 0)
    remarks.push_back(exact < model.groups.size() ? "N = 3: Gaussians as they are" : "Gaussians as they are");
  if (exact < model.groups.size())
    remarks.push_back(fmt::format("time {}, opacity over directions: {}", options.time, options.opacity));
  std::optional<ImportedSplats> splats;
  for (const SplatModel& group : model.groups) {
    ImportedSplats part = is_gaussian_model(group) ? foreign_splats(group) : reduce_splats(group, options);
    part.lobes = 0;
    part.sb.clear();
    if (splats)
      append(*splats, part);
    else
      splats = std::move(part);
  }
  splats->offset = offset;
  if (model.variant().lobes() > 0) remarks.push_back(kLobesLost);
  for (const auto& s : splats->report.skipped)
    remarks.push_back(fmt::format("{} dropped: {}", s.count, s.why));
  return std::move(*splats);
}

void write_foreign(const std::string& format, const std::filesystem::path& path,
                   const ImportedSplats& splats) {
  if (format == "3dgs" || format == "dbs") return write_gaussian_ply(path, splats);
  if (format == "glb") return write_glb(path, splats);
  if (splats.offset != std::array<double, 3>{})
    warn("{}: the offset {} is lost: this format has no place for it", path.string(),
         fmt::join(splats.offset, " "));
  if (format == "spz") return write_spz(path, splats);
  if (format == "sog") return write_sog(path, splats);
  if (format == "splat") return write_splat32(path, splats);
  fail(ErrorKind::usage, "there is no format '{}': ubs, 3dgs, dbs, spz, sog, glb or splat", format);
}

std::vector<std::string> format_remarks(const std::string& format, const ImportedSplats& splats) {
  std::vector<std::string> remarks = format == "spz" ? spz_remarks(splats) : std::vector<std::string>{};
  if (format == "splat" && splats.sh_degree > 0)
    remarks.push_back(
        fmt::format("harmonics of degree 1 to {} are lost: .splat has one colour a splat", splats.sh_degree));
  if (format != "dbs" && splats.lobes > 0) remarks.push_back(kLobesLost);
  if (format != "spz" && format != "sog" && splats.antialiased)
    remarks.push_back(
        "draw it with antialiasing: the format cannot say that the splats were trained with it");
  return remarks;
}

}  // namespace ubs
