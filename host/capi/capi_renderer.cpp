// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for a model on a device. It renders images, and computes gradients
// with respect to the parameters of the splats and the camera.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>
#include <span>

#include "host/capi/handles.hpp"
#include "host/model/model_session.hpp"
#include "host/pipeline/image_gradient.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "host/run/verified_device.hpp"

struct ubs_renderer {
  std::shared_ptr<ubs::facade::OpenDevice> open;
  // Dimensions, variant, number of splats and offset of the model that the renderer was created with. It has
  // no parameter values.
  ubs::LoadedModel shape;
  unsigned flags = 0;
  std::optional<ubs::ModelSession> session;
  std::vector<std::byte> staging;              // for images that are copied to the caller
  std::optional<ubs::GroupBuffers> gradients;  // allocated at the first request for gradients
  // With UBS_RENDER_GAUSSIANS: the Gaussians, and the addresses of their arrays and of arrays of gradients.
  ubs::RenderGroup gaussians;
  ubs::Buffer<float> arrays, v_arrays;
  std::uint32_t bases = 0;  // of the Gaussians
  // Camera of the image on the device, if this image can be differentiated without rendering it again.
  std::optional<ubs_camera> kept;
  // Camera of the last gradient; empty if there is no valid gradient.
  std::optional<ubs::Camera> differentiated;
  std::optional<ubs::ImageBackward> backward;  // created with the session
  // Sizes of UBS_ARRAY_V_RGB, UBS_ARRAY_V_ALPHA and UBS_ARRAY_V_DEPTH when they were last returned.
  ubs::ImageShape v_rgb_shape, v_alpha_shape, v_depth_shape;
  // True if computing the gradient of alpha or depth has overwritten the image on the device.
  bool painted_over = false;
};

