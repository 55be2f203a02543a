// SPDX-License-Identifier: Apache-2.0
// A model in one small file (.ubsz), which browsers read as well (host/look/web): parameters as they are, or
// rounded to multiples of steps, ordered so that they compress. docs/web.md has the layout.
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
inline constexpr int kUbszCoarsest = 5;  // splats of class k have steps 2^k times as large, k up to this

// How one group is rounded. The three places must have one step.
struct UbszSteps {
  std::vector<double> steps;          // one a row of parameters, > 0
  std::vector<std::uint8_t> classes;  // one a splat
};

// What a reader gets back: the values rounded, the splats in their order in the file.
SplatModel rounded(const SplatModel& model, const UbszSteps& steps);

// A part of the splats, of each group; with those of the parts before it a picture of the whole.
struct UbszLevel {
  MixedModel model;
  std::vector<UbszSteps> steps;  // as for pack_ubsz
  double psnr = 0;               // of the pictures so far, which the header says [dB]
};
// Bytes of the file's parts: its header and first level, then each level. Readers that have the first parts
// can show them.
struct UbszParts {
  std::vector<std::byte> bytes;
  std::vector<std::size_t> sizes;
};
UbszParts pack_ubsz_levels(std::span<const UbszLevel> levels, std::span<const std::string> comments);

// `steps`: one a group, or none for a model that comes back to the bit. Throws Error(numerical) for values
// that are not finite.
std::vector<std::byte> pack_ubsz(const MixedModel& model, std::span<const std::string> comments,
                                 std::span<const UbszSteps> steps = {});

// Damage of any kind is Error(data) that starts with `name`.
MixedModel unpack_ubsz(std::span<const std::byte> bytes, const std::string& name,
                       std::vector<std::string>* comments = nullptr);
MixedModel read_ubsz(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

}  // namespace ubs
