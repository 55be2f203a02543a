// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/judge.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "tests/stress/known_limits.hpp"

namespace ubs::stress {
namespace {

// Norms below this limit count as zero. It is far below the weights of the pixels, which are about 1, and
// below the epsilon of Adam, which is 1e-15.
constexpr double kNothing = 1e-20;
// Values of the reference above this limit count as outside the range of single precision.
constexpr double kMost = 1e34;
// If the share of decided pixels is smaller than this, errors are not compared.
constexpr double kMinDecided = 0.05;
// A pixel may exceed the range of its colours by this share of their magnitude, because the sum of the
// weights is rounded.
constexpr double kRangeSlack = 1e-5;

double norm(std::span<const double> values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum);
}

// Returns difference / size, 0 if the difference is not larger than `least`, or infinity if the difference is
// NaN. The floors, which are the errors that rounding of the inputs causes, are computed with least = 0.
// Otherwise, the floor of a gradient of 1e-17 could become 0, and no error of this gradient would be allowed.
double relative(double difference, double size, double least) {
  if (!(difference > least)) return std::isnan(difference) ? std::numeric_limits<double>::infinity() : 0;
  return difference / std::max(size, kNothing);
}

bool all_finite(std::span<const float> values) {
  return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
}

oracle::Options oracle_options(const Case& c) {
  oracle::Options options;
  options.near_plane = c.settings.projection.near_plane;
  options.far_plane = c.settings.projection.far_plane;
  options.eps2d = c.settings.projection.eps2d;
  for (std::size_t i = 0; i < 3; ++i) options.background[i] = c.settings.background[i];
  options.query_grad = c.query_grad;
  options.variant = c.model.variant;
  return options;
}

// Returns the relative distance between two images over the decided pixels.
template <class T>
double image_distance(std::span<const T> a, const oracle::Study& study, double least) {
  const std::vector<double>& b = study.image.image;
  const std::size_t pixels = study.undecided.size();
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    if (study.undecided[i % pixels]) continue;
    const double d = static_cast<double>(a[i]) - b[i];
    difference += d * d;
    size += b[i] * b[i];
  }
  return relative(std::sqrt(difference), std::sqrt(size), least);
}

void compare_images(const Expectation& expected, const DeviceResult& actual, Verdict& v) {
  v.value_error = image_distance(std::span<const float>(actual.image), expected.study, kNothing);
  for (const oracle::Neighbour& n : expected.study.neighbours)
    v.value_floor =
        std::max(v.value_floor, image_distance(std::span<const double>(n.image), expected.study, 0));
}

// Stores the errors of the group with the largest ratio of error to allowed error.
void compare_gradients(const Case& c, const Expectation& expected, const DeviceResult& actual, Verdict& v) {
  double worst = -1;
  const std::span<const double> reference(expected.study.gradient);
  for (const ParameterGroup& group : parameter_groups(c.model.layout())) {
    if (group.count == 0 || c.model.count == 0) continue;
    const std::size_t first = static_cast<std::size_t>(group.first) * c.model.count;
    const std::size_t size = static_cast<std::size_t>(group.count) * c.model.count;
    const std::span<const double> exact = reference.subspan(first, size);
    const double length = norm(exact);
    std::vector<double> difference(size);
    for (std::size_t i = 0; i < size; ++i) difference[i] = actual.gradient.values[first + i] - exact[i];
    const double error = relative(norm(difference), length, kNothing);
    double floor = 0;
    for (const oracle::Neighbour& n : expected.study.neighbours) {
      for (std::size_t i = 0; i < size; ++i) difference[i] = n.gradient[first + i] - exact[i];
      floor = std::max(floor, relative(norm(difference), length, 0));
    }
    const double share = error / std::max(kPromise, kConditioning * floor);
    if (!(share > worst)) continue;
    worst = share;
    v.gradient_error = error, v.gradient_floor = floor, v.worst_group = group.name;
  }
}

// Checks that pixels are between the minimum and the maximum of the background and of the colours of splats
// that may be visible. Returns a description of the problem, or an empty string.
std::string outside_colours(const Case& c, const oracle::Study& study, const DeviceResult& actual) {
  if (c.model.variant.colour != ColourMode::rgb) return "";
  const std::size_t pixels = actual.alpha.size();
  for (std::size_t channel = 0; channel < 3; ++channel) {
    double low = c.settings.background[channel], high = low;
    const std::span<const float> colours = c.model.row(c.model.layout().rgb + static_cast<int>(channel));
    for (std::size_t i = 0; i < colours.size(); ++i) {
      if (study.culled[i] || !std::isfinite(colours[i])) continue;
      low = std::min<double>(low, colours[i]), high = std::max<double>(high, colours[i]);
    }
    const double slack = kRangeSlack * std::max(std::abs(low), std::abs(high));
    for (std::size_t i = 0; i < pixels; ++i) {
      const double value = actual.image[channel * pixels + i];
      if (value < low - slack || value > high + slack)
        return fmt::format("pixel {} is {:.6g}, but background and colours are in [{:.6g}, {:.6g}]", i, value,
                           low, high);
    }
  }
  return "";
}