namespace ubs::facade {
namespace {

constexpr std::int64_t kMaxArraySide = 1 << 20;  // [px]
constexpr std::size_t kMaxChannels = 1 << 16;    // in addition to red, green and blue

std::size_t pixels_of(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

bool depends_on_direction(const MixedModel& model) {
  return std::ranges::any_of(model.groups, [](const SplatModel& group) {
    return group.dim >= 6 || group.variant.harmonics() > 1 || group.variant.lobes() > 0;
  });
}

// Throws Error(usage) unless both models have groups of the same dimensions and variants. The groups must
// also have the same numbers of splats; if `same_count` is false, those of `b` may have fewer splats.
void check_same_groups(const MixedModel& a, const MixedModel& b, bool same_count, const char* what) {
  bool same = a.groups.size() == b.groups.size();
  for (std::size_t g = 0; same && g < a.groups.size(); ++g)
    same = a.groups[g].dim == b.groups[g].dim && a.groups[g].variant == b.groups[g].variant &&
           (same_count ? a.groups[g].count == b.groups[g].count : a.groups[g].count >= b.groups[g].count);
  if (!same)
    fail(ErrorKind::usage, "{} ({}, variant {}) does not match the renderer ({}, variant {})", what,
         to_string(b), to_string(b.variant()), to_string(a), to_string(a.variant()));
}

void check_finite(std::span<const float> values, const char* what) {
  for (const float value : values)
    if (!std::isfinite(value)) fail(ErrorKind::usage, "{} contains values that are not finite", what);
}

// Returns a model without values whose groups have the dimensions, variants and current numbers of splats of
// the groups on the device.
MixedModel groups_of(const ubs_renderer& renderer) {
  MixedModel shape = renderer.shape.model;
  const std::vector<DeviceModel>& groups = renderer.session->model().groups();
  for (std::size_t g = 0; g < groups.size(); ++g) shape.groups[g].count = groups[g].count();
  return shape;
}

// Copies the gradients into the model of the caller. The caller may hold pointers to the values of this
// model, so its arrays are not reallocated. If a gradient is not finite, throws Error(numerical) and copies
// nothing.
void download(const ubs_renderer& renderer, MixedModel& to) {
  MixedModel values{std::vector<SplatModel>{}};
  const std::vector<DeviceModel>& groups = renderer.session->model().groups();
  for (std::size_t g = 0; g < groups.size(); ++g) {
    values.groups.push_back(
        download_rows((*renderer.gradients)[g], groups[g].layout(), groups[g].count(), groups[g].stride()));
    for (const float value : values.groups.back().values)
      if (!std::isfinite(value)) fail(ErrorKind::numerical, "a gradient of the parameters is not finite");
  }
  for (std::size_t g = 0; g < groups.size(); ++g)
    std::ranges::copy(values.groups[g].values, to.groups[g].values.begin());
}

bool reads_arrays(const ubs_renderer& renderer) { return renderer.flags & UBS_RENDER_GAUSSIANS; }

// Returns the number of splats that the renderer draws.
std::size_t splats_of(const ubs_renderer& renderer) {
  if (reads_arrays(renderer)) return renderer.gaussians.splats.count;
  std::size_t count = 0;
  for (const DeviceModel& group : renderer.session->model().groups()) count += group.count();
  return count;
}

void check_gaussians(const MixedModel& model) {
  const ModelVariant variant = model.variant();
  if (model.groups.size() != 1 || model.dim() != 3 || variant.kernel != SpatialKernel::gaussian ||
      variant.lobes() > 0 || variant.rot_mode != RotMode::quaternion)
    fail(ErrorKind::usage,
         "UBS_RENDER_GAUSSIANS requires a model with dim = 3, kernel = gaussian, rot_mode = quaternion and "
         "no lobes, not {} ({})",
         to_string(model), to_string(variant));
}

MixedModel without_splats(MixedModel model) {
  for (SplatModel& group : model.groups) group.count = 0;
  return model;
}

// Throws Error(usage) if the driver of the device does not provide addresses of its memory.
void need_addresses(ubs_renderer& renderer) {
  const DeviceModel& splats = renderer.session->model().groups().front();
  if (!splats.view().params.memory->address().pointer)
    fail(ErrorKind::usage,
         "{} does not provide addresses of its memory: only CUDA devices and PoCL on CPUs do",
         renderer.session->device().info().name);
}

std::span<const RenderGroup> groups_to_draw(const ubs_renderer& renderer) {
  if (!reads_arrays(renderer)) return renderer.session->model().view();
  if (!renderer.arrays)
    fail(ErrorKind::usage, "the renderer has no Gaussians yet: call ubs_renderer_set_gaussians");
  return {&renderer.gaussians, 1};
}

void need_rows(const ubs_renderer& renderer, const char* what) {
  if (reads_arrays(renderer)) fail(ErrorKind::usage, "{} is not available with UBS_RENDER_GAUSSIANS", what);
}

// Copies addresses to the device.
void upload(ubs_renderer& renderer, const ubs_gaussians& arrays, Buffer<float>& to) {
  const GaussianArrays addresses{arrays.means,     arrays.quats,   arrays.scales,
                                 arrays.opacities, arrays.colours, arrays.bases};
  const auto words = std::bit_cast<std::array<float, sizeof addresses / sizeof(float)>>(addresses);
  reserve(renderer.session->device(), to, "addresses", words.size());
  to.upload(words);
}

// Checks the members of ubs_gaussians for a renderer and returns them.
ubs_gaussians checked(const ubs_renderer& renderer, const ubs_gaussians* arrays, const char* what) {
  const ubs_gaussians found = taken(arrays, what);
  if (!reads_arrays(renderer))
    fail(ErrorKind::usage, "the renderer was created without UBS_RENDER_GAUSSIANS");
  const float* const addresses[] = {found.means, found.quats, found.scales, found.opacities, found.colours};
  if (found.count > 0 && std::ranges::count(addresses, nullptr) > 0)
    fail(ErrorKind::usage, "{}: an array is NULL", what);
  const int needed = std::max(1, renderer.shape.model.variant().harmonics());
  if (found.bases < static_cast<std::uint32_t>(needed) || found.bases > 65536)
    fail(ErrorKind::usage, "{}.bases is {}, but must be from {} to 65536", what, found.bases, needed);
  return found;
}

std::span<const BufferView<float>> gradient_buffers(ubs_renderer& renderer) {
  if (!renderer.gradients)
    renderer.gradients.emplace(renderer.session->device(), renderer.session->model(), "parameter gradients");
  return renderer.gradients->view();
}

// Describes an image that is stored as (planes, rows, pitch) as an array of shape (height, width, 3) if
// `planes` is set, and otherwise as an array of shape (height, width).
void put_picture(ubs_array& array, const ImageShape& shape, bool planes) {
  const std::int64_t pitch = shape.pitch(), plane = static_cast<std::int64_t>(shape.plane());
  array.dims = planes ? 3 : 2;
  const std::int64_t sizes[] = {shape.height, shape.width, 3}, steps[] = {pitch, 1, plane};
  std::copy_n(sizes, array.dims, array.shape);
  std::copy_n(steps, array.dims, array.strides);
}

// Returns whether `values`, a gradient with respect to the pixels of the view, is the array `name` of the
// renderer, whose memory is `plane`. Throws Error(usage) if this array has another size than the view.
bool is_array(const char* name, BufferView<float> plane, const float* values, const ImageShape& size,
              const Camera& view) {
  if (!values || !plane.memory || plane.memory->address().pointer != values) return false;
  if (size.width != view.width || size.height != view.height)
    fail(ErrorKind::usage, "{} was requested for views of {}x{} pixels, but this view has {}x{}", name,
         size.width, size.height, view.width, view.height);
  return true;
}

// Converts a user-defined falloff. Throws Error(usage) if the kernels of the model have no beta, or if an
// expression contains blanks or quotes, because the expressions are passed to the compiler as options.
OwnFalloff falloff_from(const ubs_falloff& falloff, const MixedModel& model) {
  const ubs_falloff from = taken(&falloff, "falloff");
  OwnFalloff own{&given(from.log2, "falloff.log2"), &given(from.r_slope, "falloff.r_slope"),
                 &given(from.beta_slope, "falloff.beta_slope"), from.support};
  for (const std::string* text : {&own.log2, &own.r_slope, &own.beta_slope})
    if (text->empty() || text->find_first_of(" \t\r\n\"'\\") != std::string::npos)
      fail(ErrorKind::usage, "falloff: '{}' must be an expression without blanks or quotes", *text);
  if (!(own.support > 0 && own.support <= 100))
    fail(ErrorKind::usage, "falloff.support = {} must be above 0 and at most 100", own.support);
  for (const SplatModel& group : model.groups)
    if (!group.variant.has_spatial_beta())
      fail(ErrorKind::usage, "falloff: requires a kernel with beta, but the variant of the model is {}",
           to_string(group.variant));
  return own;
}

void need_gradients(const ubs_renderer& renderer) {
  if (!(renderer.flags & UBS_RENDER_GRADIENTS))
    fail(ErrorKind::usage, "the renderer was created without UBS_RENDER_GRADIENTS");
}

void need_gradient(const ubs_renderer& renderer) {
  if (!renderer.differentiated)
    fail(ErrorKind::usage,
         "the renderer has no gradient yet: call ubs_renderer_vjp or ubs_renderer_loss first");
}

}  // namespace
}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_renderer_create(ubs_device* device, const ubs_model* model, const ubs_settings* settings,
                               unsigned flags, ubs_renderer** renderer) {
  return ubs_renderer_create_falloff(device, model, settings, flags, nullptr, renderer);
}

ubs_status ubs_renderer_create_falloff(ubs_device* device, const ubs_model* model,
                                       const ubs_settings* settings, unsigned flags,
                                       const ubs_falloff* falloff, ubs_renderer** renderer) {
  return made(renderer, [&] {
    const LoadedModel& loaded = given(model, "model").loaded;
    if (flags & ~static_cast<unsigned>(UBS_RENDER_DEPTH | UBS_RENDER_GRADIENTS | UBS_RENDER_ABSGRAD |
                                       UBS_RENDER_GAUSSIANS))
      fail(ErrorKind::usage,
           "flags = {:#x}: this library supports only UBS_RENDER_DEPTH, UBS_RENDER_GRADIENTS, "
           "UBS_RENDER_ABSGRAD and UBS_RENDER_GAUSSIANS",
           flags);
    if ((flags & UBS_RENDER_ABSGRAD) && !(flags & UBS_RENDER_GRADIENTS))
      fail(ErrorKind::usage, "UBS_RENDER_ABSGRAD requires UBS_RENDER_GRADIENTS");
    const auto own = falloff ? std::optional(falloff_from(*falloff, loaded.model)) : std::nullopt;
    TrainSettings values = settings ? settings->values : noted_settings(loaded.notes, "the model");
    validate(values);
    if (!(flags & UBS_RENDER_GAUSSIANS)) check_parameters(loaded.model);
    if (!values.chosen.contains("query_grad")) values.query_grad = depends_on_direction(loaded.model);
    const std::shared_ptr<OpenDevice> open = given(device, "device").open;
    const std::lock_guard lock(open->mutex);
    auto created = std::make_unique<ubs_renderer>();
    created->open = open;
    const bool backward = flags & UBS_RENDER_GRADIENTS;
    verify_device(created->open->device->info(), created->open->index,
                  drawing_use(loaded.model, values, backward));
    created->flags = flags;
    created->shape.offset = loaded.offset;
    created->shape.model = MixedModel(std::vector<SplatModel>{});
    for (const SplatModel& group : loaded.model.groups) {
      SplatModel& empty = created->shape.model.groups.emplace_back();
      empty.dim = group.dim, empty.variant = group.variant, empty.count = group.count;
    }
    KernelConfig config =
        config_for(*created->open->device, loaded.model, values, (flags & UBS_RENDER_DEPTH) != 0, backward);
    config.absgrad = flags & UBS_RENDER_ABSGRAD;
    config.falloff = own;
    config.gaussian_arrays = reads_arrays(*created);
    if (config.gaussian_arrays) {
      check_gaussians(loaded.model);
      created->session.emplace(created->open->device, without_splats(created->shape.model), values, config);
      need_addresses(*created);
    } else {
      created->session.emplace(created->open->device, loaded.model, values, config);
    }
    ModelSession& session = *created->session;
    created->backward.emplace(session.device(), session.stages(), session.renderer());
    return created;
  });
}

void ubs_renderer_free(ubs_renderer* renderer) {
  if (!renderer) return;
  // This copy keeps the mutex alive until the renderer is deleted.
  const std::shared_ptr<OpenDevice> open = renderer->open;
  const std::lock_guard lock(open->mutex);
  delete renderer;
}

ubs_status ubs_renderer_update(ubs_renderer* renderer, const ubs_model* model) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    const LoadedModel& loaded = given(model, "model").loaded;
    check_parameters(loaded.model);
    const std::lock_guard lock(r.open->mutex);
    need_rows(r, "ubs_renderer_update");
    check_same_groups(r.shape.model, loaded.model, false, "the new model");
    r.kept.reset(), r.differentiated.reset();
    r.session->choose(loaded.model);
    r.shape.offset = loaded.offset;
  });
}

