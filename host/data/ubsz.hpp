// SPDX-License-Identifier: Apache-2.0
// A .ubsz file holds a model in compact form, which browsers can read too (host/look/web). The parameters are
// stored exactly, or rounded to multiples of quantisation steps, in an order that compresses well.
// docs/web.md describes the layout.
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
inline constexpr int kMaxStepClass = 5;  // maximum class: splats of class k have steps 2^k times as large

// Quantisation of one group. The three rows of the position must have the same step.
struct UbszSteps {
  std::vector<double> steps;          // one per row of parameters, > 0
  std::vector<std::uint8_t> classes;  // one per splat
};

// Returns the model that a reader gets: rounded values, with the splats in file order.
SplatModel rounded(const SplatModel& model, const UbszSteps& steps);

// One level of detail: a part of the splats of each group. Together with the levels before it, it
// approximates the whole model.
struct UbszLevel {
  MixedModel model;
  std::vector<UbszSteps> steps;  // as for pack_ubsz
  double psnr = 0;               // quality of the levels so far, stored in the header [dB]
};
// A file in parts: header and first level, then each further level. `sizes` are the bytes of each part. A
// reader that has the first parts can show them.
struct UbszParts {
  std::vector<std::byte> bytes;
  std::vector<std::size_t> sizes;
};
UbszParts pack_ubsz_levels(std::span<const UbszLevel> levels, std::span<const std::string> comments);

// `steps` has one entry per group; if it is empty, the model is stored exactly. Throws Error(numerical) for
// values that are not finite.
std::vector<std::byte> pack_ubsz(const MixedModel& model, std::span<const std::string> comments,
                                 std::span<const UbszSteps> steps = {});

// If the data are damaged in any way, these two functions throw an Error(data) whose message starts with
// `name` or with the name of the file.
MixedModel unpack_ubsz(std::span<const std::byte> bytes, const std::string& name,
                       std::vector<std::string>* comments = nullptr);
MixedModel read_ubsz(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

}  // namespace ubs