// Checks that all gradients of culled splats are 0. Returns a description of the problem, or an empty string.
std::string touched_when_culled(const Case& c, const oracle::Study& study, const DeviceResult& actual) {
  for (std::size_t i = 0; i < c.model.count; ++i) {
    if (!study.culled[i]) continue;
    for (int row = 0; row < c.model.layout().count; ++row)
      if (const float g = actual.gradient.row(row)[i]; g != 0)
        return fmt::format("splat {} is culled, but row {} of its gradient is {}", i, row, g);
  }
  return "";
}

// Checks the properties that must hold for every case, independently of its numbers.
void check_promises(const Case& c, const Expectation& expected, const DeviceResult& actual, Verdict& v) {
  const bool image = all_finite(actual.image) && all_finite(actual.alpha);
  const bool gradient = all_finite(actual.gradient.values);
  const auto fault = [&](Fault kind, std::string problem) {
    if (v.fault != Fault::none || problem.empty()) return;
    v.outcome = Outcome::failed, v.fault = kind, v.problem = std::move(problem);
  };
  fault(Fault::image_not_finite, image ? "" : "the image is not finite");
  fault(Fault::outside_colours, outside_colours(c, expected.study, actual));
  fault(Fault::gradient_not_finite, gradient ? "" : "the gradient is not finite");
  fault(Fault::culled_gradient, touched_when_culled(c, expected.study, actual));
}

// Returns whether a value of the reference image or gradient is outside the range of single precision.
bool beyond_single(const oracle::Study& study) {
  const auto largest = [](const std::vector<double>& values) {
    double most = 0;
    for (const double v : values)
      most = std::max(most, std::isfinite(v) ? std::abs(v) : std::numeric_limits<double>::infinity());
    return most;
  };
  return largest(study.image.image) > kMost || largest(study.gradient) > kMost;
}

}  // namespace

std::string_view to_string(Outcome outcome) {
  switch (outcome) {
    case Outcome::float64:
      return "float64";
    case Outcome::inputs:
      return "inputs";
    case Outcome::known:
      return "known";
    case Outcome::undecided:
      return "undecided";
    case Outcome::failed:
      return "failed";
  }
  return "";
}

Expectation expect(const Case& c) {
  Expectation e;
  e.all_weights = e.weights = pixel_weights(c);
  oracle::StudyOptions how;
  how.seed = c.seed;
  if (c.exact) how.margin = 0;
  const std::vector<double> weights(e.weights.begin(), e.weights.end());
  e.study = oracle::study(oracle::to_model(c.model), c.camera, weights, oracle_options(c), how);
  const std::size_t pixels = e.study.undecided.size();
  for (std::size_t i = 0; i < e.weights.size(); ++i)
    if (e.study.undecided[i % pixels]) e.weights[i] = 0;
  return e;
}

namespace {

// Determines the outcome from the errors of a case that satisfies all properties.
void classify(const oracle::Study& study, Verdict& v) {
  const double decided = static_cast<double>(v.pixels - v.undecided) / static_cast<double>(v.pixels);
  const bool value_conditioned = v.value_error <= std::max(kPromise, kConditioning * v.value_floor);
  const bool gradient_conditioned = v.gradient_error <= std::max(kPromise, kConditioning * v.gradient_floor);
  if (beyond_single(study) || decided < kMinDecided) {
    v.outcome = Outcome::undecided;
  } else if (v.value_error <= kPromise && v.gradient_error <= kPromise) {
    v.outcome = Outcome::float64;
  } else if (value_conditioned && gradient_conditioned) {
    v.outcome = Outcome::inputs;
  } else if (const KnownLimit* limit = known_limit(study, v)) {
    v.outcome = Outcome::known;
    v.limit = limit->name;
    v.rounding = limit_rounding(*limit, study);
  } else {
    v.outcome = Outcome::failed;
    v.fault = value_conditioned ? Fault::gradient : Fault::image;
    v.problem = fmt::format("image error {:.2e}, gradient error {:.2e} ({})", v.value_error, v.gradient_error,
                            v.worst_group);
  }
}

}  // namespace

Verdict answer(const Case& c, const Expectation& expected, DeviceRunner& runner) {
  const oracle::Study& study = expected.study;
  Verdict v;
  v.drawn = study.drawn, v.pixels = study.undecided.size(), v.undecided = study.undecided_pixels;
  try {
    const DeviceResult all = runner.run(c, expected.all_weights);
    check_promises(c, expected, all, v);
    if (v.outcome == Outcome::failed) return v;
    const DeviceResult decided = v.undecided == 0 ? all : runner.run(c, expected.weights);
    compare_images(expected, decided, v);
    compare_gradients(c, expected, decided, v);
    classify(study, v);
  } catch (const Error& error) {
    v.outcome = Outcome::failed, v.fault = Fault::refused, v.problem = error.what();
  }
  return v;
}

}  // namespace ubs::stress
