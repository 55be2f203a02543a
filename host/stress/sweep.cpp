// SPDX-License-Identifier: Apache-2.0
#include "host/stress/sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <tuple>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/scene/splat_model.hpp"
#include "host/stress/sweep_cases.hpp"
#include "host/stress/sweep_kernels.hpp"
#include "host/stress/sweep_reference.hpp"
#include "kernels/layout.h"

namespace ubs::stress {
namespace {

constexpr double kSmallest = 1e-30;  // norms below this are zero to single precision
constexpr double kRelativeHalfUlp = 0x1p-24;

// What an error is measured against where its points are a part of the splat: the results over all of it, and
// the part's share of the points.
struct Whole {
  double share;
  const std::vector<double>&image, &gradient;
};

// Relative 2-norm error over everything added.
struct Squares {
  double difference = 0, norm = 0;

  double relative() const {
    if (!std::isfinite(difference)) return std::numeric_limits<double>::infinity();
    return std::sqrt(difference) / std::max(std::sqrt(norm), kSmallest);
  }
  // The error of these alone: `scale` times the difference, relative to `whole`.
  template <typename T>
  double add(const T* got, const double* want, std::size_t size, const double* whole, double scale) {
    Squares part;
    for (std::size_t i = 0; i < size; ++i) {
      const double e = scale * (static_cast<double>(got[i]) - want[i]);
      part.difference += e * e;
      part.norm += whole[i] * whole[i];
    }
    difference += part.difference;
    norm += part.norm;
    return part.relative();
  }
};

// Collects the errors of one point over its splats.
class Collector {
 public:
  explicit Collector(std::vector<ParameterGroup> groups)
      : groups_(std::move(groups)), squares_(groups_.size()) {}

  void disagree() {
    ++errors_.disagreed;
    errors_.worst_value = std::max(errors_.worst_value, 1.0);
    errors_.worst_gradient = std::max(errors_.worst_gradient, 1.0);
  }
  template <typename T>
  void add(const std::vector<T>& image, const std::vector<T>& gradient,
           const std::vector<double>& image_reference, const std::vector<double>& gradient_reference) {
    add(image, gradient, image_reference, gradient_reference, Whole{1, image_reference, gradient_reference});
  }
  // Images are means of squares over points, gradients are sums over points.
  template <typename T>
  void add(const std::vector<T>& image, const std::vector<T>& gradient,
           const std::vector<double>& image_reference, const std::vector<double>& gradient_reference,
           const Whole& whole) {
    const double value = value_.add(image.data(), image_reference.data(), image_reference.size(),
                                    whole.image.data(), std::sqrt(whole.share));
    errors_.worst_value = std::max(errors_.worst_value, value);
    for (std::size_t i = 0; i < groups_.size(); ++i) {
      const auto first = static_cast<std::size_t>(groups_[i].first),
                 size = static_cast<std::size_t>(groups_[i].count);
      const double e = squares_[i].add(&gradient[first], &gradient_reference[first], size,
                                       &whole.gradient[first], whole.share);
      errors_.worst_gradient = std::max(errors_.worst_gradient, e);
    }
  }
  SweepErrors result() const {
    SweepErrors e = errors_;
    e.value = value_.relative();
    for (std::size_t i = 0; i < groups_.size(); ++i)
      if (squares_[i].relative() > e.gradient) e.gradient = squares_[i].relative(), e.group = groups_[i].name;
    return e;
  }