ubs_status ubs_renderer_set_gaussians(ubs_renderer* renderer, const ubs_gaussians* gaussians) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    const ubs_gaussians found = checked(r, gaussians, "gaussians");
    const std::lock_guard lock(r.open->mutex);
    const std::uint32_t stride = row_stride(found.count);  // throws if there are too many
    r.kept.reset(), r.differentiated.reset();
    upload(r, found, r.arrays);
    r.gaussians = {&r.session->stages(), {r.arrays.view(), static_cast<std::uint32_t>(found.count), stride}};
    r.bases = found.bases;
  });
}

ubs_status ubs_renderer_get_gaussian_gradients(ubs_renderer* renderer, const ubs_gaussians* gradients) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    const ubs_gaussians found = checked(r, gradients, "gradients");
    const std::lock_guard lock(r.open->mutex);
    need_gradient(r);
    if (found.count != r.gaussians.splats.count || found.bases != r.bases)
      fail(ErrorKind::usage,
           "gradients: count = {} and bases = {}, but the rendered Gaussians have count = {} and bases = {}",
           found.count, found.bases, r.gaussians.splats.count, r.bases);
    upload(r, found, r.v_arrays);
    const BufferView<float> to = r.v_arrays.view();
    r.session->renderer().backward_from_records({&to, 1}, false);
    r.session->device().finish();
  });
}

