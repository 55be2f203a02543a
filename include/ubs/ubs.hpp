// SPDX-License-Identifier: Apache-2.0
// ubs.hpp is the C++20 interface of ubs. It wraps the functions of ubs.h in classes that own their handles,
// and uses spans and exceptions. It consists only of this header. ubs.h describes the functions, their units
// and their errors.
//
//   ubs::Device device("cpu");
//   ubs::Data data("scene");
//   ubs::Trainer trainer(device, data, ubs::Settings().set("iterations", 7000));
//   trainer.run();
//   ubs::Picture picture = ubs::Renderer(device, trainer.model()).draw(data.view("test", 0).camera);
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "ubs.h"

namespace ubs {
// The inline namespace prevents conflicts of these symbols with symbols of the static library.
inline namespace v1 {

// All functions of this header throw Exception if a call of the library fails. status() returns the kind of
// error.
class Exception : public std::runtime_error {
 public:
  Exception(ubs_status status, const char* message) : std::runtime_error(message), status_(status) {}
  ubs_status status() const { return status_; }

 private:
  ubs_status status_;
};

// Throws Exception if `status` is an error.
inline void check(ubs_status status) {
  if (status != UBS_OK) throw Exception(status, ubs_error_message());
}

// Returns a struct of ubs.h whose member `size` is set. All other members are 0.
template <typename T>
T sized() {
  T value{};
  value.size = sizeof(T);
  return value;
}

namespace detail {

template <auto Free>
struct Deleter {
  template <typename T>
  void operator()(T* handle) const {
    Free(handle);
  }
};
template <typename T, auto Free>
using Handle = std::unique_ptr<T, Deleter<Free>>;

// Returns the handle that make(&handle) creates.
template <typename T, typename Make>
T* made(const Make& make) {
  T* handle = nullptr;
  check(make(&handle));
  return handle;
}

inline void check_size(std::size_t size, std::size_t wanted, const char* what) {
  if (size != wanted)
    throw Exception(UBS_ERROR_USAGE, (std::string(what) + ": expected " + std::to_string(wanted) +
                                      " values, not " + std::to_string(size))
                                         .c_str());
}

inline std::size_t pixels(const ubs_camera& camera) {
  if (camera.width < 1 || camera.height < 1) throw Exception(UBS_ERROR_USAGE, "the camera has no pixels");
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

}  // namespace detail

class Device {
 public:
  explicit Device(const std::string& request = "")
      : handle_(
            detail::made<ubs_device>([&](ubs_device** d) { return ubs_device_open(request.c_str(), d); })) {}
  ubs_device_info info() const {
    auto info = sized<ubs_device_info>();
    check(ubs_device_get_info(get(), &info));
    return info;
  }
  static std::vector<ubs_device_info> list() {
    std::size_t count = 0;
    check(ubs_device_count(&count));
    std::vector<ubs_device_info> devices(count, sized<ubs_device_info>());
    for (std::size_t i = 0; i < count; ++i) check(ubs_device_describe(i, &devices[i]));
    return devices;
  }
  ubs_device* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_device, ubs_device_free> handle_;
};

// Settings holds settings by name, with the values of `ubs train --help`.
class Settings {
 public:
  Settings() : Settings(detail::made<ubs_settings>(ubs_settings_create)) {}
  explicit Settings(ubs_settings* handle) : handle_(handle) {}  // takes ownership
  Settings(const Settings& other)
      : Settings(detail::made<ubs_settings>(
            [&](ubs_settings** copy) { return ubs_settings_copy(other.get(), copy); })) {}
  Settings(Settings&&) = default;
  Settings& operator=(Settings other) {
    handle_.swap(other.handle_);
    return *this;
  }
  Settings& load(const std::string& path) {
    check(ubs_settings_load(get(), path.c_str()));
    return *this;
  }
  Settings& set(const std::string& key, const std::string& value) {
    check(ubs_settings_set(get(), key.c_str(), value.c_str()));
    return *this;
  }
  template <typename Number>
  requires std::integral<Number> Settings& set(const std::string& key, Number value) {
    if constexpr (std::same_as<Number, bool>)
      return set(key, std::string(value ? "true" : "false"));
    else
      return set(key, std::to_string(value));
  }
  std::string get(const std::string& key) const {
    std::size_t length = 0;
    check(ubs_settings_get(get(), key.c_str(), nullptr, 0, &length));
    std::string value(length, ' ');
    check(ubs_settings_get(get(), key.c_str(), value.data(), length + 1, nullptr));
    return value;
  }
  // Throws if a setting that was set or loaded has no effect on the functions that `use` stands for.
  void check_effect(ubs_use use) const { check(ubs_settings_check(get(), use)); }
  ubs_settings* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_settings, ubs_settings_free> handle_;
};

class Data {
 public:
  Data() : handle_(detail::made<ubs_data>(ubs_data_create)) {}
  explicit Data(const std::string& path, const Settings& settings = {})
      : handle_(detail::made<ubs_data>(
            [&](ubs_data** data) { return ubs_data_open(path.c_str(), settings.get(), data); })) {}
  // Writes a procedural scene into a folder. `options.size` need not be set.
  static void synthesise(ubs_synthetic options, const std::string& folder) {
    options.size = sizeof options;
    check(ubs_data_synthesise(&options, folder.c_str()));
  }
  // Appends a view. If `name` is empty, the name is the number of the view. If `rgb` or `mask` is empty, the
  // view has no image or no mask.
  Data& add_view(const std::string& split, const std::string& name, const ubs_camera& camera,
                 std::span<const std::uint8_t> rgb = {}, std::span<const std::uint8_t> mask = {}) {
    const std::size_t pixels = detail::pixels(camera);
    if (!rgb.empty()) detail::check_size(rgb.size(), 3 * pixels, "the image");
    if (!mask.empty()) detail::check_size(mask.size(), pixels, "the mask");
    check(ubs_data_add_view(get(), split.c_str(), name.empty() ? nullptr : name.c_str(), &camera,
                            rgb.empty() ? nullptr : rgb.data(), mask.empty() ? nullptr : mask.data()));
    return *this;
  }
  Data& set_points(std::span<const float> positions, std::span<const std::uint8_t> colours = {}) {
    detail::check_size(positions.size(), positions.size() / 3 * 3, "the positions");
    if (!colours.empty()) detail::check_size(colours.size(), positions.size(), "the colours");
    check(ubs_data_set_points(get(), positions.size() / 3, positions.data(),
                              colours.empty() ? nullptr : colours.data()));
    return *this;
  }
  std::size_t view_count(const std::string& split) const {
    std::size_t count = 0;
    check(ubs_data_view_count(get(), split.c_str(), &count));
    return count;
  }
  ubs_view view(const std::string& split, std::size_t index) const {
    auto view = sized<ubs_view>();
    check(ubs_data_get_view(get(), split.c_str(), index, &view));
    return view;
  }
  std::vector<std::uint8_t> image(const std::string& split, std::size_t index) const {
    std::vector<std::uint8_t> rgb(3 * detail::pixels(view(split, index).camera));
    check(ubs_data_get_image(get(), split.c_str(), index, rgb.data(), nullptr));
    return rgb;
  }
  ubs_data* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_data, ubs_data_free> handle_;
};

// Parameter describes a parameter of a model. `values` refers to its raw values (rows, splats) in the memory
// of the model.
struct Parameter {
  std::string name;
  std::size_t dim = 0, rows = 0, splats = 0;
  std::span<float> values;
  std::span<float> row(std::size_t r) const { return values.subspan(r * splats, splats); }
};

class Model {
 public:
  explicit Model(ubs_model* handle) : handle_(handle) {}  // takes ownership
  explicit Model(const std::string& path)
      : Model(detail::made<ubs_model>([&](ubs_model** m) { return ubs_model_load(path.c_str(), m); })) {}
  Model(const Settings& settings, std::uint64_t splats)
      : Model(detail::made<ubs_model>(
            [&](ubs_model** m) { return ubs_model_create(settings.get(), splats, m); })) {}
  static Model initial(const Data& data, const Settings& settings = {}) {
    return Model(detail::made<ubs_model>(
        [&](ubs_model** m) { return ubs_model_create_initial(data.get(), settings.get(), m); }));
  }
  Model(const Model& other)
      : Model(detail::made<ubs_model>([&](ubs_model** m) { return ubs_model_copy(other.get(), m); })) {}
  Model(Model&&) = default;
  Model& operator=(Model other) {
    handle_.swap(other.handle_);
    return *this;
  }
  // Returns a model with `splats` splats whose parameters are all 0. Its dimension, variant, offset and
  // settings for rendering are those of this model.
  Model like(std::uint64_t splats) const {
    return Model(
        detail::made<ubs_model>([&](ubs_model** m) { return ubs_model_create_like(get(), splats, m); }));
  }
  void save(const std::string& path, const std::string& format = "ubs", double time = 0) const {
    check(ubs_model_save(get(), path.c_str(), format.c_str(), time));
  }
  ubs_model_info info() const {
    auto info = sized<ubs_model_info>();
    check(ubs_model_get_info(get(), &info));
    return info;
  }
  std::vector<Parameter> parameters(std::uint32_t group = 0) const {
    std::vector<Parameter> all;
    for (std::uint32_t index = 0;; ++index) {
      auto p = sized<ubs_parameter>();
      check(ubs_model_get_parameter(get(), group, index, &p));
      if (!p.name) return all;
      const auto splats = static_cast<std::size_t>(p.splats);
      all.push_back({p.name, p.dim, p.rows, splats, {p.values, p.rows * splats}});
    }
  }
  Parameter parameter(const std::string& name, std::uint32_t group = 0) const {
    for (Parameter& p : parameters(group))
      if (p.name == name) return p;
    throw Exception(UBS_ERROR_USAGE, ("the model has no parameter named '" + name + "'").c_str());
  }
  Settings settings() const {
    return Settings(
        detail::made<ubs_settings>([&](ubs_settings** s) { return ubs_model_get_settings(get(), s); }));
  }
  ubs_model* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_model, ubs_model_free> handle_;
};

// Picture is a rendered view. Renderer::draw() returns it.
struct Picture {
  int width = 0, height = 0;
  std::vector<float> rgb;    // (height, width, 3)
  std::vector<float> alpha;  // (height, width)
  std::vector<float> depth;  // (height, width); empty without UBS_RENDER_DEPTH
};

class Renderer {
 public:
  Renderer(const Device& device, const Model& model, unsigned flags = 0)
      : Renderer(device, model, nullptr, flags) {}
  Renderer(const Device& device, const Model& model, const Settings& settings, unsigned flags = 0)
      : Renderer(device, model, settings.get(), flags) {}
  void update(const Model& model) { check(ubs_renderer_update(get(), model.get())); }
  // These functions pass pointers to arrays: those of Gaussians to be rendered, and those of their gradients.
  void set_gaussians(const ubs_gaussians& gaussians) { check(ubs_renderer_set_gaussians(get(), &gaussians)); }
  void get_gaussian_gradients(const ubs_gaussians& gradients) {
    check(ubs_renderer_get_gaussian_gradients(get(), &gradients));
  }
  Picture draw(const ubs_camera& camera) {
    const std::size_t pixels = detail::pixels(camera);
    auto image = sized<ubs_image>();
    // The library may reject a very large image. This call finds out before a GiB is allocated for the image.
    if (pixels > (1u << 26)) check(ubs_renderer_draw(get(), &camera, &image));
    Picture picture{
        camera.width, camera.height, std::vector<float>(3 * pixels), std::vector<float>(pixels), {}};
    if (flags_ & UBS_RENDER_DEPTH) picture.depth.resize(pixels);
    image.rgb = picture.rgb.data();
    image.alpha = picture.alpha.data();
    image.depth = picture.depth.empty() ? nullptr : picture.depth.data();
    check(ubs_renderer_draw(get(), &camera, &image));
    return picture;
  }
  // Computes a vector-Jacobian product (ubs_renderer_vjp). `gradient` receives the result; it can be a copy
  // of the model. If it is null, only the gradient with respect to the camera is computed. An empty span
  // stands for a gradient of 0.
  void vjp(const ubs_camera& camera, std::span<const float> v_rgb, std::span<const float> v_alpha,
           const Model* gradient, std::span<const float> v_depth = {}) {
    if (!v_rgb.empty()) detail::check_size(v_rgb.size(), 3 * detail::pixels(camera), "v_rgb");
    if (!v_alpha.empty()) detail::check_size(v_alpha.size(), detail::pixels(camera), "v_alpha");
    if (!v_depth.empty()) detail::check_size(v_depth.size(), detail::pixels(camera), "v_depth");
    auto v = sized<ubs_image_gradient>();
    v.rgb = v_rgb.empty() ? nullptr : v_rgb.data();
    v.alpha = v_alpha.empty() ? nullptr : v_alpha.data();
    v.depth = v_depth.empty() ? nullptr : v_depth.data();
    check(ubs_renderer_vjp(get(), &camera, &v, gradient ? gradient->get() : nullptr));
  }
  void vjp(const ubs_camera& camera, std::span<const float> v_rgb, std::span<const float> v_alpha,
           const Model& gradient) {
    vjp(camera, v_rgb, v_alpha, &gradient);
  }
  // Returns the gradient with respect to the camera for the last call of vjp(), or of loss() with a gradient.
  ubs_camera_gradient camera_gradient() {
    auto gradient = sized<ubs_camera_gradient>();
    check(ubs_renderer_camera_gradient(get(), &gradient));
    return gradient;
  }
  ubs_loss loss(const ubs_camera& camera, std::span<const float> target, float lambda_dssim,
                const Model* gradient = nullptr, std::span<const std::uint8_t> mask = {}) {
    detail::check_size(target.size(), 3 * detail::pixels(camera), "the target");
    if (!mask.empty()) detail::check_size(mask.size(), detail::pixels(camera), "the mask");
    auto loss = sized<ubs_loss>();
    check(ubs_renderer_loss(get(), &camera, target.data(), mask.empty() ? nullptr : mask.data(), lambda_dssim,
                            &loss, gradient ? gradient->get() : nullptr));
    return loss;
  }
  // Returns an array (ubs_renderer_get_array). `height` and `width` are the size of the view; they are only
  // used for UBS_ARRAY_V_RGB, UBS_ARRAY_V_ALPHA and UBS_ARRAY_V_DEPTH.
  ubs_array array(ubs_array_name name, std::uint32_t group = 0, std::int64_t height = 0,
                  std::int64_t width = 0) {
    auto array = sized<ubs_array>();
    array.shape[0] = height;
    array.shape[1] = width;
    check(ubs_renderer_get_array(get(), name, group, &array));
    return array;
  }
  ubs_renderer* get() const { return handle_.get(); }

 private:
  Renderer(const Device& device, const Model& model, const ubs_settings* settings, unsigned flags)
      : handle_(detail::made<ubs_renderer>([&](ubs_renderer** r) {
          return ubs_renderer_create(device.get(), model.get(), settings, flags, r);
        })),
        flags_(flags) {}

  detail::Handle<ubs_renderer, ubs_renderer_free> handle_;
  unsigned flags_;
};

class Meter {
 public:
  explicit Meter(const Device& device, const std::string& networks = "", const std::string& weights = "")
      : handle_(detail::made<ubs_meter>([&](ubs_meter** m) {
          return ubs_meter_create(device.get(), networks.c_str(), weights.empty() ? nullptr : weights.c_str(),
                                  m);
        })) {}
  ubs_metrics compare(int width, int height, std::span<const float> truth, std::span<const float> image) {
    const std::size_t values = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    detail::check_size(truth.size(), values, "the reference image");
    detail::check_size(image.size(), values, "the image");
    auto metrics = sized<ubs_metrics>();
    check(ubs_meter_compare(get(), width, height, truth.data(), image.data(), &metrics));
    return metrics;
  }
  ubs_meter* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_meter, ubs_meter_free> handle_;
};

// Trainer trains a model. The Data that it was created with may be destroyed before the trainer.
class Trainer {
 public:
  Trainer(const Device& device, const Data& data, const Settings& settings = {},
          const Model* initial = nullptr)
      : handle_(detail::made<ubs_trainer>([&](ubs_trainer** t) {
          return ubs_trainer_create(device.get(), data.get(), settings.get(),
                                    initial ? initial->get() : nullptr, t);
        })) {}
  // Trains for `steps` iterations, or to the end if `steps` is 0. Calls on_step() after every iteration. If
  // on_step() returns false, the run ends. If on_step() throws, the run ends and run() throws the same
  // exception.
  void run(const std::function<bool(const ubs_step&)>& on_step = {}, std::uint32_t steps = 0) {
    struct Call {
      const std::function<bool(const ubs_step&)>& function;
      std::exception_ptr thrown;
    } call{on_step, nullptr};
    const ubs_step_function forward = [](void* user, const ubs_step* step) -> int {
      Call& c = *static_cast<Call*>(user);
      try {
        return c.function(*step);
      } catch (...) {
        c.thrown = std::current_exception();
        return 0;
      }
    };
    const ubs_status status = ubs_trainer_run(get(), steps, on_step ? forward : nullptr, &call);
    if (call.thrown) std::rethrow_exception(call.thrown);
    check(status);
  }
  ubs_step status() const {
    auto step = sized<ubs_step>();
    check(ubs_trainer_get_status(get(), &step));
    return step;
  }
  // Returns the settings with the values that were chosen for automatic ones.
  Settings settings() const {
    return Settings(
        detail::made<ubs_settings>([&](ubs_settings** s) { return ubs_trainer_get_settings(get(), s); }));
  }
  Model model() const {
    return Model(detail::made<ubs_model>([&](ubs_model** m) { return ubs_trainer_get_model(get(), m); }));
  }
  // Replaces the splats (ubs_trainer_set_model). `from` contains a number for each splat of `model`: the
  // index of the current splat whose optimiser state the splat continues with, or -1 for a new state. If
  // `from` is empty, all splats get new states.
  void set_model(const Model& model, std::span<const std::int64_t> from = {}) {
    if (!from.empty()) detail::check_size(from.size(), static_cast<std::size_t>(model.info().splats), "from");
    check(ubs_trainer_set_model(get(), model.get(), from.empty() ? nullptr : from.data()));
  }
  ubs_metrics evaluate() {
    auto metrics = sized<ubs_metrics>();
    check(ubs_trainer_evaluate(get(), &metrics));
    return metrics;
  }
  // Returns the metrics of each test view that has an image. `count` is the number of these views. If `meter`
  // is not null, also measures its networks.
  std::vector<ubs_metrics> evaluate_views(std::size_t count, Meter* meter = nullptr) {
    auto mean = sized<ubs_metrics>();
    std::vector<ubs_metrics> views(count, sized<ubs_metrics>());
    check(ubs_trainer_evaluate_views(get(), meter ? meter->get() : nullptr, &mean, count, views.data()));
    return views;
  }
  void save(const std::string& path) const { check(ubs_trainer_save(get(), path.c_str())); }
  void restore(const std::string& path) { check(ubs_trainer_restore(get(), path.c_str())); }
  ubs_trainer* get() const { return handle_.get(); }

 private:
  detail::Handle<ubs_trainer, ubs_trainer_free> handle_;
};

}  // namespace v1
}  // namespace ubs
