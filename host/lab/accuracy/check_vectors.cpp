// SPDX-License-Identifier: Apache-2.0
// The program ubs_check_vectors computes the expected results that devices are checked with ("vectors", see
// host/check/vectors.hpp). It computes them with the float64 oracle.
// Usage: ubs_check_vectors FILE. The build runs the program and embeds the file.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/random.hpp"
#include "host/check/forms.hpp"
#include "host/check/metric_inputs.hpp"
#include "host/check/vectors.hpp"
#include "host/lab/accuracy/truth.hpp"
#include "host/lab/oracle/frame.hpp"
#include "host/lab/oracle/learning.hpp"
#include "host/lab/oracle/lpips_reference.hpp"
#include "host/lab/oracle/oracle_stages.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/lab/oracle/study.hpp"

namespace ubs::accuracy {
namespace {

using check::AdamVectors;
using check::FormVectors;
using check::kSplats;
using check::LossVectors;

// Minimum raw spatial beta. It corresponds to an exponent of 2, for which the slope of the kernel is
// continuous at the edge of its support. With an exponent below 1, the gradient of a pixel at this edge has
// hardly any correct digits in single precision, on all devices.
constexpr float kMinBeta = -0.69f;
constexpr std::size_t kBatch =
    128;  // number of splats that rasterisers process at a time (kernels/gpu/raster_backward.cl)

Problem problem_of(const oracle::Scene& scene) {
  Problem p;
  p.model = scene.model;
  if (p.model.variant.has_spatial_beta())
    for (float& beta : p.model.row(p.model.layout().beta)) beta = std::max(beta, kMinBeta);
  p.camera = scene.camera;
  p.target.assign(scene.target.begin(), scene.target.end());
  for (std::size_t c = 0; c < 3; ++c) p.background[c] = static_cast<float>(scene.background[c]);
  return p;
}

// Returns the number of splats that reach at least one pixel into the tile in the upper left corner.
std::size_t splats_in_first_tile(const Problem& p) {
  const oracle::Options options = oracle_options(p);
  const oracle::Frame frame(oracle::project(oracle::to_model(p.model), p.camera, options), options);
  std::size_t count = 0;
  for (std::size_t i = 0; i < frame.splats.size(); ++i)
    count += frame.footprints[i].mean[0] - frame.half_width[i] < 15 &&
             frame.footprints[i].mean[0] + frame.half_width[i] > 1 &&
             frame.footprints[i].mean[1] - frame.half_height[i] < 15 &&
             frame.footprints[i].mean[1] + frame.half_height[i] > 1;
  return count;
}

void add_noise(FormVectors& f) {
  SplatModel model = f.problem.model;
  for (float& raw : model.row(model.layout().opacity)) raw += check::kNoiseOpacity;
  f.displacement.resize(3 * kSplats);
  f.displacement_size.resize(3 * kSplats);
  for (std::size_t i = 0; i < kSplats; ++i) {
    const oracle::Displacement noise = oracle::noise(
        model, i, check::kNoiseAmount,
        {check::kDrawSeed, check::kDrawIteration, oracle::kNoise, static_cast<std::uint32_t>(i)});
    for (std::size_t r = 0; r < 3; ++r) {
      f.displacement[r * kSplats + i] = noise.displacement[r];
      f.displacement_size[r * kSplats + i] = noise.size[r];
    }
  }
}

// Makes a copy of each splat and puts it into the place of the splat.
void add_copies(FormVectors& f) {
  const SplatModel& model = f.problem.model;
  f.copies.resize(model.values.size());
  f.copy_size.resize(3 * kSplats);
  for (std::size_t i = 0; i < kSplats; ++i) {
    std::vector<double> raw = oracle::split(model, i, 1, check::kCopySpread);
    const oracle::Displacement place = oracle::place(
        raw, model.dim, model.variant, check::kCopySpread,
        {check::kDrawSeed, check::kDrawIteration, oracle::kGrownPlace, static_cast<std::uint32_t>(i)});
    for (std::size_t r = 0; r < 3; ++r) {
      raw[r] += place.displacement[r];
      f.copy_size[r * kSplats + i] = place.size[r];
    }
    for (std::size_t r = 0; r < raw.size(); ++r) f.copies[r * kSplats + i] = raw[r];
  }
}

FormVectors form_vectors(const check::Form& form) {
  oracle::Scene scene = oracle::regular_scene({.count = kSplats,
                                               .dim = form.dim,
                                               .seed = static_cast<std::uint64_t>(form.dim),
                                               .width = check::kWidth,
                                               .height = check::kHeight,
                                               .variant = form.variant});
  // The centre of the model is projected into the first tile, so that the list of this tile is longer than a
  // batch. The model also extends into the other tiles, which are partly outside the image.
  scene.camera.cx = 9, scene.camera.cy = 8;
  FormVectors f;
  f.problem = problem_of(scene);
  f.problem.target.assign(scene.target.size(), check::kTarget);
  f.problem.query_grad = form.query_grad;
  if (const std::size_t count = splats_in_first_tile(f.problem); count <= kBatch)
    fail(ErrorKind::internal, "N = {}, {}: the first tile contains only {} splats", form.dim,
         to_string(form.variant), count);
  const std::vector<double> no_weights(f.problem.target.size(), 0.0);
  f.problem.undecided = oracle::study(oracle::to_model(f.problem.model), f.problem.camera, no_weights,
                                      oracle_options(f.problem), {.gradient = false})
                            .undecided;
  f.truth = compute_stage_truth(f.problem);
  const ParameterLayout layout = f.problem.model.layout();
  for (const float raw : f.problem.model.row(layout.opacity))
    f.penalties.push_back(oracle::opacity_penalty(raw, check::kOpacityWeight, kSplats));
  for (int r = 0; r < 3; ++r)
    for (const float raw : f.problem.model.row(layout.scale + r))
      f.penalties.push_back(oracle::scale_penalty(raw, check::kScaleWeight, kSplats));
  add_noise(f);
  add_copies(f);
  return f;
}

check::LossValues loss_values(const std::vector<double>& image, const std::vector<double>& target, int width,
                              int height) {
  check::LossValues v;
  const std::size_t pixels = image.size() / 3;
  for (std::size_t i = 0; i < image.size(); ++i) {
    const double d = image[i] - target[i];
    v.l1 += std::abs(d) / static_cast<double>(image.size());
    v.mse[i / pixels] += d * d / static_cast<double>(pixels);
  }
  v.ssim = oracle::ssim(image, target, 3, height, width);
  return v;
}

// Returns the expected loss and its gradient for a rendered image. The values of the image are scaled so that
// some are outside [0, 1].
LossVectors loss_vectors() {
  const Problem p = problem_of(oracle::regular_scene({.count = 400, .seed = 6, .width = 45, .height = 35}));
  LossVectors loss{.width = p.camera.width, .height = p.camera.height};
  for (const double x : oracle::render(oracle::to_model(p.model), p.camera, oracle_options(p)).image)
    loss.image.push_back(static_cast<float>(1.6 * x - 0.2));
  std::vector<double> target;
  for (const float t : p.target) {
    loss.target.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(t, 0.0f, 1.0f))));
    target.push_back(static_cast<float>(loss.target.back()) / 255.0f);
  }
  loss.lambda_dssim = p.loss.dssim;
  loss.values = loss_values(loss.image, target, loss.width, loss.height);
  std::vector<double> clamped = loss.image;
  for (double& x : clamped) x = std::clamp(x, 0.0, 1.0);
  loss.clamped = loss_values(clamped, target, loss.width, loss.height);
  loss.v_image = oracle::image_gradient(loss.image, target, loss.width, loss.height, p.loss);
  return loss;
}

