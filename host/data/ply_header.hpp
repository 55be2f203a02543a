// SPDX-License-Identifier: Apache-2.0
// PlyHeader describes a PLY file as far as ubs needs it: the header of a binary_little_endian or ascii file.
// The functions of this file read the scalar properties of its elements as float or double. They are used for
// splat files, point clouds and importers.
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
  // If true, the rows have no fixed size and cannot be read.
  bool has_list = false;

  const PlyProperty* find(const std::string& property) const;  // null if there is none
};

// PlyHeader is itself the first element, because splat files and point clouds have no other.
struct PlyHeader : PlyElement {
  // Comment lines, and also obj_info lines, which some programs use instead.
  std::vector<std::string> comments;
  std::vector<PlyElement> elements;
  bool ascii = false;
  std::size_t lines = 0;  // number of lines of the header, for messages about ascii rows
};

// Opens the file, checks it (kind, list properties, duplicate names, size against the promised count) and
// leaves the stream at the first vertex. ascii files are refused unless `allow_ascii` is set.
std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header, bool allow_ascii = false);

// Like open_ply, but for a binary file with several elements of any names, all without lists.
std::ifstream open_ply_elements(const std::filesystem::path& path, PlyHeader& header);

enum class NonFinite { refuse, keep };

// Reads some properties of all rows of an element: `rows[r]` receives the values of properties[r]. Reads the
// element once, in blocks, and leaves the stream after it. A non-finite value is an error that names vertex
// and property, unless non_finite is `keep` (importers count such splats and drop them).
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<double*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);

// Returns the names as a list for a message; consecutive numbered names become "motion_0 to motion_8".
std::string list_names(const std::vector<std::string>& names);

// `used` are the properties of an element that a reader uses. Returns sentences that name all other
// properties. Normals are not mentioned: in 3DGS files they are always zero, and splats do not use them.
std::vector<std::string> unused_properties(const PlyElement& element,
                                           const std::vector<const PlyProperty*>& used);
// Returns sentences for the elements after the first `used` ones, such as the faces of a mesh.
std::vector<std::string> unused_elements(const PlyHeader& header, std::size_t used);

// Returns the rows of a binary element as stored in the file; row i starts at byte i * stride.
std::vector<std::byte> read_ply_bytes(std::ifstream& stream, const PlyElement& element,
                                      const std::string& file_name);

}  // namespace ubs
