// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/memory_plan.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/slot_store.hpp"
#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

namespace sizes = stage_sizes;

constexpr double kWord = 4;
constexpr std::uint64_t kLossTile = 48;  // assumed width of a tile of the loss [px]; it depends on the device

std::uint64_t divide_up(std::uint64_t value, std::uint64_t by) { return (value + by - 1) / by; }

class Planner {
 public:
  explicit Planner(const MemoryQuestion& q)
      : q_(q), shape_{q.width, q.height}, stride_(row_stride(q.splats)) {}

  MemoryPlan plan() {
    splats();
    pixels();
    intersections();
    if (q_.training) loss();
    sorting();
    cameras();
    return std::move(plan_);
  }

 private:
  void add(const char* label, MemoryUnit unit, double each, std::uint64_t units) {
    plan_.items.push_back(
        {label, unit, each, static_cast<std::uint64_t>(each * static_cast<double>(units) + 0.5)});
  }
  void per_splat(const char* label, double each) { add(label, MemoryUnit::splat, each, stride_); }
  void per_pixel(const char* label, double each) { add(label, MemoryUnit::pixel, each, shape_.plane()); }
  void per_intersection(const char* label, double each) {
    add(label, MemoryUnit::intersection, each, q_.intersections);
  }
  void fixed(const char* label, std::uint64_t words) { add(label, MemoryUnit::fixed, kWord, words); }

  void splats() {
    const double rows = ParameterLayout(q_.dim, q_.variant).count;
    if (q_.groups.empty())
      per_splat("parameters", kWord * rows);
    else
      parameters_of_groups();
    if (q_.training) {
      const double learnt = q_.trained_rows >= 0 ? q_.trained_rows : rows;
      per_splat("parameter gradients", kWord * learnt);
      per_splat("first moments", kWord * learnt);
      per_splat("second moments", kWord * learnt);
      per_splat("splat gradients", kWord * int{kGradStride});
    }
    per_splat("projected splats", kWord * int{kSplatStride});
    per_splat("depth keys, tile rects and counts", kWord * 4);
    if (q_.training) per_splat("slot offsets", kWord);
    // The scratch memory of the depth sort depends on the back end. With fewer than kManySplats splats, CPUs
    // sort in two passes. The first pass writes pairs of a key and a splat index, and the second pass writes
    // only the indices, which takes 3 words per splat. With more splats, CPUs need more passes, which
    // alternate between two buffers of pairs and then write the indices. This takes 5 words, and so does
    // CUDA. OpenCL GPUs only need the two buffers of pairs, which take 4 words.
    const bool two_passes = q_.raster == RasterKind::cpu && few();
    const bool in_groups = q_.raster == RasterKind::gpu && !q_.sorts_by_copying;
    per_splat("depth sort: keys and splats", kWord * (two_passes ? 3 : in_groups ? 4 : 5));
    if (q_.training && q_.refinement) per_splat("mcmc weights, copies, sources, prefix", kWord * 4);
  }

  void parameters_of_groups() {
    double bytes = 0;
    for (const MemoryQuestion::Group& group : q_.groups)
      bytes += kWord * ParameterLayout(group.dim, q_.variant).count * row_stride(group.splats);
    plan_.items.push_back({"parameters", MemoryUnit::splat,
                           bytes / static_cast<double>(std::max<std::size_t>(q_.splats, 1)),
                           static_cast<std::uint64_t>(bytes)});
  }

  void pixels() {
    per_pixel("image and transmittance", kWord * 4);
    if (q_.depth) per_pixel("depth", kWord);
    if (q_.training) per_pixel("image gradient", kWord * 3);
    fixed("tile ranges", static_cast<std::uint64_t>(shape_.tiles()) + 1);
  }