// Returns the expected results of Adam steps. The random moments and gradients have similar magnitudes, so
// that each term of a step affects the result.
AdamVectors adam_vectors() {
  AdamVectors a;
  Random random(3);
  const auto drawn = [&](double low, double high) { return static_cast<float>(random.uniform(low, high)); };
  for (std::size_t i = 0; i < check::kAdamCases; ++i) {
    a.parameter.push_back(drawn(-3, 3));
    a.moment1.push_back(drawn(-0.1, 0.1));
    a.moment2.push_back(drawn(0.001, 0.021));
    a.gradient.push_back(drawn(-0.1, 0.1));
    const oracle::AdamValue after = oracle::adam({a.parameter[i], a.moment1[i], a.moment2[i]}, a.gradient[i],
                                                 check::kRate, check::kAdamStep),
                            at_rest = oracle::adam({0, a.moment1[i], a.moment2[i]}, 0, check::kRate,
                                                   check::kAdamStep);
    a.new_parameter.push_back(after.parameter);
    a.new_moment1.push_back(after.moment1);
    a.new_moment2.push_back(after.moment2);
    a.step_at_rest.push_back(at_rest.parameter);
    a.moment1_at_rest.push_back(at_rest.moment1);
    a.moment2_at_rest.push_back(at_rest.moment2);
    a.opacity_penalty.push_back(oracle::opacity_penalty(a.parameter[i], check::kOpacityWeight, kSplats));
    a.scale_penalty.push_back(oracle::scale_penalty(a.parameter[i], check::kScaleWeight, kSplats));
  }
  return a;
}

check::MetricVectors metric_vectors() {
  const PlanarSize size{check::kMetricWidth, check::kMetricHeight};
  const auto pair = check::image_pair(size);
  const std::array<oracle::Features, 2> f{oracle::features(pair[0], size), oracle::features(pair[1], size)};
  const Network& network = lpips_network("squeeze");
  return {oracle::lpips_reference(network, check::random_weights(network, check::kNetworkSeed), f, true),
          oracle::valid_ssim(f[0].values, f[1].values, 3, size.height, size.width)};
}

void write_vectors(const char* path) {
  check::Vectors vectors;
  for (const check::Form& form : check::forms()) vectors.forms.push_back(form_vectors(form));
  vectors.loss = loss_vectors();
  vectors.adam = adam_vectors();
  vectors.metrics = metric_vectors();
  write_file_atomically(path, check::pack(vectors));
}

}  // namespace
}  // namespace ubs::accuracy

int main(int count, char** arguments) {
  try {
    if (count != 2) ubs::fail(ubs::ErrorKind::usage, "usage: ubs_check_vectors FILE");
    ubs::accuracy::write_vectors(arguments[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ubs_check_vectors: %s\n", error.what());
    return 1;
  }
}
