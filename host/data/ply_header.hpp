// SPDX-License-Identifier: Apache-2.0
// The part of PLY that our files need: the header of a binary_little_endian file, and the scalar
// properties of its element `vertex` as float. Shared by splat files, point clouds and importers.
#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace ubs {

enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

std::size_t ply_type_size(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type;
  std::size_t offset;  // from the start of a vertex [bytes]
};

struct PlyHeader {
  std::vector<std::string> comments;
  std::vector<PlyProperty> properties;  // of element vertex, in file order
  std::size_t count = 0;                // vertices
  std::size_t stride = 0;               // bytes per vertex

  const PlyProperty* find(const std::string& name) const;  // null when absent
};

// Opens the file, checks it (kind, list properties, duplicate names, size against the promised count)
// and leaves the stream at the first vertex.
std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header);

// One property of all vertices per row, `rows[r]` receiving properties[r]; reads the file once, in
// blocks. Non-finite values are an error that names vertex and property.
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name);

}  // namespace ubs
