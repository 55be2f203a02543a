// SPDX-License-Identifier: Apache-2.0
// Reads and writes 3DGS and DBS files (method.md 5.2, 5.3); see foreign_formats.hpp.
#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kOffsetWords = "ubs_offset ";

int degree_of_rest(std::size_t rest, const std::string& prefix, const std::string& name) {
  for (int degree = 0; degree <= 4; ++degree)
    if (rest == 3u * static_cast<std::size_t>((degree + 1) * (degree + 1) - 1)) return degree;
  fail(ErrorKind::data, "{}: {} {}* properties: expected 0, 9, 24, 45 or 72", name, rest, prefix);
}

// Names holds the prefixes of the names of the properties that store spherical harmonics: `dc` for the
// constant coefficients and `rest` for the others. 3DGS and DBS files use different prefixes.
struct Names {
  std::string dc, rest;
};
Names names_of(SpatialKernel kernel) {
  if (kernel == SpatialKernel::beta) return {"sh0_", "shN_"};
  if (kernel == SpatialKernel::gaussian) return {"f_dc_", "f_rest_"};
  fail(ErrorKind::internal, "PLY files of other programs cannot store the kernel {}", row_of(kernel).name);
}

// Returns the number of spherical Beta lobes per splat of a DBS file, which stores `values` lobe parameters
// per splat. ubs can only render 1 to 3 lobes, and only together with spherical harmonics of degree 0. (By
// default, DBS trains with degree 0.) For other files with lobes, adds a note and returns 0.
int lobes_of(std::size_t values, ImportedSplats& splats) {
  if (values == 0) return 0;
  if (values % 6 == 0 && values <= 18 && splats.sh_degree == 0) return static_cast<int>(values / 6);
  splats.report.note(
      fmt::format("the spherical Beta lobes of the colours are dropped: each splat has {} lobe values and "
                  "spherical harmonics of degree {}, but only 6, 12 or 18 values with degree 0 are supported",
                  values, splats.sh_degree));
  return 0;
}

std::size_t count_numbered(const PlyHeader& header, const std::string& stem) {
  std::size_t n = 0;
  while (header.find(stem + std::to_string(n))) ++n;
  return n;
}

class Columns {
 public:
  Columns(const PlyHeader& header, std::string name) : header_(header), name_(std::move(name)) {}

  std::size_t add(const std::string& property) {
    const PlyProperty* found = header_.find(property);
    if (!found) fail(ErrorKind::data, "{}: property '{}' is missing", name_, property);
    properties_.push_back(found);
    return properties_.size() - 1;
  }

  // Reads all rows. Afterwards the position of the stream is after the last row.
  void read(std::ifstream& stream) {
    table_.resize(properties_.size() * header_.count);
    std::vector<float*> rows;
    for (std::size_t r = 0; r < properties_.size(); ++r) rows.push_back(table_.data() + r * header_.count);
    read_ply_rows(stream, header_, properties_, rows, name_, NonFinite::keep);
  }

  float operator()(std::size_t column, std::size_t i) const { return table_[column * header_.count + i]; }

  const std::vector<const PlyProperty*>& properties() const { return properties_; }

 private:
  const PlyHeader& header_;
  std::string name_;
  std::vector<const PlyProperty*> properties_;
  std::vector<float> table_;
};

// Returns whether numbers of this type can have more significant bits than the 24 of a float32. Georeferenced
// coordinates need more.
bool finer_than_float(PlyType type) {
  return type == PlyType::float64 || type == PlyType::int32 || type == PlyType::uint32;
}

// KnownColumns describes columns that another method adds to those of 3DGS. `one` is the name of one of these
// columns, and `meaning` is the note for files that contain it.
struct KnownColumns {
  const char* one;
  const char* meaning;
};
constexpr KnownColumns kKnownColumns[] = {
    {"motion_0",
     "these are splats of SpacetimeGaussians, whose motion is not supported: all splats are static"},
    {"filter_3D",
     "these are splats of Mip-Splatting, whose 3D filter is ignored: use the file that its script "
     "create_fused_ply.py writes, which includes the filter"},
};

bool is_blank(char c) { return c == ' ' || c == ':' || c == '=' || c == '\t' || c == '\r'; }

// Returns the value that follows a key at the start of a comment, in lower case. Ignores case, as other
// readers do. Returns an empty string if the comment does not start with the key.
std::string value_of(std::string_view comment, std::string_view key) {
  std::string small(comment);
  std::ranges::transform(small, small.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c; });
  std::erase_if(small, [](char c) { return c == '\r'; });
  const std::size_t begin = small.find_first_not_of(" \t");
  if (begin == std::string::npos || !std::string_view(small).substr(begin).starts_with(key)) return {};
  std::size_t at = begin + key.size();
  if (at < small.size() && !is_blank(small[at])) return {};
  while (at < small.size() && is_blank(small[at])) ++at;
  return small.substr(at, small.find_last_not_of(" \t") + 1 - at);
}

}  // namespace