  void intersections() {
    per_intersection("sorted splats", kWord);
    if (q_.training) {
      per_intersection("sorted slots", kWord);
      per_intersection("block masks", 2);
      per_intersection("gradient slots", kWord * stage_sizes::slot_floats(q_.raster));
      plan_.items.back().splits = true;
      if (q_.raster == RasterKind::gpu)
        per_intersection("list states", kWord * static_cast<double>(sizes::list_state_floats(kListSegment)) /
                                            int{kListSegment});
    }
    if (q_.raster == RasterKind::gpu)
      per_intersection("parts of long lists",
                       kWord * static_cast<double>(sizes::list_part_floats(q_.depth)) / (kListPart / 2));
    const double tile = shape_.tiles() <= sizes::kMaxNarrowTiles ? 2 : kWord;
    if (q_.sorts_by_copying)
      per_intersection("tile sort: 3 buffers of tile indices, 2 of splat indices", tile * 3 + kWord * 2);
    else if (q_.raster == RasterKind::gpu)
      per_intersection(q_.training ? "tile sort: 2 buffers of tile indices, 1 of splat indices, 1 of slots"
                                   : "tile sort: 2 buffers of tile indices, 1 of splat indices",
                       tile * 2 + kWord * (q_.training ? 2 : 1));
  }

  // Adds the buffers of the loss. The largest are the maps of the SSIM: three maps per channel, with a margin
  // around the image. CPUs compute large images one channel at a time and then only need the maps of one
  // channel.
  void loss() {
    const auto pitch = static_cast<std::uint64_t>(shape_.pitch()),
               rows = static_cast<std::uint64_t>(shape_.rows());
    const bool at_once = q_.raster == RasterKind::gpu || shape_.plane() <= sizes::kSmallImage;
    const std::uint64_t maps = 3 * (at_once ? 3 : 1);
    const std::uint64_t words = maps * (pitch + sizes::kMapMargin) * (rows + 2 * sizes::kLossRadius);
    const auto bytes = static_cast<double>(words) * kWord;
    add("loss maps", MemoryUnit::pixel, bytes / static_cast<double>(shape_.plane()), shape_.plane());
    fixed("loss tile sums", 12 * divide_up(pitch, kLossTile) * (rows / sizes::kLossTileRows));
    fixed("loss sums", 8 * q_.loss_rows);
    if (q_.learns_sky) fixed("sky sums", 27 * pitch * (rows / 16));
    if (q_.appearances > 0) {
      per_pixel("mapped image", kWord * 3);
      fixed("appearance sums", 12 * pitch * (rows / 16));
      fixed("appearance", 60 * q_.appearances);
    }
    fixed("learning rates", static_cast<std::uint64_t>(ParameterLayout(q_.dim, q_.variant).count));
  }

  // Adds the histograms of the sorts. The block sums of the prefix scans are not counted, because they are
  // thousands of times smaller than the inputs of the scans.
  void sorting() {
    const auto tiles = static_cast<std::uint64_t>(std::max(1, shape_.tiles()));
    if (q_.raster == RasterKind::gpu) {
      const std::uint64_t elements = std::max<std::uint64_t>(q_.intersections, q_.splats);
      fixed("sort histograms", divide_up(elements, sizes::kGroupBlock) << sizes::kRadixBits);
      per_splat("tile sort: first intersection of each splat", kWord);
      return;
    }
    const std::uint64_t most =
        std::min<std::uint64_t>(sizes::kMaxChunks, sizes::kChunksPerCore * q_.compute_units);
    const std::uint64_t worth = std::max<std::uint64_t>(1, q_.splats / sizes::kSmallestChunk);
    const std::uint64_t by_tiles =
        std::min({most, sizes::kMaxBins / tiles,
                  std::max<std::uint64_t>(q_.compute_units, q_.intersections / tiles), worth});
    const std::uint64_t bins = std::uint64_t{1} << (few() ? sizes::kDigitOfFew : sizes::kDigitOfMany);
    fixed("sort histograms", std::max(std::min(most, worth) * bins, by_tiles * tiles));
    fixed("places of bins", std::max(bins, tiles));
  }

  bool few() const { return q_.splats < sizes::kManySplats; }

