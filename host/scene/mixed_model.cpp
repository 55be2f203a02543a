// SPDX-License-Identifier: Apache-2.0
#include "host/scene/mixed_model.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {

bool MixedModel::has_time() const {
  return std::ranges::any_of(groups, [](const SplatModel& group) { return ubs::has_time(group.dim); });
}

std::size_t MixedModel::count() const {
  std::size_t sum = 0;
  for (const SplatModel& group : groups) sum += group.count;
  return sum;
}

std::size_t MixedModel::parameters() const {
  std::size_t sum = 0;
  for (const SplatModel& group : groups) sum += group.values.size();
  return sum;
}

const SplatModel& MixedModel::single(std::string_view what) const {
  if (mixed())
    fail(ErrorKind::usage,
         "{}: the model contains splats of different dimensions ({}), but this command only supports models "
         "whose splats all have the same N",
         what, to_string(*this));
  return groups.front();
}

std::string to_string(const MixedModel& model) {
  std::string text;
  if (!model.mixed()) return fmt::format("N = {}, {} splats", model.dim(), model.count());
  for (const SplatModel& group : model.groups)
    text += fmt::format("{}{} with N = {}", text.empty() ? "" : ", ", group.count, group.dim);
  return fmt::format("{} splats: {}", model.count(), text);
}

void check_groups(const MixedModel& model) {
  if (model.groups.empty()) fail(ErrorKind::internal, "the model has no groups of splats");
  for (std::size_t g = 0; g < model.groups.size(); ++g) {
    if (!(model.groups[g].variant == model.variant()))
      fail(ErrorKind::internal, "the groups of the model have different variants: '{}' and '{}'",
           to_string(model.variant()), to_string(model.groups[g].variant));
    for (std::size_t other = 0; other < g; ++other)
      if (model.groups[other].dim == model.groups[g].dim)
        fail(ErrorKind::internal, "the model has two groups with N = {}", model.groups[g].dim);
  }
}

}  // namespace ubs