bool antialias_comment(std::span<const std::string> comments, LoadReport& report) {
  bool antialiased = false;
  for (const std::string& comment : comments) {
    if (const std::string flag = value_of(comment, "antialiased"); !flag.empty())  // Postshot
      antialiased = flag != "0" && flag != "false";
    const std::string mode = value_of(comment, "splatrendermode");  // Brush, gsplat
    if (mode.empty()) continue;
    antialiased = mode == "mip" || mode == "antialiased";
    if (!antialiased && mode != "default" && mode != "classic" && mode != "2dgs")
      report.note(fmt::format("the comment '{}' is ignored, because its render mode is unknown",
                              comment.substr(0, 80)));
  }
  if (antialiased) report.note("the splats were trained with antialiasing");
  return antialiased;
}

std::array<double, 3> offset_comment(std::span<const std::string> comments, const std::string& name) {
  for (const std::string& comment : comments) {
    if (!comment.starts_with(kOffsetWords)) continue;
    std::array<double, 3> offset{};
    const char* at = comment.data() + kOffsetWords.size();
    const char* const end = comment.data() + comment.size();
    for (double& value : offset) {
      while (at != end && *at == ' ') ++at;
      const auto result = std::from_chars(at, end, value);
      if (result.ec != std::errc() || !std::isfinite(value))
        fail(ErrorKind::data, "{}: comment '{}' must contain three numbers", name, comment.substr(0, 80));
      at = result.ptr;
    }
    return offset;
  }
  return {0, 0, 0};
}

std::string make_offset_comment(const std::array<double, 3>& o) {
  return fmt::format("ubs_offset {} {} {}", o[0], o[1], o[2]);
}

ImportedSplats read_gaussian_ply(const fs::path& path) {
  const std::string name = path.string();
  PlyHeader header;
  std::ifstream stream = open_ply(path, header, true);
  const bool dbs = header.find("sh0_0") != nullptr;
  const Names names = names_of(dbs ? SpatialKernel::beta : SpatialKernel::gaussian);
  const std::size_t rest = count_numbered(header, names.rest);
  // nerfstudio can write one colour per splat instead of harmonics.
  const bool rgb = !header.find(names.dc + "0") && header.find("red");

  ImportedSplats splats;
  splats.kernel = dbs ? SpatialKernel::beta : SpatialKernel::gaussian;
  splats.sh_degree = degree_of_rest(rest, names.rest, name);
  splats.lobes = lobes_of(count_numbered(header, "sb_params_"), splats);
  splats.offset = offset_comment(header.comments, name);
  splats.antialiased = antialias_comment(header.comments, splats.report);
  for (const char* channel : {"red", "green", "blue"})
    if (const PlyProperty* found = header.find(channel); rgb && found && found->type != PlyType::uint8)
      fail(ErrorKind::data,
           "{}: property '{}' must have the type uchar: it is used as the colour, because the file has no "
           "property '{}0'",
           name, channel, names.dc);
  // 2DGS files have discs with two scales. If scale_1 or rot_3 is missing too, the file is not a 2DGS
  // file, and the error message names the first missing column.
  const bool flat = !dbs && !header.find("scale_2") && header.find("scale_1") && header.find("rot_3");
  if (flat) splats.report.note("the file has no scale_2: its splats are flat, as in 2D Gaussian Splatting");
  // Isotropic Gaussians (such as those of MonoGS) have one scale for all axes.
  const bool isotropic = !dbs && header.find("scale_0") && !header.find("scale_1") && !header.find("scale_2");
  if (isotropic) splats.report.note("the file has only scale_0: its splats are spheres");
  Columns columns(header, name);
  for (const char* property : {"x", "y", "z", "scale_0", isotropic ? "scale_0" : "scale_1",
                               isotropic ? "scale_0"
                               : flat    ? "scale_1"
                                         : "scale_2",
                               "rot_0", "rot_1", "rot_2", "rot_3", "opacity"}) {
    columns.add(property);
  }
  const std::size_t beta = dbs ? columns.add("beta") : 0;
  const std::size_t dc = columns.add(rgb ? "red" : names.dc + "0");
  columns.add(rgb ? "green" : names.dc + "1"), columns.add(rgb ? "blue" : names.dc + "2");
  for (std::size_t i = 0; i < rest; ++i) columns.add(names.rest + std::to_string(i));
  const std::size_t lobes = dc + 3 + rest;
  for (std::size_t i = 0; i < splats.lobe_values(); ++i) columns.add("sb_params_" + std::to_string(i));
  // Coordinates may be integers, and so are colours as bytes. Other integers are codes of a quantisation.
  for (const PlyProperty* property : columns.properties()) {
    const bool real = property->type == PlyType::float32 || property->type == PlyType::float64;
    if (!real && property->name.size() > 1 && !(rgb && property->type == PlyType::uint8))
      fail(ErrorKind::data,
           "{}: property '{}' has an integer type, so the file is quantised in a way that it does not state: "
           "export the splats with properties of type float",
           name, property->name);
  }
  const auto rows = stream.tellg();
  columns.read(stream);

  splats.resize(header.count);
  const std::size_t coefficients = splats.coefficients(), higher = coefficients - 1;
  for (std::size_t i = 0; i < header.count; ++i) {
    splats.positions[i] = {columns(0, i), columns(1, i), columns(2, i)};
    splats.log_scales[i] = {columns(3, i), columns(4, i), flat ? kFlatLogScale : columns(5, i)};
    splats.rotations[i] = {columns(6, i), columns(7, i), columns(8, i), columns(9, i)};
    splats.opacity_logits[i] = columns(10, i);
    if (dbs) splats.betas[i] = columns(beta, i);
    float* sh = &splats.sh[i * 3 * coefficients];
    for (std::size_t c = 0; c < 3; ++c) {
      sh[c] = columns(dc + c, i);
      if (rgb) sh[c] = static_cast<float>((sh[c] / 255.0 - 0.5) / kShC0);
      for (std::size_t k = 0; k < higher; ++k) sh[3 * (k + 1) + c] = columns(dc + 3 + c * higher + k, i);
    }
    const std::size_t n = splats.lobe_values();
    for (std::size_t k = 0; k < n; ++k) splats.sb[i * n + k] = columns(lobes + k, i);
  }
  splats.report.layout = dbs ? "DBS PLY" : "3DGS PLY";
  splats.report.folder = name;
  if (splats.sh_degree > 3) splats.report.note("spherical harmonics of degree 4 are dropped");
  const std::vector<const PlyProperty*> used = columns.properties();
  // In ASCII files, coordinates may have more digits than the type in the header can hold.
  if (header.ascii ||
      std::ranges::any_of(used.begin(), used.begin() + 3, finer_than_float, &PlyProperty::type)) {
    Coordinates coordinates;
    for (auto& axis : coordinates) axis.resize(header.count);
    stream.clear();
    stream.seekg(rows);
    read_ply_rows(stream, header, {used[0], used[1], used[2]},
                  std::vector<double*>{coordinates[0].data(), coordinates[1].data(), coordinates[2].data()},
                  name, NonFinite::keep);
    place(splats, coordinates);
  }
  for (const std::string& remark : unused_properties(header, used)) splats.report.note(remark);
  for (const KnownColumns& known : kKnownColumns)
    if (header.find(known.one)) splats.report.note(known.meaning);
  for (const std::string& remark : unused_elements(header, 1)) splats.report.note(remark);
  clean(splats);
  return splats;
}