ubs_status ubs_renderer_draw(ubs_renderer* renderer, const ubs_camera* camera, const ubs_image* image) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    const ubs_image out = taken(image, "image");
    const Camera view = camera_for(r.shape, camera);
    if (out.depth && !(r.flags & UBS_RENDER_DEPTH))
      fail(ErrorKind::usage, "the renderer was created without UBS_RENDER_DEPTH");
    if (out.for_gradient) need_gradients(r);
    const std::lock_guard lock(r.open->mutex);
    ModelSession& session = *r.session;
    r.kept.reset(), r.differentiated.reset();
    session.renderer().set_cameras({view});
    session.renderer().forward(groups_to_draw(r), 0, session.settings(), out.for_gradient != 0);
    r.painted_over = false;
    if (out.for_gradient) r.kept = taken(camera, "camera");
    const auto room = [&](float* to, std::size_t channels) {
      return std::span<float>(to, to ? channels * pixels_of(view) : 0);
    };
    session.renderer().download({room(out.rgb, 3), room(out.alpha, 1), room(out.depth, 1)}, r.staging);
  });
}

ubs_status ubs_renderer_vjp(ubs_renderer* renderer, const ubs_camera* camera,
                            const ubs_image_gradient* v_image, ubs_model* gradient) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    const ubs_image_gradient v = taken(v_image, "v_image");
    const std::lock_guard lock(r.open->mutex);
    if (!camera && !r.kept)
      fail(ErrorKind::usage,
           "there is no image to differentiate: render one with for_gradient, or pass the camera");
    const ubs_camera seen = camera ? taken(camera, "camera") : *r.kept;
    const Camera view = camera_for(r.shape, &seen);
    const auto [v_rgb_at, v_alpha_at, v_depth_at] =
        std::array{is_array("UBS_ARRAY_V_RGB", r.session->renderer().v_image(), v.rgb, r.v_rgb_shape, view),
                   is_array("UBS_ARRAY_V_ALPHA", r.backward->v_alpha(), v.alpha, r.v_alpha_shape, view),
                   is_array("UBS_ARRAY_V_DEPTH", r.backward->v_depth(), v.depth, r.v_depth_shape, view)};
    const std::span<const float> rgb(v.rgb, v.rgb && !v_rgb_at ? 3 * pixels_of(view) : 0);
    const std::span<const float> alpha(v.alpha, v.alpha && !v_alpha_at ? pixels_of(view) : 0);
    const std::span<const float> depth(v.depth, v.depth && !v_depth_at ? pixels_of(view) : 0);
    need_gradients(r);
    if (v.depth && !(r.flags & UBS_RENDER_DEPTH))
      fail(ErrorKind::usage, "the renderer was created without UBS_RENDER_DEPTH");
    check_finite(rgb, "v_image.rgb");
    check_finite(alpha, "v_image.alpha");
    check_finite(depth, "v_image.depth");
    const std::size_t channels = v.more_channels;
    if (channels > 0 && (!(r.flags & UBS_RENDER_ABSGRAD) || v.depth))
      fail(ErrorKind::usage, "v_image.more_channels requires UBS_RENDER_ABSGRAD, and no v_image.depth");
    if (channels > kMaxChannels)
      fail(ErrorKind::usage, "v_image.more_channels is {}, but must be at most {}", channels, kMaxChannels);
    if (channels > 0 && (!v.more || !v.more_image || !v.more_colours))
      fail(ErrorKind::usage, "v_image.more_channels is {}, but more, more_image or more_colours is NULL",
           channels);
    const std::span<const float> more(v.more, channels * pixels_of(view)),
        more_image(v.more_image, channels * pixels_of(view)),
        more_colours(v.more_colours, channels * splats_of(r));
    check_finite(more, "v_image.more");
    check_finite(more_image, "v_image.more_image");
    check_finite(more_colours, "v_image.more_colours");
    ModelSession& session = *r.session;
    if (gradient) need_rows(r, "a model for the gradient");
    if (gradient) check_same_groups(groups_of(r), gradient->loaded.model, true, "the gradient");
    const auto buffers = gradient ? gradient_buffers(r) : std::span<const BufferView<float>>{};
    r.kept.reset(), r.differentiated.reset();
    if (camera) {
      session.renderer().set_cameras({view});
      session.renderer().forward(groups_to_draw(r), 0, session.settings(), true);
    }
    r.painted_over = v.alpha || v.depth;
    r.backward->run({rgb, alpha, depth, v_rgb_at, v_alpha_at, v_depth_at, v.more_channels, more, more_image,
                     more_colours},
                    buffers);
    if (gradient) download(r, gradient->loaded.model);
    r.differentiated = camera_from(seen);
    if (!r.painted_over) r.kept = seen;
  });
}

