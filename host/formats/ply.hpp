// SPDX-License-Identifier: Apache-2.0
// These functions read and write splat files in the format of the published code (method.md 5.1). This is a
// PLY file of the format binary_little_endian with one element `vertex`. Its float32 properties are raw
// values in the order of ParameterLayout. The reader finds properties by name, accepts them in any order and
// with any scalar type, ignores unknown properties and infers N from the scale_* properties. The variant of
// the method (model_variant.hpp) is recorded in comment lines `ubs <key> <value>`; files of the published
// variant have no such lines. Models with splats of several dimensions have groups. The first group is the
// element vertex, so that other tools find splats that they can read; the other groups are elements
// vertex_<N>d after it. A comment line `ubs groups 7,6,3` lists all groups. Because of this line, ubs
// versions that do not support groups refuse the file instead of rendering a part of it.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

// Reads a model of one group. `comments`, if passed, receives the other comment lines of the header, without
// the word "comment ". Throws Error(data) for unknown keys or values, for properties that do not fit the
// variant, and for files with several groups.
SplatModel read_splat_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

// Reads a model of one or several groups. `remarks`, if passed, receives a sentence for each part of the file
// that the model does not use: unknown properties, and further elements.
MixedModel read_mixed_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr,
                          std::vector<std::string>* remarks = nullptr);

// For a model of the published variant, writes the same bytes as the published code. In addition, writes one
// comment line for each entry of `comments`, and the lines `ubs <key> <value>` of other variants; the
// published code ignores comments. If a value is not finite, throws and writes nothing.
void write_splat_ply(const std::filesystem::path& path, const SplatModel& model,
                     std::span<const std::string> comments = {});
// For a model with one group, writes the same file as write_splat_ply.
void write_mixed_ply(const std::filesystem::path& path, const MixedModel& model,
                     std::span<const std::string> comments = {});
// Returns the size of the file that write_mixed_ply() writes.
std::size_t mixed_ply_bytes(const MixedModel& model, std::span<const std::string> comments = {});

}  // namespace ubs
