// SPDX-License-Identifier: Apache-2.0
#include "host/model/export_model.hpp"

#include <cmath>
#include <optional>

#include "host/base/error.hpp"
#include "host/formats/gaussian_model.hpp"

namespace ubs {

ImportedSplats exported_splats(const SplatFormat& format, const MixedModel& model,
                               const std::array<double, 3>& offset, const ReduceOptions& options,
                               std::vector<std::string>& remarks) {
  if (!std::isfinite(options.time)) fail(ErrorKind::usage, "time = {} is not finite", options.time);
  if (format.holds == SplatFormat::Holds::beta) {
    if (model.groups.size() > 1 || model.groups[0].dim != 3 || model.variant().kernel != SpatialKernel::beta)
      fail(ErrorKind::usage, "{} stores Beta splats of N = 3, but this model has {}, {}", format.title,
           to_string(model), to_string(model.variant()));
    ImportedSplats splats = to_imported_splats(model.groups[0]);
    splats.offset = offset;
    return splats;
  }
  std::size_t exact = 0;
  for (const SplatModel& group : model.groups) exact += is_gaussian_model(group);
  if (exact > 0)
    remarks.push_back(exact < model.groups.size() ? "N = 3: Gaussians are exported exactly"
                                                  : "Gaussians are exported exactly");
  if (exact < model.groups.size())
    remarks.push_back(fmt::format("{}rule for the opacity over all view directions: {}",
                                  model.has_time() ? fmt::format("exported for time {}; ", options.time) : "",
                                  options.opacity));
  std::optional<ImportedSplats> splats;
  for (const SplatModel& group : model.groups) {
    ImportedSplats part =
        is_gaussian_model(group) ? to_imported_splats(group) : reduce_splats(group, options);
    part.lobes = 0;
    part.sb.clear();
    if (splats)
      append(*splats, part);
    else
      splats = std::move(part);
  }
  splats->offset = offset;
  if (model.variant().lobes() > 0) remarks.push_back(kLobesLost);
  if (splats->count() == 0 && model.count() > 0)
    fail(ErrorKind::data, "none of the {} splats can be exported: {}", model.count(),
         splats->report.skipped.empty() ? "they are invisible" : splats->report.skipped.front().why);
  for (const auto& s : splats->report.skipped)
    remarks.push_back(fmt::format("{} dropped: {}", s.count, s.why));
  return std::move(*splats);
}

}  // namespace ubs