ubs_status ubs_renderer_loss(ubs_renderer* renderer, const ubs_camera* camera, const float* target,
                             const uint8_t* mask, float lambda_dssim, ubs_loss* loss, ubs_model* gradient) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    ubs_loss out = taken(loss, "loss");
    const Camera view = camera_for(r.shape, camera);
    const std::span<const float> image(&given(target, "target"), 3 * pixels_of(view));
    const std::span<const std::uint8_t> counts(mask, mask ? pixels_of(view) : 0);
    if (!(lambda_dssim >= 0 && lambda_dssim <= 1))
      fail(ErrorKind::usage, "lambda_dssim is {}, but must be between 0 and 1", lambda_dssim);
    if (mask && std::ranges::all_of(counts, [](std::uint8_t m) { return m == 0; }))
      fail(ErrorKind::usage, "the mask leaves no pixel to compare");
    if (gradient) need_gradients(r);
    check_finite(image, "target");
    need_rows(r, "ubs_renderer_loss");
    const std::lock_guard lock(r.open->mutex);
    ModelSession& session = *r.session;
    if (gradient) check_same_groups(groups_of(r), gradient->loaded.model, true, "the gradient");
    const auto buffers = gradient ? gradient_buffers(r) : std::span<const BufferView<float>>{};
    r.kept.reset(), r.differentiated.reset();
    const ViewLoss values =
        view_loss(session.device(), session.stages(), session.renderer(), session.model().view(), buffers,
                  view, planar(image), session.settings(), lambda_dssim, counts);
    r.painted_over = false;
    if (!std::isfinite(values.loss)) fail(ErrorKind::numerical, "the loss is not finite");
    if (gradient) download(r, gradient->loaded.model);
    if (gradient) r.differentiated = camera_from(*camera);
    out.loss = values.loss;
    out.l1 = values.l1;
    out.ssim = values.ssim;
    put(loss, out, "loss");
  });
}

