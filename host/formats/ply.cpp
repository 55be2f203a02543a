// SPDX-License-Identifier: Apache-2.0
// See ply.hpp.
#include "host/formats/ply.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string_view>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/text.hpp"
#include "host/formats/ply_header.hpp"

namespace ubs {

namespace {

// Returns the number of properties called "<stem>_<digits>".
int count_numbered(const PlyElement& header, const std::string& stem) {
  return static_cast<int>(
      std::count_if(header.properties.begin(), header.properties.end(), [&](const auto& p) {
        const std::string& name = p.name;
        return name.size() > stem.size() + 1 && name.starts_with(stem + "_") &&
               std::all_of(name.begin() + static_cast<std::ptrdiff_t>(stem.size()) + 1, name.end(),
                           [](char c) { return c >= '0' && c <= '9'; });
      }));
}

// Returns a hint for other formats that also have scale_* properties, because users often pass such files by
// mistake.
std::string foreign_format_hint(const PlyElement& header) {
  if (header.find("sb_params_0")) return " (this looks like a DBS file)";
  if (header.find("f_dc_0")) return " (this looks like a 3D Gaussian splatting file)";
  return "";
}

int infer_dimension(const PlyElement& header, const std::string& name) {
  // Models with direct conditioning have precisions instead of query scales.
  const int query = count_numbered(header, "precision") > 0 ? count_numbered(header, "mean") : 0;
  const int dim = count_numbered(header, "scale") + query;
  if (dim < kMinDim || dim > kMaxDim)
    fail(ErrorKind::data, "{}: the file has {} scale_* properties, but must have {} to {}", name, dim,
         kMinDim, kMaxDim);
  return dim;
}

std::vector<const PlyProperty*> match_properties(const PlyElement& header, const ParameterLayout& layout,
                                                 const std::string& name) {
  std::vector<const PlyProperty*> matched;
  for (const std::string& wanted : layout.property_names()) {
    matched.push_back(header.find(wanted));
    if (!matched.back())
      fail(ErrorKind::data, "{}: property '{}' is missing for N = {}{}", name, wanted, layout.dim,
           foreign_format_hint(header));
  }
  // If a file has more properties of a known kind than expected, it has another variant or dimension.
  const std::vector<std::string> names = layout.property_names();
  for (const char* stem : {"beta", "mean", "l_triangle", "precision", "theta", "rot", "f_dc", "f_rest"}) {
    const auto expected = static_cast<int>(std::ranges::count_if(
        names, [&](const std::string& n) { return n.substr(0, n.rfind('_')) == stem; }));
    const bool of_every_model =
        stem == std::string("beta") || stem == std::string("mean") || stem == std::string("l_triangle");
    const int found = count_numbered(header, stem);
    if (found != expected && (of_every_model || expected > 0))
      fail(ErrorKind::data, "{}: {} {}_* properties, but N = {} (number of scale_*) needs {}{}", name, found,
           stem, layout.dim, expected,
           layout.variant == ModelVariant{} ? "" : " (" + to_string(layout.variant) + ")");
  }
  return matched;
}

constexpr std::string_view kSwitchPrefix = "ubs ";

// Parses the lines `ubs <key> <value>` and removes them from the comments.
ModelVariant take_variant(std::vector<std::string>& comments, const std::string& name) {
  ModelVariant variant;
  std::vector<std::string> keys;
  std::erase_if(comments, [&](const std::string& comment) {
    if (!comment.starts_with(kSwitchPrefix)) return false;
    std::istringstream words(comment.substr(kSwitchPrefix.size()));
    std::string key, value, surplus;
    words >> key >> value;
    if (value.empty() || words >> surplus)
      fail(ErrorKind::data, "{}: comment '{}' is not 'ubs <key> <value>'", name, comment);
    if (std::ranges::find(keys, key) != keys.end())
      fail(ErrorKind::data, "{}: comment '{}' sets {} a second time", name, comment, key);
    set_switch(variant, key, value, fmt::format("{}: comment '{}'", name, comment));
    keys.push_back(key);
    return true;
  });
  return variant;
}

// Returns the layout for this dimension and variant. If they contradict each other, throws Error(data),
// because they are read from a file.
ParameterLayout file_layout(int dim, const ModelVariant& variant, const std::string& name) {
  try {
    return ParameterLayout(dim, variant);
  } catch (const Error& error) {
    fail(ErrorKind::data, "{}: {}", name, error.what());
  }
}

// ---- Groups of splats: the elements vertex and vertex_<N>d, and the comment that lists them ----

constexpr std::string_view kGroupsKey = "groups";

std::string group_element(const SplatModel& group, bool first) {
  return first ? "vertex" : fmt::format("vertex_{}d", group.dim);
}

bool is_group_element(const std::string& name) {
  return name.size() > 8 && name.starts_with("vertex_") && name.ends_with("d") &&
         std::all_of(name.begin() + 7, name.end() - 1, [](char c) { return c >= '0' && c <= '9'; });
}

std::string groups_text(std::span<const int> dims) { return fmt::format("{}", fmt::join(dims, ",")); }

// Returns the list that the comment line `ubs groups <list>` contains and removes this line from the
// comments. Returns an empty string if there is no such line.
std::string take_groups(std::vector<std::string>& comments, const std::string& name) {
  const std::string prefix = fmt::format("{}{} ", kSwitchPrefix, kGroupsKey);
  std::string text;
  std::erase_if(comments, [&](const std::string& comment) {
    if (!comment.starts_with(prefix)) return false;
    if (!text.empty())
      fail(ErrorKind::data, "{}: comment '{}' lists the groups a second time", name, comment);
    text = comment.substr(prefix.size());
    return true;
  });
  return text;
}

// Returns the elements that hold splats; the first one is `vertex`. A file without groups has only one.
std::vector<PlyElement> splat_elements(const PlyHeader& header) {
  std::vector<PlyElement> elements;
  for (const PlyElement& element : header.elements)
    if (elements.empty() || is_group_element(element.name)) elements.push_back(element);
  return elements;
}

void check_group_elements(const PlyHeader& header, const std::vector<PlyElement>& elements,
                          const std::string& listed, const std::string& name) {
  if (elements.size() == 1 && listed.empty()) return;
  std::vector<int> dims;
  for (const PlyElement& element : elements) {
    const int dim = infer_dimension(element, name);
    if (std::ranges::find(dims, dim) != dims.end())
      fail(ErrorKind::data, "{}: there are two groups of splats with N = {} ('{}')", name, dim, element.name);
    dims.push_back(dim);
    if (dims.size() > 1 && element.name != fmt::format("vertex_{}d", dim))
      fail(ErrorKind::data, "{}: element '{}' has the properties of N = {}", name, element.name, dim);
  }
  if (listed != groups_text(dims))
    fail(ErrorKind::data, "{}: the comment lists the groups '{}', but the elements have N = {}", name, listed,
         groups_text(dims));
  if (elements.size() != header.elements.size())
    fail(ErrorKind::data, "{}: other elements are between or after the groups of splats", name);
}

std::string header_text(std::span<const SplatModel> groups, std::span<const std::string> comments) {
  std::string text = "ply\nformat binary_little_endian 1.0\n";
  for (const auto& [key, value] : non_default_switches(groups.front().variant))
    text += fmt::format("comment {}{} {}\n", kSwitchPrefix, key, value);
  if (groups.size() > 1) {
    std::vector<int> dims;
    for (const SplatModel& group : groups) dims.push_back(group.dim);
    text += fmt::format("comment {}{} {}\n", kSwitchPrefix, kGroupsKey, groups_text(dims));
  }
  for (const std::string& comment : comments) {
    if (comment.starts_with(kSwitchPrefix))
      fail(ErrorKind::internal, "PLY comment '{}' would be read as a setting of the model", comment);
    text += "comment " + encode_text(comment) + "\n";
  }
  for (const SplatModel& group : groups) {
    text += fmt::format("element {} {}\n", group_element(group, &group == &groups.front()), group.count);
    for (const std::string& property : group.layout().property_names())
      text += "property float " + property + "\n";
  }
  return text + "end_header\n";
}

void check_writable(const SplatModel& model, const std::filesystem::path& path) {
  const ParameterLayout layout = model.layout();
  if (model.values.size() != static_cast<std::size_t>(layout.count) * model.count)
    fail(ErrorKind::internal, "{}: the model has {} values, but {} splats with N = {} need {}", path.string(),
         model.values.size(), model.count, model.dim, static_cast<std::size_t>(layout.count) * model.count);
  const auto bad =
      std::find_if(model.values.begin(), model.values.end(), [](float v) { return !std::isfinite(v); });
  if (bad == model.values.end()) return;
  const std::size_t at = static_cast<std::size_t>(bad - model.values.begin());
  fail(ErrorKind::numerical, "{}: the file is not written: in splat {}, '{}' is {}", path.string(),
       at % model.count, layout.property_names()[at / model.count], *bad);
}

// Writes the vertices. One block of vertices at a time is transposed, to limit the additional memory.
void write_rows(AtomicFile& file, const SplatModel& model) {
  const std::size_t rows = static_cast<std::size_t>(model.layout().count);
  constexpr std::size_t kBlock = 4096;
  std::vector<float> block(rows * std::min(kBlock, model.count));
  for (std::size_t first = 0; first < model.count; first += kBlock) {
    const std::size_t n = std::min(kBlock, model.count - first);
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t i = 0; i < n; ++i) block[i * rows + r] = model.values[r * model.count + first + i];
    file.write(std::as_bytes(std::span(block.data(), n * rows)));
  }
}

void write_groups(const std::filesystem::path& path, std::span<const SplatModel> groups,
                  std::span<const std::string> comments) {
  if (std::ranges::all_of(groups, [](const SplatModel& group) { return group.count == 0; }))
    fail(ErrorKind::data, "{}: there are no splats to write", path.string());
  for (const SplatModel& group : groups) check_writable(group, path);
  AtomicFile file(path);
  file.write(header_text(groups, comments));
  for (const SplatModel& group : groups) write_rows(file, group);
  file.commit();
}

}  // namespace

