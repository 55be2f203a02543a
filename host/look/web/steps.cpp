// SPDX-License-Identifier: Apache-2.0
// See steps.hpp.
#include "host/look/web/steps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"
#include "host/look/report/page_picture.hpp"
#include "host/model/decompose.hpp"
#include "host/model/picture.hpp"
#include "host/pipeline/image_gradient.hpp"

namespace ubs::web {
namespace {

constexpr std::size_t kSensitiveViews = 48;  // maximum number of views that H (steps.hpp) is estimated from
constexpr int kTrials = 6;                   // maximum number of trials to scale the steps
constexpr double kNear = 0.25;               // the PSNR may exceed the goal by this [dB]
constexpr double kMinRest = 0.02;            // minimum of 1 - opacity when computing the importance
// Maximum size of the first level. A page up to the end of this level has about 300 KB, with Base64 encoding,
// the viewer, a hundred cameras and the poster.
constexpr std::size_t kFirstLevelBytes = 105000;
// If the poster has more bytes than this, its JPEG quality is lowered.
constexpr std::size_t kPosterBytes = 32000;

// Sensitivity contains H (steps.hpp) of each parameter, as one vector per group in the layout of the
// parameters.
struct Sensitivity {
  std::vector<std::vector<double>> squares;
  double values = 0;  // number of pixels times channels, summed over the views
};

// Estimates H for up to kSensitiveViews of the `views` cameras of the session.
Sensitivity sensitivity(ModelSession& session, std::size_t views) {
  const DeviceGroups& model = session.model();
  GroupBuffers gradients(session.device(), model, "gradients of images");
  ImageBackward backward(session.device(), session.stages(), session.renderer());
  Sensitivity out;
  out.squares.resize(model.groups().size());
  const std::size_t step = (views + kSensitiveViews - 1) / kSensitiveViews;
  for (std::size_t v = 0; v < views; v += step) {
    session.renderer().forward(model.view(), static_cast<std::uint32_t>(v), session.settings(), true);
    const ImageShape shape = session.renderer().shape();
    std::vector<float> signs(3 * static_cast<std::size_t>(shape.width) * shape.height);
    const CounterRandom random(v, 0);
    for (std::size_t i = 0; i < signs.size(); i += 32) {
      const std::uint32_t bits = random.bits(i, 0);
      for (std::size_t k = i; k < std::min(signs.size(), i + 32); ++k)
        signs[k] = bits >> (k - i) & 1 ? 1.0f : -1.0f;
    }
    backward.run({.rgb = signs}, gradients.view());
    out.values += static_cast<double>(signs.size());
    for (std::size_t g = 0; g < out.squares.size(); ++g) {
      const DeviceModel& group = model.groups()[g];
      const SplatModel gradient = download_rows(gradients[g], group.layout(), group.count(), group.stride());
      out.squares[g].resize(gradient.values.size());
      for (std::size_t i = 0; i < gradient.values.size(); ++i)
        out.squares[g][i] += static_cast<double>(gradient.values[i]) * gradient.values[i];
    }
  }
  return out;
}

// Returns the class k of each splat, whose steps are multiplied by 2^k. It depends on the effect of all
// parameters of the splat on the images.
std::vector<std::uint8_t> classes_of(const std::vector<double>& squares, std::size_t count,
                                     std::size_t rows) {
  std::vector<double> energy(count, 0.0);
  for (std::size_t r = 0; r < rows; ++r) {
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) sum += squares[r * count + i];
    for (std::size_t i = 0; i < count && sum > 0; ++i) energy[i] += squares[r * count + i] / sum;
  }
  std::vector<double> sorted = energy;
  std::vector<std::uint8_t> classes(count, 0);
  if (count == 0) return classes;
  const std::size_t high = count - 1 - count / 20;
  std::ranges::nth_element(sorted, sorted.begin() + static_cast<std::ptrdiff_t>(high));
  for (std::size_t i = 0; i < count; ++i) {
    const double times = energy[i] > 0 ? 0.5 * std::log2(sorted[high] / energy[i]) : kMaxStepClass;
    classes[i] =
        static_cast<std::uint8_t>(std::clamp(std::lround(times), 0l, static_cast<long>(kMaxStepClass)));
  }
  return classes;
}

// Returns the steps for which each row of parameters adds `share` to the squared error, summed over the
// images.
UbszSteps group_steps(const SplatModel& model, const std::vector<double>& squares, double share) {
  const std::size_t rows = static_cast<std::size_t>(model.layout().count), n = model.count;
  UbszSteps out{std::vector<double>(rows), classes_of(squares, n, rows)};
  std::vector<double> sums(rows, 0.0);
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < n; ++i) sums[r] += squares[r * n + i] * std::exp2(2.0 * out.classes[i]);
  sums[0] = sums[1] = sums[2] = (sums[0] + sums[1] + sums[2]) / 3;
  for (std::size_t r = 0; r < rows; ++r) {
    const auto [low, high] =
        n > 0 ? std::ranges::minmax(model.row(static_cast<int>(r))) : std::ranges::min_max_result<float>{};
    const double range = std::max(1e-6, static_cast<double>(high) - low);
    out.steps[r] = sums[r] > 0 ? std::min(range, std::sqrt(12 * share / sums[r])) : range;
  }
  if (rows > 0)
    out.steps[0] = out.steps[1] = out.steps[2] = std::min({out.steps[0], out.steps[1], out.steps[2]});
  return out;
}

