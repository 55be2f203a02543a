// SPDX-License-Identifier: Apache-2.0
// The part of PLY that our files need: the header of a binary_little_endian or ascii file, and the
// scalar properties of its elements as float or double. Shared by splat files, point clouds, importers.
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

struct PlyElement {
  std::string name;
  std::vector<PlyProperty> properties;  // in file order
  std::size_t count = 0;                // rows
  std::size_t stride = 0;               // bytes per row (binary files)
  bool has_list = false;                // then its rows have no fixed size and cannot be read

  const PlyProperty* find(const std::string& property) const;  // null when absent
};

// The first element is also found directly in the header: splat files and point clouds have no other.
struct PlyHeader : PlyElement {
  std::vector<std::string> comments;  // and the lines obj_info, which some programs use for the same
  std::vector<PlyElement> elements;
  bool ascii = false;
  std::size_t lines = 0;  // of the header, for messages about ascii rows
};

// Opens the file, checks it (kind, list properties, duplicate names, size against the promised count)
// and leaves the stream at the first vertex. ascii files are refused unless `allow_ascii`.
std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header, bool allow_ascii = false);

// As open_ply for a binary file of several elements, all without lists, whatever their names.
std::ifstream open_ply_elements(const std::filesystem::path& path, PlyHeader& header);

enum class NonFinite { refuse, keep };

// One property of all rows of an element per output row, `rows[r]` receiving properties[r]; reads the
// element once, in blocks, and leaves the stream behind it. Non-finite values are an error that names
// vertex and property, unless they are to be kept (importers count and drop them).
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<double*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);

// Lists names for a message; numbered names that follow one another become "motion_0 to motion_8".
std::string list_names(const std::vector<std::string>& names);

// Returns a sentence for what a reader that takes only `used` leaves out of an element: its other properties.
// Normals are not mentioned: 3DGS files have them, always zero, and no splat has a use for them.
std::vector<std::string> unused_properties(const PlyElement& element,
                                           const std::vector<const PlyProperty*>& used);
// The same for the elements behind the first `used`, such as the faces of a mesh.
std::vector<std::string> unused_elements(const PlyHeader& header, std::size_t used);

// The rows of a binary element as they are in the file; row i starts at byte i * stride.
std::vector<std::byte> read_ply_bytes(std::ifstream& stream, const PlyElement& element,
                                      const std::string& file_name);

}  // namespace ubs
