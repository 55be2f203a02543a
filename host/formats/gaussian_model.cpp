// SPDX-License-Identifier: Apache-2.0
// See gaussian_model.hpp.
#include "host/formats/gaussian_model.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/formats/covariance_axes.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs {
namespace {

// Returns the parameter row of the spherical-harmonics coefficient k of colour channel c. The constant
// coefficients of all channels come first, then the other coefficients of each channel.
int harmonic_row(const ParameterLayout& l, std::size_t c, std::size_t k) {
  const std::size_t others = static_cast<std::size_t>(l.variant.harmonics()) - 1;
  return l.rgb + static_cast<int>(k == 0 ? c : 3 + c * others + k - 1);
}

void store_axes(ImportedSplats& out, std::size_t i, const SplatModel& model) {
  const ParameterLayout l = model.layout();
  CovarianceAxes axes;
  if (l.variant.rot_mode == RotMode::quaternion) {
    for (int k = 0; k < 4; ++k) axes.rotation[static_cast<std::size_t>(k)] = model.row(l.l_triangle + k)[i];
    for (int k = 0; k < 3; ++k) {
      const double s = softplus_of(model.row(l.scale + k)[i]);
      axes.variance[static_cast<std::size_t>(k)] = s * s;
    }
  } else {
    axes = covariance_axes(spatial_factor(model, i).m);
  }
  for (std::size_t k = 0; k < 4; ++k) out.rotations[i][k] = static_cast<float>(axes.rotation[k]);
  for (std::size_t k = 0; k < 3; ++k)
    out.log_scales[i][k] =
        static_cast<float>(std::max(0.5 * std::log(axes.variance[k]), double{kFlatLogScale}));
}

}  // namespace

SplatModel exact_model(const ImportedSplats& splats) {
  const int degree = std::min(splats.sh_degree, 3);
  ModelVariant variant;
  variant.rot_mode = RotMode::quaternion;
  variant.kernel = splats.kernel;
  variant.colour = static_cast<ColourMode>(splats.lobes > 0 ? static_cast<int>(ColourMode::sh3) + splats.lobes
                                                            : degree + 1);
  variant.antialias = splats.antialiased ? Antialias::on : Antialias::off;
  SplatModel model(3, splats.count(), variant);
  const ParameterLayout l = model.layout();
  const std::size_t used = static_cast<std::size_t>(variant.harmonics()), stored = splats.coefficients();
  for (std::size_t i = 0; i < splats.count(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      model.row(l.xyz + axis)[i] = splats.positions[i][k];
      const double scale = std::exp(static_cast<double>(splats.log_scales[i][k]));
      model.row(l.scale + axis)[i] = static_cast<float>(inverse_softplus_of(scale));
      for (std::size_t n = 0; n < used; ++n)
        model.row(harmonic_row(l, k, n))[i] = splats.sh[(i * stored + n) * 3 + k];
    }
    for (std::size_t k = 0; k < splats.lobe_values(); ++k)
      model.row(l.rgb + 3 + static_cast<int>(k))[i] = splats.sb[i * splats.lobe_values() + k];
    for (std::size_t k = 0; k < 4; ++k)
      model.row(l.l_triangle + static_cast<int>(k))[i] = splats.rotations[i][k];
    model.row(l.opacity)[i] = splats.opacity_logits[i];
    if (variant.has_spatial_beta()) model.row(l.beta)[i] = splats.betas[i];
  }
  return model;
}

int harmonic_degree(const ModelVariant& variant) {
  return variant.lobes() > 0 ? 0 : std::max(0, static_cast<int>(variant.colour) - 1);
}

void copy_colour(const SplatModel& model, std::size_t i, ImportedSplats& out) {
  const ParameterLayout l = model.layout();
  const std::size_t coefficients = out.coefficients();
  for (std::size_t c = 0; c < 3; ++c)
    if (model.variant.harmonics() == 0)
      out.sh[3 * i + c] = static_cast<float>((model.row(l.rgb + static_cast<int>(c))[i] - 0.5) / kShC0);
    else
      for (std::size_t k = 0; k < coefficients; ++k)
        out.sh[(i * coefficients + k) * 3 + c] = model.row(harmonic_row(l, c, k))[i];
  for (std::size_t k = 0; k < out.lobe_values(); ++k)
    out.sb[i * out.lobe_values() + k] = model.row(l.rgb + 3 + static_cast<int>(k))[i];
}

bool is_gaussian_model(const SplatModel& model) {
  return model.dim == 3 && model.variant.kernel == SpatialKernel::gaussian;
}

ImportedSplats to_imported_splats(const SplatModel& model) {
  const ParameterLayout l = model.layout();
  if (l.query > 0) fail(ErrorKind::internal, "to_imported_splats: N is {}, but must be 3", model.dim);
  ImportedSplats out;
  out.kernel = model.variant.kernel;
  out.lobes = model.variant.lobes();
  out.sh_degree = harmonic_degree(model.variant);
  out.antialiased = model.variant.antialias == Antialias::on;
  out.resize(model.count);
  for (std::size_t i = 0; i < model.count; ++i) {
    store_axes(out, i, model);
    out.opacity_logits[i] = model.row(l.opacity)[i];
    if (!out.betas.empty()) out.betas[i] = model.row(l.beta)[i];
    for (std::size_t c = 0; c < 3; ++c) out.positions[i][c] = model.row(l.xyz + static_cast<int>(c))[i];
    copy_colour(model, i, out);
  }
  clean(out);
  return out;
}

}  // namespace ubs