// Returns the PSNR between the images of two models, which the session renders.
ViewPsnr compare_models(ModelSession& session, const MixedModel& exact, const MixedModel& other,
                        std::size_t views) {
  std::vector<std::vector<float>> pictures;
  ViewPsnr out{0, std::numeric_limits<double>::infinity()};
  const auto draw = [&](std::size_t v) {
    session.renderer().forward(session.model().view(), static_cast<std::uint32_t>(v), session.settings(),
                               false);
    return session.renderer().download().rgb;
  };
  constexpr std::size_t kHeld = 16;  // number of exact images in memory
  for (std::size_t first = 0; first < views; first += kHeld) {
    const std::size_t end = std::min(views, first + kHeld);
    pictures.clear();
    session.choose(exact);
    for (std::size_t v = first; v < end; ++v) pictures.push_back(draw(v));
    session.choose(other);
    for (std::size_t v = first; v < end; ++v) {
      const std::vector<float> picture = draw(v), &truth = pictures[v - first];
      double sum = 0;
      for (std::size_t i = 0; i < picture.size(); ++i) {
        const double d = std::clamp(picture[i], 0.0f, 1.0f) - std::clamp(truth[i], 0.0f, 1.0f);
        sum += d * d;
      }
      const double psnr = -10 * std::log10(std::max(1e-12, sum / static_cast<double>(picture.size())));
      out.mean += psnr / static_cast<double>(views);
      out.worst = std::min(out.worst, psnr);
    }
  }
  session.choose(exact);
  return out;
}

MixedModel rounded_groups(const MixedModel& model, const std::vector<UbszSteps>& steps) {
  MixedModel out{std::vector<SplatModel>{}};
  for (std::size_t g = 0; g < model.groups.size(); ++g)
    out.groups.push_back(ubs::rounded(model.groups[g], steps[g]));
  return out;
}

// Returns the splats sorted by importance, the most important first. The importance is an estimate of the
// squared error that removing the splat causes in the pixels. The estimate assumes that the pixels are linear
// in the opacity o, whose derivative with respect to its raw value is o (1 - o).
std::vector<std::size_t> by_importance(const MixedModel& model, const Sensitivity& h) {
  std::vector<double> losses;
  for (std::size_t g = 0; g < model.groups.size(); ++g) {
    const SplatModel& group = model.groups[g];
    const int row = group.layout().opacity;
    for (std::size_t i = 0; i < group.count; ++i) {
      const double rest = 1 / (1 + std::exp(static_cast<double>(group.row(row)[i])));
      losses.push_back(h.squares[g][static_cast<std::size_t>(row) * group.count + i] /
                       std::pow(std::max(rest, kMinRest), 2));
    }
  }
  std::vector<std::size_t> order(losses.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return losses[a] > losses[b]; });
  return order;
}

UbszLevel level_of(const MixedModel& model, const std::vector<UbszSteps>& steps,
                   std::span<const std::size_t> splats) {
  std::vector<bool> keep(model.count(), false);
  for (const std::size_t i : splats) keep[i] = true;
  UbszLevel level{keep_splats(model, keep), {}, 0};
  std::size_t splat = 0;
  for (std::size_t g = 0; g < model.groups.size(); ++g) {
    UbszSteps part{steps[g].steps, {}};
    for (const std::uint8_t k : steps[g].classes)
      if (keep[splat++]) part.classes.push_back(k);
    if (!part.classes.empty()) level.steps.push_back(std::move(part));
  }
  return level;
}

// Divides the model into levels. Each level has three times as many splats as all levels before it. If the
// first level does not fit into kFirstLevelBytes, splats are moved from it to the second level.
std::vector<UbszLevel> make_levels(const MixedModel& model, const std::vector<UbszSteps>& steps,
                                   const std::vector<std::size_t>& order, std::size_t all_bytes, int levels) {
  std::vector<UbszLevel> out;
  std::size_t begin = 0;
  for (int k = 0; k < levels && begin < order.size(); ++k) {
    std::size_t end = order.size() >> 2 * (levels - 1 - k);
    if (k == 0) end = std::min(end, order.size() * kFirstLevelBytes / std::max<std::size_t>(1, all_bytes));
    if (end <= begin) continue;
    const auto part = [&] { return level_of(model, steps, std::span(order).subspan(begin, end - begin)); };
    out.push_back(part());
    while (k == 0 && end > 1 && pack_ubsz_levels(out, {}).bytes.size() > kFirstLevelBytes) {
      end = end * 9 / 10;
      out.back() = part();
    }
    begin = end;
  }
  return out;
}

