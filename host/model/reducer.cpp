// SPDX-License-Identifier: Apache-2.0
// See reducer.hpp.
#include "host/model/reducer.hpp"

#include <algorithm>

#include "host/base/parallel.hpp"

namespace ubs::reduce {
namespace {

constexpr std::size_t kBlock = 256;  // splats per task of parallel_for()

// Position of a splat in the model: its group, and its index in the group.
struct Place {
  std::size_t group, splat;
};

std::vector<Place> places_of(const MixedModel& model) {
  std::vector<Place> places;
  for (std::size_t g = 0; g < model.groups.size(); ++g)
    for (std::size_t i = 0; i < model.groups[g].count; ++i) places.push_back({g, i});
  return places;
}

// Collected holds the splats of the new model that have the same number of dimensions.
struct Collected {
  std::vector<std::uint32_t> sources;  // index of each splat in the original model
  std::vector<float> values;           // parameters; those of one splat are contiguous
};

SplatModel assemble(int dim, const ModelVariant& variant, const Collected& collected) {
  SplatModel model(dim, collected.sources.size(), variant);
  const auto rows = static_cast<std::size_t>(model.layout().count);
  for (std::size_t i = 0; i < model.count; ++i)
    for (std::size_t r = 0; r < rows; ++r) model.values[r * model.count + i] = collected.values[i * rows + r];
  return model;
}

}  // namespace

Reducer::Reducer(const MixedModel& model, const std::vector<Camera>& cameras,
                 const Contributions& contributions, double eps2d, double worst)
    : model_(model), contributions_(contributions), replacements_(model.count()) {
  const std::vector<Place> places = places_of(model);
  parallel_for((places.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    std::vector<float> weights(cameras.size());
    const std::size_t end = std::min(places.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      if (!(contributions.most[i] > 0)) continue;  // removed in any case
      for (std::size_t v = 0; v < cameras.size(); ++v) weights[v] = contributions.view(v)[i];
      replacements_[i] = ubs::reduce::replacements(model.groups[places[i].group], places[i].splat,
                                                   {cameras, weights, eps2d}, worst);
    }
  });
}

Reduced Reducer::reduce(double bound, const ReduceChoice& choice) const {
  Reduced out;
  const std::vector<Place> places = places_of(model_);
  out.new_index.assign(places.size(), kGone);
  out.turned.assign(places.size(), 0);
  std::map<int, Collected, std::greater<>> groups;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const float most = contributions_.most[i];
    if (choice.splats && !(most > bound)) {
      ++(most > 0 ? out.dropped : out.unseen);
      continue;
    }
    const SplatModel& group = model_.groups[places[i].group];
    const Replacement* chosen = nullptr;
    if (choice.dimensions)
      for (const Replacement& candidate : replacements_[i]) {
        const bool fits = candidate.effect.exact || (bound > 0 && candidate.effect.change <= bound);
        if (!fits || candidate.values.empty()) continue;
        chosen = &candidate;
        break;
      }
    Collected& to = groups[chosen ? chosen->dim : group.dim];
    to.sources.push_back(static_cast<std::uint32_t>(i));
    if (chosen) {
      to.values.insert(to.values.end(), chosen->values.begin(), chosen->values.end());
      ++(chosen->effect.exact ? out.inert : out.turned_count);
      out.turned[i] = 1;
    } else {
      for (int r = 0; r < group.layout().count; ++r) to.values.push_back(group.row(r)[places[i].splat]);
    }
  }
  out.model.groups.clear();
  std::uint32_t index = 0;
  for (const auto& [dim, collected] : groups) {
    out.model.groups.push_back(assemble(dim, model_.variant(), collected));
    for (const std::uint32_t source : collected.sources) out.new_index[source] = index++;
  }
  if (out.model.groups.empty()) out.model.groups.emplace_back(model_.dim(), 0, model_.variant());
  return out;
}

}  // namespace ubs::reduce
