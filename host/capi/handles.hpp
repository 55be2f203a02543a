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
#include "host/base/stop_request.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/device/device.hpp"
#include "host/formats/splat_file.hpp"
#include "host/settings/train_settings.hpp"
#include "include/ubs/ubs.h"

namespace ubs::facade {

// OpenDevice is an open device with its index in list_devices(). Objects that are created from a device share
// its OpenDevice. Only one thread at a time may use the device, so each function locks `mutex` first. The
// mutex is recursive, because the step callback of a trainer may call other functions of the library.
struct OpenDevice {
  std::size_t index = 0;
  std::shared_ptr<Device> device;
  std::recursive_mutex mutex;
};

// Sets the error message of this thread, which ubs_error_message() returns.
void remember_error(const char* message) noexcept;

// Throws Error(numerical) if a parameter is not finite. The message names the parameter and the splat.
void check_parameters(const MixedModel& model);

// Runs `action` and returns UBS_OK. If `action` throws, sets the error message of this thread and returns the
// status code of the error.
template <typename Action>
ubs_status guarded(const Action& action) noexcept {
  try {
    action();
    return UBS_OK;
  } catch (const std::bad_alloc&) {
    remember_error("out of memory: use fewer splats, smaller images or fewer views");
    return UBS_ERROR_MEMORY;
  } catch (const Stopped& stopped) {
    remember_error(stopped.what());
    return UBS_STOPPED;
  } catch (const std::exception& exception) {
    const Error error = as_error(exception);
    remember_error(error.what());
    return static_cast<ubs_status>(exit_code(error.kind()));
  } catch (...) {
    remember_error("an exception of an unknown type was thrown");
    return UBS_ERROR_INTERNAL;
  }
}

// Runs `make` and stores the handle that it returns in `*out`. Handles exceptions in the same way as
// guarded(). If `make` uses a device, it must lock the mutex of the device itself, before it creates the
// object. Otherwise, if the creation fails, the object frees its device memory without the lock.
template <typename Handle, typename Make>
ubs_status made(Handle** out, const Make& make) noexcept {
  if (out) *out = nullptr;
  return guarded([&] {
    if (!out) fail(ErrorKind::usage, "the pointer for the new handle is NULL");
    *out = make().release();
  });
}

// Returns the object that `pointer` points to. Throws Error(usage) for a null pointer; `what` is the name of
// the argument for the message.
template <typename T>
T& given(T* pointer, const char* what) {
  if (!pointer) fail(ErrorKind::usage, "{} is NULL", what);
  return *pointer;
}

// Copies a struct of the caller. The program of the caller may have been compiled with another version of
// ubs.h, in which the struct has fewer or more members. Members that the caller does not have are 0 in the
// copy.
template <typename T>
T taken(const T* from, const char* what) {
  const std::size_t size = given(from, what).size;
  if (size <= sizeof(std::size_t))
    fail(ErrorKind::usage,
         "{}: its member `size` is {}: set it to the size of the struct ({} in this library)", what, size,
         sizeof(T));
  T copy{};
  std::memcpy(&copy, from, std::min(size, sizeof(T)));
  return copy;
}

// Copies a result to the struct of the caller, except for its member `size`, which stays unchanged.
template <typename T>
void put(T* to, T value, const char* what) {
  const std::size_t size = taken(to, what).size;
  value.size = size;
  std::memcpy(to, &value, std::min(size, sizeof(T)));
}

// Copies the text, truncated to N - 1 bytes if it is longer, and appends a 0 byte.
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
