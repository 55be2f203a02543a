// SPDX-License-Identifier: Apache-2.0
// Defines the functions that all fuzz targets use. The readers of ubs take paths, so a target writes the
// bytes of its input to files in a folder of its process. This folder is in memory if the system has
// /dev/shm.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include "host/base/error.hpp"

namespace ubs::fuzz {

namespace fs = std::filesystem;
using Data = std::span<const std::uint8_t>;

struct Folder {
  fs::path path;
  Folder() {
    const fs::path root = fs::exists("/dev/shm") ? "/dev/shm" : fs::temp_directory_path();
    path = root / fmt::format("ubs-fuzz-{}", ::getpid());
    fs::create_directories(path / "sparse");
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};

inline const fs::path& folder() {
  static const Folder instance;
  return instance.path;
}

inline fs::path put(const std::string& name, Data data) {
  const fs::path path = folder() / name;
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data.data()), static_cast<std::streamsize>(data.size()));
  return path;
}

inline std::string get(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

// Number of inputs that a reader has accepted. A target that accepts none of its seeds tests nothing.
inline std::size_t accepted = 0;

template <typename Action>
void expect_error_only(const Action& action) {
  try {
    action();
    ++accepted;
  } catch (const Error&) {
  }
}

template <typename T>
void add(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}
// A target that needs several files splits its input with take_block(). In the input, each file is preceded
// by its length in two bytes, which block() adds.
inline std::string block(const std::string& text) {
  return std::string{static_cast<char>(text.size() & 255), static_cast<char>(text.size() >> 8)} + text;
}
inline Data take_block(Data& d) {
  std::size_t length = d.size() < 2 ? 0 : d[0] + 256u * d[1];
  d = d.subspan(std::min<std::size_t>(2, d.size()));
  length = std::min(length, d.size());
  const Data taken = d.first(length);
  d = d.subspan(length);
  return taken;
}

// These functions are defined in targets_media.cpp and targets_run.cpp.
void run_image(Data d);
void run_video(Data d);
void run_checkpoint(Data d);
void run_run_folder(Data d);
void run_keyframes(Data d);
std::vector<std::string> seed_image();
std::vector<std::string> seed_video();
std::vector<std::string> seed_checkpoint();
std::vector<std::string> seed_run_folder();
std::vector<std::string> seed_keyframes();

}  // namespace ubs::fuzz