 private:
  std::vector<ParameterGroup> groups_;
  std::vector<Squares> squares_;
  Squares value_;
  SweepErrors errors_;
};

std::vector<ParameterGroup> filled_groups(const SweepSet& set) {
  std::vector<ParameterGroup> groups = parameter_groups(ParameterLayout(set.dim, set.variant));
  std::erase_if(groups, [](const ParameterGroup& g) { return g.count == 0; });
  return groups;
}

// The points at which the splats of a set are seen, and the gradient of the loss there.
struct Sight {
  std::vector<bool> visible;
  std::vector<float> points, v_image;  // as blend_probe takes them
  std::span<const float> x(std::size_t i) const { return {&points[2 * kSweepPoints * i], kSweepPoints}; }
  std::span<const float> y(std::size_t i) const {
    return {&points[2 * kSweepPoints * i + kSweepPoints], kSweepPoints};
  }
  std::span<const float> v(std::size_t i) const { return {&v_image[3 * kSweepPoints * i], 3 * kSweepPoints}; }
};

Sight look_at(const SweepSet& set, Generator& g) {
  Sight sight;
  for (const SweepSplat& splat : set.splats) {
    std::vector<float> x, y;
    sight.visible.push_back(choose_points(set, splat, g, x, y));
    x.resize(kSweepPoints), y.resize(kSweepPoints);
    sight.points.insert(sight.points.end(), x.begin(), x.end());
    sight.points.insert(sight.points.end(), y.begin(), y.end());
    for (int k = 0; k < 3 * kSweepPoints; ++k)
      sight.v_image.push_back(static_cast<float>(uniform(g, 0.2, 1.2)));
  }
  return sight;
}

// Image and gradient of every splat by the kernels.
struct DeviceResult {
  std::vector<bool> drawn;
  std::vector<std::vector<float>> image, gradient;
};

DeviceResult run_kernels(opencl::OpenclDevice& device, SweepKernels& kernels, const SweepSet& set,
                         const Sight& sight) {
  const auto count = static_cast<std::uint32_t>(set.splats.size()), stride = (count + 63) / 64 * 64;
  const std::size_t rows = set.splats[0].raw.size();
  std::vector<float> params(rows * stride);
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t r = 0; r < rows; ++r) params[r * stride + i] = set.splats[i].raw[r];
  kernels.upload(params, count, stride, set.camera, set.settings);
  kernels.project_forward();
  Buffer<float> points(device, "points", sight.points.size()),
      v_image(device, "v_image", sight.v_image.size());
  Buffer<float> image(device, "image", sight.v_image.size());
  Buffer<float> v_records(device, "v_records", static_cast<std::size_t>(stride) * UBS_GRAD_STRIDE);
  points.upload(sight.points);
  v_image.upload(sight.v_image);
  v_records.zero();
  kernels.blend(kernels.records(), count, 1, points, v_image, image, v_records);
  kernels.project_backward(v_records);
  DeviceResult result{kernels.drawn(), {}, {}};
  const std::vector<float> images = image.download(), gradients = kernels.gradient();
  for (std::size_t i = 0; i < count; ++i) {
    const auto first = images.begin() + static_cast<std::ptrdiff_t>(3 * kSweepPoints * i);
    result.image.emplace_back(first, first + 3 * kSweepPoints);
    std::vector<float> gradient;
    for (std::size_t r = 0; r < rows; ++r) gradient.push_back(gradients[r * stride + i]);
    result.gradient.push_back(std::move(gradient));
  }
  return result;
}

std::vector<double> moved_by_half_ulp(const std::vector<float>& raw, Generator& g) {
  std::vector<double> moved;
  for (const float v : raw)
    moved.push_back(static_cast<double>(v) * (1 + kRelativeHalfUlp * uniform(g, -1, 1)));
  return moved;
}

class Sweeper {
 public:
  explicit Sweeper(opencl::OpenclDevice& device) : device_(device) {}

  SweepPoint splat_point(const SweepCase& sweep, double x, int count, Generator& g) {
    const SweepSet set = sweep.splats(x, count, g);
    const Sight sight = look_at(set, g);
    std::vector<SplatReference> exact(set.splats.size()), moved(set.splats.size());
    std::vector<std::vector<double>> moved_raw;
    for (const SweepSplat& splat : set.splats) moved_raw.push_back(moved_by_half_ulp(splat.raw, g));
    parallel_for(2 * set.splats.size(), [&](std::size_t k) {
      const std::size_t i = k / 2;
      const std::vector<double> raw(set.splats[i].raw.begin(), set.splats[i].raw.end());
      (k % 2 ? moved : exact)[i] =
          splat_reference(set, k % 2 ? moved_raw[i] : raw, sight.x(i), sight.y(i), sight.v(i));
    });
    SweepPoint point{.x = x, .splats = static_cast<int>(set.splats.size())};
    for (const SplatReference& r : exact) point.culled += !r.visible;
    for (const Formulation f : {Formulation::safe, Formulation::naive}) {
      if (f == Formulation::naive && !sweep.has_naive) continue;
      const DeviceResult got = run_kernels(device_, kernels(set.dim, f, set.variant), set, sight);
      Collector collector(filled_groups(set));
      for (std::size_t i = 0; i < exact.size(); ++i) {
        if (exact[i].visible != got.drawn[i])
          collector.disagree();
        else if (exact[i].visible)
          collector.add(got.image[i], got.gradient[i], exact[i].image, exact[i].gradient);
      }
      (f == Formulation::safe ? point.safe : point.naive) = collector.result();
    }
    Collector collector(filled_groups(set));
    for (std::size_t i = 0; i < exact.size(); ++i) {
      if (exact[i].visible && moved[i].visible)
        collector.add(moved[i].image, moved[i].gradient, exact[i].image, exact[i].gradient);
      else if (exact[i].visible != moved[i].visible)
        collector.disagree();
    }
    point.half_ulp = collector.result();
    return point;
  }