MixedModel read_mixed_ply(const std::filesystem::path& path, std::vector<std::string>* comments,
                          std::vector<std::string>* remarks) {
  const std::string name = path.string();
  PlyHeader header;
  std::ifstream stream = open_ply(path, header);
  const std::string listed = take_groups(header.comments, name);
  const std::vector<PlyElement> elements = splat_elements(header);
  check_group_elements(header, elements, listed, name);
  if (elements.size() > 1) stream = open_ply_elements(path, header);  // checks the size of all elements
  const ModelVariant variant = [&] {
    std::vector<std::string> lines = header.comments;
    take_groups(lines, name);
    const ModelVariant taken = take_variant(lines, name);
    if (comments)
      for (const std::string& line : lines) comments->push_back(decode_text(line));
    return taken;
  }();
  if (remarks) *remarks = unused_elements(header, elements.size());
  MixedModel model{std::vector<SplatModel>{}};
  for (const PlyElement& element : elements) {
    const int dim = infer_dimension(element, name);
    static_cast<PlyElement&>(header) = element;
    const auto properties = match_properties(header, file_layout(dim, variant, name), name);
    SplatModel& group = model.groups.emplace_back(dim, element.count, variant);
    std::vector<float*> rows;
    for (int r = 0; r < group.layout().count; ++r) rows.push_back(group.row(r).data());
    read_ply_rows(stream, header, properties, rows, name);
    if (remarks)
      for (std::string& remark : unused_properties(element, properties))
        remarks->push_back(std::move(remark));
  }
  return model;
}

SplatModel read_splat_ply(const std::filesystem::path& path, std::vector<std::string>* comments) {
  MixedModel model = read_mixed_ply(path, comments);
  if (model.mixed())
    fail(ErrorKind::data,
         "{}: contains splats of different dimensions ({}), but this command supports only one",
         path.string(), to_string(model));
  return std::move(model.groups.front());
}

void write_mixed_ply(const std::filesystem::path& path, const MixedModel& model,
                     std::span<const std::string> comments) {
  check_groups(model);
  write_groups(path, model.groups, comments);
}

std::size_t mixed_ply_bytes(const MixedModel& model, std::span<const std::string> comments) {
  return header_text(model.groups, comments).size() + sizeof(float) * model.parameters();
}

void write_splat_ply(const std::filesystem::path& path, const SplatModel& model,
                     std::span<const std::string> comments) {
  write_groups(path, std::span(&model, 1), comments);
}

}  // namespace ubs
