// SPDX-License-Identifier: Apache-2.0
#include "host/train/trained_splats.hpp"

#include <utility>

#include "host/base/error.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs {
namespace {

// Downloads rows, which start every `stride` values on the device, into compact rows of `count` values.
// upload_compact() does the reverse and fills the padding with zeros.
std::vector<float> download_compact(const Buffer<float>& buffer, std::uint32_t stride, std::uint32_t count) {
  const std::size_t rows = buffer.size() / stride;
  std::vector<float> values(rows * count);
  for (std::size_t r = 0; r < rows; ++r)
    buffer.download(std::span(values).subspan(r * count, count), r * stride);
  return values;
}

void upload_compact(Buffer<float>& buffer, std::uint32_t stride, std::uint32_t count,
                    std::span<const float> values) {
  const std::size_t rows = buffer.size() / stride;
  if (values.size() != rows * count)
    fail(ErrorKind::internal, "{} splats with {} parameters need {} moments, but there are {}", count, rows,
         rows * count, values.size());
  buffer.zero();
  for (std::size_t r = 0; r < rows; ++r) buffer.upload(values.subspan(r * count, count), r * stride);
}

}  // namespace

TrainedSplats::TrainedSplats(Device& device, Stages& stages, const SplatModel& initial, std::size_t capacity)
    : stages_(stages), model_(device, initial, capacity) {
  const std::size_t size =
      static_cast<std::size_t>(trained_rows(model_.layout(), stages.config().frozen)) * model_.stride();
  for (auto [buffer, label] : {std::pair{&v_params_, "parameter gradients"},
                               {&moment1_, "first moments"},
                               {&moment2_, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
}

std::uint32_t TrainedSplats::relocate(float spread, std::uint64_t seed, std::uint64_t iteration) {
  return stages_.relocate({.splats = view(),
                           .moment1 = moment1(),
                           .moment2 = moment2(),
                           .seed = seed,
                           .iteration = iteration,
                           .spread = spread});
}

void TrainedSplats::grow(std::uint32_t target, float spread, std::uint64_t seed, std::uint64_t iteration) {
  stages_.grow({.splats = view(),
                .target = target,
                .moment1 = moment1(),
                .moment2 = moment2(),
                .seed = seed,
                .iteration = iteration,
                .spread = spread});
  model_.set_count(target);
}

void TrainedSplats::save(TrainState& state, bool) const {
  state.model = model_.download();
  state.moment1 = download_compact(moment1_, model_.stride(), model_.count());
  state.moment2 = download_compact(moment2_, model_.stride(), model_.count());
}

void TrainedSplats::load(const TrainState& state) {
  model_.upload(state.model);
  upload_compact(moment1_, model_.stride(), model_.count(), state.moment1);
  upload_compact(moment2_, model_.stride(), model_.count(), state.moment2);
}

}  // namespace ubs
