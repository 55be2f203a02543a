// SPDX-License-Identifier: Apache-2.0
// These functions read and write .ubsz files. Such a file contains a model in a compact format, which is also
// read by web pages (host/look/web). The parameters are stored exactly, or rounded to multiples of
// quantisation steps, in an order that compresses well. docs/web.md describes the layout.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

inline constexpr char kUbszMagic[] = {'U', 'B', 'S', 'Z'};
// Maximum class of a splat. The quantisation steps of splats of class k are 2^k times as large as those of
// class 0.
inline constexpr int kMaxStepClass = 5;

// UbszSteps describes the quantisation of one group. The three rows of the position must have the same step.
struct UbszSteps {
  std::vector<double> steps;          // quantisation step of each row of parameters, positive
  std::vector<std::uint8_t> classes;  // class of each splat, from 0 to kMaxStepClass
};

// Returns the model that a reader of the file gets. Its values are rounded, and its splats are in file order.
SplatModel rounded(const SplatModel& model, const UbszSteps& steps);

// UbszLevel is one level of detail. It contains a part of the splats of each group. The model is approximated
// by all levels up to and including this one.
struct UbszLevel {
  MixedModel model;
  std::vector<UbszSteps> steps;  // one entry per group, or empty, as for pack_ubsz()
  double psnr = 0;               // [dB] quality of the levels up to this one; it is stored in the header
};
// UbszParts is a file that can be loaded in parts. The first part consists of the header and the first level,
// and each further part is a level. A reader that has received the first parts can already show them.
struct UbszParts {
  std::vector<std::byte> bytes;    // the whole file
  std::vector<std::size_t> sizes;  // number of bytes of each part
};
// Returns the contents of a file with the given levels.
UbszParts pack_ubsz_levels(std::span<const UbszLevel> levels, std::span<const std::string> comments);

// Returns the contents of a file with the model. `steps` has one entry per group; if it is empty, the model
// is stored exactly. Throws Error(numerical) if a value is not finite.
std::vector<std::byte> pack_ubsz(const MixedModel& model, std::span<const std::string> comments,
                                 std::span<const UbszSteps> steps = {});

// These two functions read a model. If the data are damaged in any way, they throw Error(data) with a message
// that starts with `name` or with the name of the file.
MixedModel unpack_ubsz(std::span<const std::byte> bytes, const std::string& name,
                       std::vector<std::string>* comments = nullptr);
MixedModel read_ubsz(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

}  // namespace ubs