void write_gaussian_ply(const fs::path& path, const ImportedSplats& splats) {
  require_splats(path, splats);
  const int degree = std::min(splats.sh_degree, 3);
  const std::size_t coefficients = splats.coefficients();
  const std::size_t higher = static_cast<std::size_t>((degree + 1) * (degree + 1)) - 1;
  std::string header = "ply\nformat binary_little_endian 1.0\n";
  if (splats.offset != std::array<double, 3>{})
    header += "comment " + make_offset_comment(splats.offset) + "\n";
  if (splats.antialiased)  // the first comment is that of Brush and gsplat, the second that of Postshot
    header += "comment SplatRenderMode: mip\ncomment antialiased 1\n";
  header += fmt::format("element vertex {}\n", splats.count());
  const auto property = [&header](const std::string& p) { header += "property float " + p + "\n"; };
  const auto numbered = [&](const std::string& stem, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) property(stem + std::to_string(k));
  };
  const Names names = names_of(splats.kernel);
  const std::size_t lobes = splats.kernel == SpatialKernel::beta ? splats.lobe_values() : 0;
  for (const char* p : {"x", "y", "z", "nx", "ny", "nz"}) property(p);
  numbered(names.dc, 3);
  numbered(names.rest, 3 * higher);
  numbered("sb_params_", lobes);
  property("opacity");
  if (splats.kernel == SpatialKernel::beta) property("beta");
  numbered("scale_", 3);
  numbered("rot_", 4);
  AtomicFile file(path);
  file.write(header + "end_header\n");
  std::vector<float> row;
  for (std::size_t i = 0; i < splats.count(); ++i) {
    const float* sh = &splats.sh[i * 3 * coefficients];
    row.assign(splats.positions[i].begin(), splats.positions[i].end());
    row.insert(row.end(), {0, 0, 0, sh[0], sh[1], sh[2]});
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 1; k <= higher; ++k) row.push_back(sh[3 * k + c]);
    row.insert(row.end(), splats.sb.begin() + static_cast<std::ptrdiff_t>(i * lobes),
               splats.sb.begin() + static_cast<std::ptrdiff_t>((i + 1) * lobes));
    row.push_back(splats.opacity_logits[i]);
    if (!splats.betas.empty()) row.push_back(splats.betas[i]);
    row.insert(row.end(), splats.log_scales[i].begin(), splats.log_scales[i].end());
    row.insert(row.end(), splats.rotations[i].begin(), splats.rotations[i].end());
    file.write(std::as_bytes(std::span(row)));
  }
  file.commit();
}

}  // namespace ubs
