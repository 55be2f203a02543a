// SPDX-License-Identifier: Apache-2.0
#include "host/device/device.hpp"

#include <fmt/format.h>

namespace ubs {

std::string_view to_string(DeviceType type) {
  switch (type) {
    case DeviceType::cpu:
      return "cpu";
    case DeviceType::gpu:
      return "gpu";
    case DeviceType::accelerator:
      return "accelerator";
  }
  return "unknown";
}

std::string describe(const DeviceInfo& info) {
  return fmt::format("{} ({}, {}, driver {})", info.name, info.backend, info.platform, info.driver);
}

void Device::show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
                  const std::function<void(std::span<const std::byte>)>& use) {
  if (room.size() < bytes) room.resize(bytes);
  const std::span<std::byte> copy = std::span(room).first(bytes);
  read(from, 0, copy);
  use(copy);
}

std::size_t same_card(const std::vector<DeviceInfo>& devices, std::size_t index) {
  if (devices[index].pci.empty()) return index;
  for (std::size_t i = 0; i < index; ++i)
    if (devices[i].pci == devices[index].pci) return i;
  return index;
}

}  // namespace ubs