ubs_status ubs_renderer_camera_gradient(ubs_renderer* renderer, ubs_camera_gradient* gradient) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    ubs_camera_gradient out = taken(gradient, "gradient");
    const std::lock_guard lock(r.open->mutex);
    if (r.flags & UBS_RENDER_ABSGRAD)
      fail(ErrorKind::usage, "a renderer with UBS_RENDER_ABSGRAD has no gradient with respect to the camera");
    need_gradient(r);
    const CameraGradient found = r.session->renderer().camera_gradient();
    std::ranges::copy(found.turn, out.pose);
    std::ranges::copy(found.shift, out.pose + 3);
    std::ranges::copy(matrix_gradient(found, *r.differentiated), out.world_to_camera);
    out.fx = found.fx, out.fy = found.fy, out.cx = found.cx, out.cy = found.cy, out.time = found.time;
    std::ranges::copy(found.extra, out.extra);
    for (const double v : out.pose)
      if (!std::isfinite(v)) fail(ErrorKind::numerical, "a gradient of the camera is not finite");
    put(gradient, out, "gradient");
  });
}

ubs_status ubs_renderer_get_array(ubs_renderer* renderer, ubs_array_name name, uint32_t group,
                                  ubs_array* array) {
  return guarded([&] {
    ubs_renderer& r = given(renderer, "renderer");
    ubs_array out = taken(array, "array");
    const std::lock_guard lock(r.open->mutex);
    ModelSession& session = *r.session;
    const std::vector<DeviceModel>& groups = session.model().groups();
    if (group >= groups.size())
      fail(ErrorKind::usage,
           "group {} does not exist: the groups of splats of this model are numbered from 0 to {}", group,
           groups.size() - 1);
    const DeviceModel& splats = groups[group];
    const std::uint32_t count = reads_arrays(r) ? r.gaussians.splats.count : splats.count();
    if (name == UBS_ARRAY_RGB && r.painted_over)
      fail(ErrorKind::usage,
           "computing the gradient of alpha or depth has overwritten the image: render it again");
    need_addresses(r);
    ImageShape picture = session.renderer().shape();  // size of arrays of pixels
    // Returns the size of the view that an array for a gradient of the image is requested for.
    const auto shape_of_array = [&] {
      need_gradients(r);
      for (const std::int64_t side : {out.shape[0], out.shape[1]})
        if (side < 1 || side > kMaxArraySide)
          fail(ErrorKind::usage, "array.shape: {} pixels are not supported", side);
      return picture = {static_cast<int>(out.shape[1]), static_cast<int>(out.shape[0])};
    };
    BufferView<float> found;
    // For arrays of records: the position of the first value, the distance between the values of two splats,
    // and the number of values per splat, 1 or 2.
    std::size_t column = 0, stride = 0, values = 2;
    switch (name) {
      case UBS_ARRAY_PARAMETERS:
        need_rows(r, "UBS_ARRAY_PARAMETERS");
        r.kept.reset(), r.differentiated.reset();
        found = splats.view().params;
        break;
      case UBS_ARRAY_RGB:
        found = session.renderer().image();
        break;
      case UBS_ARRAY_TRANSMITTANCE:
        found = session.renderer().transmittance();
        break;
      case UBS_ARRAY_DEPTH:
        found = session.renderer().depth();
        break;
      case UBS_ARRAY_V_RGB:
        r.v_rgb_shape = shape_of_array();
        found = session.renderer().v_image(r.v_rgb_shape);
        break;
      case UBS_ARRAY_V_ALPHA:
        r.v_alpha_shape = shape_of_array();
        found = r.backward->v_alpha(r.v_alpha_shape);
        break;
      case UBS_ARRAY_V_DEPTH:
        if (!(r.flags & UBS_RENDER_DEPTH))
          fail(ErrorKind::usage, "the renderer was created without UBS_RENDER_DEPTH");
        r.v_depth_shape = shape_of_array();
        found = r.backward->v_depth(r.v_depth_shape);
        break;
      case UBS_ARRAY_GRADIENT:
        need_rows(r, "UBS_ARRAY_GRADIENT");
        need_gradient(r);
        session.renderer().backward_from_records(gradient_buffers(r), false);
        found = gradient_buffers(r)[group];
        break;
      case UBS_ARRAY_EXTENTS:
        found = session.renderer().records(), column = kSplatHx, stride = kSplatStride;
        break;
      case UBS_ARRAY_V_MEANS2D:
        need_gradient(r);
        found = session.renderer().v_records(), column = kGradX, stride = kGradStride;
        break;
      case UBS_ARRAY_MEANS2D:
        found = session.renderer().records(), column = kSplatX, stride = kSplatStride;
        break;
      case UBS_ARRAY_DEPTHS:
        found = session.renderer().records(), column = kSplatDepth, stride = kSplatStride, values = 1;
        break;
      case UBS_ARRAY_OPACITIES:
        found = session.renderer().records(), column = kSplatOpacity, stride = kSplatStride, values = 1;
        break;
      default:
        fail(ErrorKind::usage, "there is no array {}", static_cast<int>(name));
    }
    if (!found.memory)
      fail(ErrorKind::usage,
           "the renderer does not have this array: nothing has been rendered yet, or the renderer was "
           "created without UBS_RENDER_DEPTH");
    session.device().finish();
    const DeviceAddress address = found.memory->address();
    out.values = static_cast<float*>(address.pointer);
    out.type = static_cast<std::int32_t>(address.kind);
    out.ordinal = address.ordinal;
    if (name == UBS_ARRAY_PARAMETERS || name == UBS_ARRAY_GRADIENT) {
      out.dims = 2;
      out.shape[0] = splats.rows(), out.shape[1] = splats.count();
      out.strides[0] = splats.stride(), out.strides[1] = 1;
    } else if (stride > 0) {
      for (std::size_t g = 0; g < group; ++g) column += stride * groups[g].count();
      out.values += column;
      out.dims = static_cast<std::int32_t>(values);
      out.shape[0] = count, out.shape[1] = static_cast<std::int64_t>(values);
      out.strides[0] = static_cast<std::int64_t>(stride), out.strides[1] = 1;
    } else {
      put_picture(out, picture, name == UBS_ARRAY_RGB || name == UBS_ARRAY_V_RGB);
    }
    put(array, out, "array");
  });
}