  SweepPoint stack_point(const SweepCase& sweep, double x, int count, Generator& g) {
    const std::vector<SweepStack> stacks = sweep.stacks(x, count, g);
    const std::size_t layers = stacks[0].fields.size() / kStackFields;
    Sight sight;
    for (const SweepStack& stack : stacks) {
      sight.points.insert(sight.points.end(), stack.x.begin(), stack.x.end());
      sight.points.insert(sight.points.end(), stack.y.begin(), stack.y.end());
      for (int k = 0; k < 3 * kSweepPoints; ++k)
        sight.v_image.push_back(static_cast<float>(uniform(g, 0.2, 1.2)));
    }
    std::vector<StackReference> exact(stacks.size()), moved(stacks.size()), whole(stacks.size());
    std::vector<std::vector<double>> moved_fields;
    for (const SweepStack& stack : stacks) moved_fields.push_back(moved_by_half_ulp(stack.fields, g));
    parallel_for(2 * stacks.size(), [&](std::size_t k) {
      const std::size_t i = k / 2;
      const std::vector<double> fields(stacks[i].fields.begin(), stacks[i].fields.end());
      (k % 2 ? moved : exact)[i] =
          stack_reference(k % 2 ? moved_fields[i] : fields, sight.x(i), sight.y(i), sight.v(i));
      if (k % 2 == 0)
        whole[i] = stacks[i].whole_x.empty()
                       ? exact[i]
                       : stack_reference(fields, stacks[i].whole_x, stacks[i].whole_y, sight.v(i));
    });
    SweepPoint point{.x = x, .splats = static_cast<int>(stacks.size() * layers)};
    const auto errors = [&](const auto& result_of) {
      Collector collector(stack_groups(layers));
      for (std::size_t i = 0; i < stacks.size(); ++i) {
        const auto [image, gradient] = result_of(i);
        collector.add(image, by_group(gradient), exact[i].image, by_group(exact[i].gradient),
                      Whole{stacks[i].share, whole[i].image, by_group(whole[i].gradient)});
      }
      return collector.result();
    };
    for (const Formulation f : {Formulation::safe, Formulation::naive}) {
      const auto results = run_stacks(stacks, sight, f);
      (f == Formulation::safe ? point.safe : point.naive) = errors([&](std::size_t i) { return results[i]; });
    }
    point.half_ulp = errors([&](std::size_t i) { return std::pair(moved[i].image, moved[i].gradient); });
    return point;
  }

 private:
  // Gradients of a stack, field by field over its layers: the 2-norm is over the splats, as of a model's.
  static std::vector<ParameterGroup> stack_groups(std::size_t layers) {
    std::vector<ParameterGroup> groups;
    int field = 0;
    for (const auto& [name, fields] :
         {std::pair("mean", 2), {"ellipse", 3}, {"opacity", 1}, {"beta", 1}, {"rgb", 3}}) {
      groups.push_back({name, field * static_cast<int>(layers), fields * static_cast<int>(layers)});
      field += fields;
    }
    return groups;
  }
  template <typename T>
  static std::vector<T> by_group(const std::vector<T>& gradient) {
    std::vector<T> result;
    for (std::size_t field = 0; field < kStackFields; ++field)
      for (std::size_t i = field; i < gradient.size(); i += kStackFields) result.push_back(gradient[i]);
    return result;
  }