  void cameras() {
    add("cameras", MemoryUnit::view, kWord * int{kCameraStride}, q_.views);
    if (q_.target_bytes > 0)
      plan_.items.push_back(
          {"target images", MemoryUnit::view,
           static_cast<double>(q_.target_bytes) / static_cast<double>(std::max<std::size_t>(1, q_.views)),
           q_.target_bytes});
  }

  const MemoryQuestion& q_;
  ImageShape shape_;
  std::uint64_t stride_;
  MemoryPlan plan_;
};

// Returns the bytes that the host needs while the state of a training run is saved: two copies of the
// parameters and moments. This matters on CPUs, where host and device share their memory. Returns 0 if the
// plan is not for training.
std::uint64_t saving_bytes(const MemoryPlan& plan) {
  std::uint64_t bytes = 0;
  bool training = false;
  for (const MemoryItem& item : plan.items) {
    training |= item.label == "first moments";
    if (item.label == "parameters" || item.label == "first moments" || item.label == "second moments")
      bytes += 2 * item.bytes;
  }
  return training ? bytes : 0;
}

}  // namespace

std::string_view to_string(MemoryUnit unit) {
  constexpr std::string_view kNames[] = {"splat", "pixel", "intersection", "view", "fixed"};
  return kNames[static_cast<std::size_t>(unit)];
}

std::uint64_t MemoryPlan::total() const {
  std::uint64_t bytes = 0;
  for (const MemoryItem& item : items) bytes += item.bytes;
  return bytes;
}

const MemoryItem& MemoryPlan::largest() const {
  return *std::ranges::max_element(items, {}, [](const MemoryItem& item) {
    return item.splits || item.unit == MemoryUnit::view ? 0 : item.bytes;
  });
}

double MemoryPlan::each(MemoryUnit unit) const {
  double bytes = 0;
  for (const MemoryItem& item : items)
    if (item.unit == unit) bytes += item.each;
  return bytes;
}

MemoryPlan plan_memory(const MemoryQuestion& question) { return Planner(question).plan(); }

std::string summary(const MemoryPlan& plan) {
  return fmt::format(
      "predicted {:.1f} MiB ({:.0f} B per splat, {:.0f} B per pixel, {:.0f} B per intersection)",
      static_cast<double>(plan.total()) / (1 << 20), plan.each(MemoryUnit::splat),
      plan.each(MemoryUnit::pixel), plan.each(MemoryUnit::intersection));
}

std::string memory_shortage(const MemoryPlan& plan, const DeviceInfo& device) {
  const MemoryItem& largest = plan.largest();
  if (largest.bytes > device.max_allocation_bytes)
    return fmt::format(
        "'{}' needs {} MiB, but {} allocates at most {} MiB in one buffer: use fewer splats or smaller "
        "images",
        largest.label, largest.bytes >> 20, device.name, device.max_allocation_bytes >> 20);
  for (const MemoryItem& item : plan.items) {
    if (!item.splits) continue;
    const auto slot_bytes = static_cast<std::uint64_t>(item.each);
    const std::uint64_t slots =
        SlotStore::most(device, static_cast<unsigned>(slot_bytes / sizeof(float))) * slot_bytes;
    if (item.bytes > slots)
      return fmt::format(
          "'{}' needs {} MiB, but {} has room for only {} MiB ({} MiB in one buffer): use fewer splats or "
          "smaller images",
          item.label, item.bytes >> 20, device.name, slots >> 20, device.max_allocation_bytes >> 20);
  }
  const std::string limits = memory_limits_text();
  const bool shared = device.type == DeviceType::cpu && !limits.empty();
  if (const std::uint64_t needed = plan.total() + (shared ? saving_bytes(plan) : 0);
      needed > device.memory_bytes)
    return fmt::format("the run needs {} MiB, but {} has {} MiB: use fewer splats or smaller images{}",
                       needed >> 20, device.name, device.memory_bytes >> 20, limits);
  return {};
}

void check_fits(const MemoryPlan& plan, const DeviceInfo& device) {
  const std::string why = memory_shortage(plan, device);
  if (!why.empty()) fail(ErrorKind::memory, "{}", why);
}

}  // namespace ubs
