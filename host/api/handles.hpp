// SPDX-License-Identifier: Apache-2.0
// This file contains the structures that the handles of include/ubs/ubs.h point to, and the code that
// converts exceptions to error codes. Each file of this folder implements one section of ubs.h.
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

// An open device and its index in list_devices(). Objects that are created from it share it. Only one thread
// at a time may work with it. The mutex is recursive, because the step callback of a training may call other
// functions.
struct OpenDevice {
  std::size_t index = 0;
  std::shared_ptr<Device> device;
  std::recursive_mutex mutex;
};

void remember_error(const char* message) noexcept;

// Runs `action`. If it throws, sets the error message of this thread and returns the status.
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

// Like guarded(), for functions that create a handle. `make` takes the device's lock if it uses a device.
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

// Copies a struct of the caller, which may have been compiled with fewer or more members than this library
// has.
template <typename T>
T taken(const T* from, const char* what) {
  const std::size_t size = given(from, what).size;
  if (size <= sizeof(std::size_t))
    fail(ErrorKind::usage, "{}: its member `size` is {}: set it to sizeof ({} here)", what, size, sizeof(T));
  T copy{};
  std::memcpy(&copy, from, std::min(size, sizeof(T)));
  return copy;
}

// Copies a result to the caller's struct and keeps its `size`.
template <typename T>
void put(T* to, T value, const char* what) {
  const std::size_t size = taken(to, what).size;
  value.size = size;
  std::memcpy(to, &value, std::min(size, sizeof(T)));
}

// Copies as much of the text as fits, with a terminating 0.
template <std::size_t N>
void put_text(char (&to)[N], const std::string& text) {
  const std::size_t length = std::min(text.size(), N - 1);
  std::memcpy(to, text.data(), length);
  to[length] = 0;
}

Camera camera_from(const ubs_camera& camera);
ubs_camera camera_to(const Camera& camera);
// Returns the camera in the coordinates of a model (world = model + offset). Checks that it has the query
// values that the model's dimensions need.
Camera camera_for(const LoadedModel& model, const ubs_camera* camera);

// Returns everything except the splits.
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
  ubs::TrainSettings settings;  // settings that the data were opened with
};

struct ubs_model {
  ubs::LoadedModel loaded;
};