std::vector<UbszSteps> choose_steps(ModelSession& session, const MixedModel& model, std::size_t views,
                                    const Sensitivity& h, double psnr,
                                    const std::function<MixedModel(const std::vector<UbszSteps>&)>& round,
                                    const std::function<void(const std::string&)>& note) {
  std::size_t rows = 0;
  for (const SplatModel& group : model.groups) rows += static_cast<std::size_t>(group.layout().count);
  // The PSNR that is estimated from H differs from the actual PSNR by an amount that usually changes slowly.
  // So the second trial shifts the estimate by this amount. If the PSNR rises less than the estimate, this
  // shift is too small, so it is doubled from trial to trial. If there are trials below and above the goal,
  // the next trial interpolates between them instead.
  struct Trial {
    double estimate = 0, got = 0;  // estimated and actual PSNR [dB]
  };
  const double goal = psnr + kNear / 2;
  std::optional<Trial> low, high;  // the nearest trials below and above the goal
  double estimate = goal, best_got = std::numeric_limits<double>::infinity(), most = 0;
  std::vector<UbszSteps> steps, best;
  for (int trial = 0; trial < kTrials; ++trial) {
    const double share = std::pow(10.0, -estimate / 10) * h.values / static_cast<double>(rows);
    steps.clear();
    for (std::size_t g = 0; g < model.groups.size(); ++g)
      steps.push_back(group_steps(model.groups[g], h.squares[g], share));
    const double got = compare_models(session, model, round(steps), views).mean;
    note(fmt::format("compressing, attempt {} of at most {}: PSNR {:.2f} dB (goal: {:g} to {:g} dB)",
                     trial + 1, kTrials, got, psnr, psnr + kNear));
    most = std::max(most, got);
    if (got >= psnr && got < best_got) best = steps, best_got = got;
    if (got >= psnr && got <= psnr + kNear) break;
    (got < goal ? low : high) = {estimate, got};
    estimate = low && high
                   ? std::lerp(low->estimate, high->estimate, (goal - low->got) / (high->got - low->got))
                   : estimate + std::exp2(trial) * (goal - got);
  }
  if (best.empty())
    fail(ErrorKind::usage,
         "cannot compress the model to {} dB, only to {:.2f} dB: lower --psnr or pass --exact", psnr, most);
  return best;
}

}  // namespace

PackedForWeb pack_for_web(std::shared_ptr<Device> device, const MixedModel& model,
                          const std::vector<std::string>& comments, const std::vector<Camera>& cameras,
                          const TrainSettings& settings, double psnr, int levels,
                          const std::function<void(const std::string&)>& note) {
  ModelSession session(std::move(device), model, settings, false, true);
  session.renderer().set_cameras(cameras);
  note(fmt::format("measuring the effect of each parameter on {} views",
                   std::min(cameras.size(), kSensitiveViews)));
  const Sensitivity h = sensitivity(session, cameras.size());
  if (levels == 1) {
    const auto round = [&](const std::vector<UbszSteps>& steps) { return rounded_groups(model, steps); };
    const std::vector<UbszSteps> steps = choose_steps(session, model, cameras.size(), h, psnr, round, note);
    return {
        pack_ubsz(model, comments, steps), compare_models(session, model, round(steps), cameras.size()), {}};
  }
  const std::vector<std::size_t> order = by_importance(model, h);
  const auto parts_of = [&](const std::vector<UbszSteps>& steps) {
    return make_levels(model, steps, order, pack_ubsz(model, {}, steps).size(), levels);
  };
  const auto drawn_of = [](std::span<const UbszLevel> parts) {
    return unpack_ubsz(pack_ubsz_levels(parts, {}).bytes, "levels");
  };
  const auto round = [&](const std::vector<UbszSteps>& steps) { return drawn_of(parts_of(steps)); };
  std::vector<UbszLevel> parts = parts_of(choose_steps(session, model, cameras.size(), h, psnr, round, note));
  PackedForWeb out;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const MixedModel drawn = drawn_of(std::span(parts).first(k + 1));
    out.levels.push_back({0, drawn.count(), compare_models(session, model, drawn, cameras.size())});
    parts[k].psnr = out.levels.back().psnr.mean;
  }
  out.psnr = out.levels.back().psnr;
  UbszParts packed = pack_ubsz_levels(parts, comments);
  for (std::size_t k = 0, end = 0; k < parts.size(); ++k) out.levels[k].bytes = end += packed.sizes[k];
  out.bytes = std::move(packed.bytes);
  return out;
}

Image8 draw_poster(const std::shared_ptr<Device>& device, const MixedModel& model,
                   const TrainSettings& settings, const Camera& camera) {
  ModelSession session(device, model, settings, false);
  session.renderer().set_cameras({camera});
  session.renderer().forward(session.model().view(), 0, session.settings(), false);
  return picture(session.renderer().download(), Channel::rgb);
}

std::string poster_uri(const Image8& still) { return page_picture(still, kLongestPoster, kPosterBytes); }

}  // namespace ubs::web