  using StackResult = std::pair<std::vector<double>, std::vector<double>>;
  std::vector<StackResult> run_stacks(const std::vector<SweepStack>& stacks, const Sight& sight,
                                      Formulation f) {
    const std::size_t layers = stacks[0].fields.size() / kStackFields;
    std::vector<float> packed;
    for (const SweepStack& stack : stacks)
      for (std::size_t at = 0; at < stack.fields.size(); at += kStackFields) {
        std::array<float, UBS_SPLAT_STRIDE> record{};
        std::copy_n(stack.fields.begin() + static_cast<std::ptrdiff_t>(at), kStackFields, record.begin());
        if (f == Formulation::naive) {
          const double l00 = record[2], l01 = record[3], l11 = record[4];
          record[2] = static_cast<float>(l00 * l00);
          record[3] = static_cast<float>(l00 * l01);
          record[4] = static_cast<float>(l01 * l01 + l11 * l11);
        }
        packed.insert(packed.end(), record.begin(), record.end());
      }
    Buffer<float> records(device_, "records", packed.size()), v_records(device_, "v_records", packed.size());
    Buffer<float> points(device_, "points", sight.points.size()),
        v_image(device_, "v_image", sight.v_image.size());
    Buffer<float> image(device_, "image", sight.v_image.size());
    records.upload(packed);
    points.upload(sight.points);
    v_image.upload(sight.v_image);
    kernels(3, f).blend(records, static_cast<std::uint32_t>(stacks.size()),
                        static_cast<std::uint32_t>(layers), points, v_image, image, v_records);
    const std::vector<float> images = image.download(), gradients = v_records.download();
    std::vector<StackResult> results;
    for (std::size_t i = 0; i < stacks.size(); ++i) {
      const auto first = images.begin() + static_cast<std::ptrdiff_t>(3 * kSweepPoints * i);
      StackResult r{{first, first + 3 * kSweepPoints}, {}};
      for (std::size_t k = 0; k < layers; ++k) {
        const float* v = &gradients[(i * layers + k) * UBS_GRAD_STRIDE];
        const float* l = &stacks[i].fields[k * kStackFields];
        std::vector<double> fields(v, v + kStackFields);
        if (f == Formulation::naive) {  // W = -L v_Q L^T
          const double a = l[2], b = l[3], c = l[4], q00 = v[2], q01 = 0.5 * static_cast<double>(v[3]),
                       q11 = v[4];
          fields[2] = -(a * a * q00 + 2 * a * b * q01 + b * b * q11);
          fields[3] = -(a * c * q01 + b * c * q11);
          fields[4] = -c * c * q11;
        }
        r.second.insert(r.second.end(), fields.begin(), fields.end());
      }
      results.push_back(std::move(r));
    }
    return results;
  }

  SweepKernels& kernels(int dim, Formulation f, const ModelVariant& variant = {}) {
    std::unique_ptr<SweepKernels>& found = kernels_[{dim, f, variant_numbers(variant)}];
    if (!found) found = std::make_unique<SweepKernels>(device_, dim, f, variant);
    return *found;
  }

  opencl::OpenclDevice& device_;
  using Key = std::tuple<int, Formulation, decltype(variant_numbers({}))>;
  std::map<Key, std::unique_ptr<SweepKernels>> kernels_;
};

}  // namespace

std::vector<std::string> sweep_names() {
  std::vector<std::string> names;
  for (const SweepCase& sweep : sweep_cases()) names.push_back(sweep.name);
  return names;
}

std::vector<SweepResult> run_sweeps(Device& device, const SweepOptions& options) {
  for (const std::string& name : options.names)
    if (std::ranges::find(sweep_cases(), name, &SweepCase::name) == sweep_cases().end())
      fail(ErrorKind::usage, "no sweep '{}'; there are: {}", name, fmt::join(sweep_names(), ", "));
  Sweeper sweeper(opencl_of(device));
  std::vector<SweepResult> results;
  for (const SweepCase& sweep : sweep_cases()) {
    if (!options.names.empty() && std::ranges::find(options.names, sweep.name) == options.names.end())
      continue;
    SweepResult result{sweep.name, sweep.title, sweep.x_label, {}, sweep.has_naive};
    const int points = options.points > 0 ? options.points : sweep.points;
    for (int i = 0; i < points; ++i) {
      Generator g(options.seed * 1000003 + static_cast<std::uint64_t>(i));
      const double x =
          points == 1 ? sweep.low : sweep.low * std::pow(sweep.high / sweep.low, i / (points - 1.0));
      result.points.push_back(sweep.splats ? sweeper.splat_point(sweep, x, options.splats, g)
                                           : sweeper.stack_point(sweep, x, options.splats, g));
    }
    results.push_back(std::move(result));
    if (options.on_result) options.on_result(results.back());
  }
  return results;
}

}  // namespace ubs::stress
