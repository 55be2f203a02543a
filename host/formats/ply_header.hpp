// SPDX-License-Identifier: Apache-2.0
// PlyHeader is the header of a PLY file whose format is binary_little_endian or ascii. The functions of this
// file read the header, and the scalar properties of elements as float or double. They are used to read splat
// files and point clouds.
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
  std::size_t offset;  // position in a row of a binary file [bytes]
};

struct PlyElement {
  std::string name;
  std::vector<PlyProperty> properties;  // in file order
  std::size_t count = 0;                // number of rows
  std::size_t stride = 0;               // bytes per row in binary files
  // If true, the element has a list property. Its rows then have no fixed size and cannot be read.
  bool has_list = false;

  // Returns the property with this name, or null if there is none.
  const PlyProperty* find(const std::string& property) const;
};

// PlyHeader is derived from PlyElement and has the members of the first element, because most splat files and
// point clouds have only one element.
struct PlyHeader : PlyElement {
  // Contents of the comment lines, and of the obj_info lines, which some programs write instead.
  std::vector<std::string> comments;
  std::vector<PlyElement> elements;
  bool ascii = false;
  std::size_t lines = 0;  // number of lines of the header, for messages about rows of ASCII files
};

// Opens a file whose first element is `vertex` or `point`, reads its header and returns the stream, which is
// at the first vertex. Throws Error(data) if the file is not a PLY file, if the first element has list
// properties or two properties with the same name, or if the size of the file does not match the number of
// vertices. ASCII files are refused unless `allow_ascii` is set.
std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header, bool allow_ascii = false);

// Does the same for a binary file that may have several elements with any names. None of them may have a
// list.
std::ifstream open_ply_elements(const std::filesystem::path& path, PlyHeader& header);

enum class NonFinite { refuse, keep };

// Reads some properties of all rows of an element: `rows[r]` receives the values of properties[r]. Reads the
// element once, in blocks; afterwards the stream is after the element. If a value is not finite, throws an
// error that names the vertex and the property, unless `non_finite` is `keep`. Importers use `keep`, and
// later drop splats with such values.
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);
void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<double*>& rows,
                   const std::string& file_name, NonFinite non_finite = NonFinite::refuse);

// Returns the names as a list for a message. Three or more names with consecutive numbers are shortened to,
// for example, "motion_0 to motion_8".
std::string list_names(const std::vector<std::string>& names);

// Returns sentences that name all properties of an element except those in `used`. Normals are not named,
// because they are always zero in 3DGS files, and splats do not use them.
std::vector<std::string> unused_properties(const PlyElement& element,
                                           const std::vector<const PlyProperty*>& used);
// Returns sentences that name the elements after the first `used` elements, such as the faces of a mesh.
std::vector<std::string> unused_elements(const PlyHeader& header, std::size_t used);

// Returns the rows of a binary element as stored in the file; row i starts at byte i * stride.
std::vector<std::byte> read_ply_bytes(std::ifstream& stream, const PlyElement& element,
                                      const std::string& file_name);

}  // namespace ubs
