// SPDX-License-Identifier: Apache-2.0
// What stands behind the handles of include/ubs/ubs.h, and how its functions turn exceptions into error
// codes. A file of this folder has the functions of one section of the header.
#pragma once

#include <algorithm>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <string>

#include "host/base/error.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/splat_file.hpp"
#include "host/device/device.hpp"
#include "host/scene/train_settings.hpp"
#include "include/ubs/ubs.h"

namespace ubs::facade {

// An open device with its place in list_devices(). What is made of it shares it. One thread at a time works
// with it; recursive, because the step function of a training may ask for more.
struct OpenDevice {
  std::size_t index = 0;
  std::shared_ptr<Device> device;
  std::recursive_mutex mutex;
};

void remember_error(const char* message) noexcept;

// Runs `action`; what it throws becomes the status and the thread's message.
template <typename Action>
ubs_status guarded(const Action& action) noexcept {
  try {
    action();
    return UBS_OK;
  } catch (const std::bad_alloc&) {
    remember_error("out of memory: use fewer splats, smaller images or fewer views");
    return UBS_ERROR_MEMORY;
  } catch (const std::exception& exception) {
    const Error error = as_error(exception);
    remember_error(error.what());
    return static_cast<ubs_status>(exit_code(error.kind()));
  } catch (...) {
    remember_error("an exception of an unknown kind");
    return UBS_ERROR_INTERNAL;
  }
}

// The same for functions that make a handle, with the device's lock where they use one.
template <typename Handle, typename Make>
ubs_status made(Handle** out, const Make& make) noexcept {
  if (out) *out = nullptr;
  return guarded([&] {
    if (!out) fail(ErrorKind::usage, "the pointer for the new handle is NULL");
    *out = make().release();
  });
}

template <typename T>
T& given(T* pointer, const char* what) {
  if (!pointer) fail(ErrorKind::usage, "{} is NULL", what);
  return *pointer;
}

// A struct of the caller, who may know fewer or more members than this library.
template <typename T>
T taken(const T* from, const char* what) {
  const std::size_t size = given(from, what).size;
  if (size <= sizeof(std::size_t))
    fail(ErrorKind::usage, "{}: its member `size` is {}: set it to sizeof ({} here)", what, size, sizeof(T));
  T copy{};
  std::memcpy(&copy, from, std::min(size, sizeof(T)));
  return copy;
}

// To the caller's struct, whose `size` stays what it is.
template <typename T>
void put(T* to, T value, const char* what) {
  const std::size_t size = taken(to, what).size;
  value.size = size;
  std::memcpy(to, &value, std::min(size, sizeof(T)));
}

// As much of the text as there is room for, with its end.
template <std::size_t N>
void put_text(char (&to)[N], const std::string& text) {
  const std::size_t length = std::min(text.size(), N - 1);
  std::memcpy(to, text.data(), length);
  to[length] = 0;
}

Camera camera_from(const ubs_camera& camera);
ubs_camera camera_to(const Camera& camera);
// In the coordinates of a model (world = model + offset), with the query values that its dimensions need.
Camera camera_for(const LoadedModel& model, const ubs_camera* camera);

// All but the splits.
Dataset without_views(const Dataset& data);
const Split& train_of(const Dataset& data);

}  // namespace ubs::facade

struct ubs_device {
  std::shared_ptr<ubs::facade::OpenDevice> open;
};

struct ubs_settings {
  ubs::TrainSettings values;
};

struct ubs_data {
  std::shared_ptr<ubs::Dataset> set = std::make_shared<ubs::Dataset>();
  ubs::TrainSettings settings;  // that it was opened with
};

struct ubs_model {
  ubs::LoadedModel loaded;
};
