// SPDX-License-Identifier: Apache-2.0
// Reads streamed SOG; see foreign_formats.hpp. lod-meta.json contains the names of SOG files (`filenames`)
// and a spatial tree (`tree`). A node of the tree has `children` or `lods`. `lods` states, for each level of
// detail, the file and the range of splats that the node shows. Level 0 is the finest. `environment` is the
// name of a SOG file that is always shown.
#include <algorithm>
#include <charconv>
#include <compare>
#include <map>
#include <optional>
#include <set>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

struct LodRange {
  std::size_t file = 0, offset = 0, count = 0;
  auto operator<=>(const LodRange&) const = default;
};
using LodRanges = std::map<std::size_t, std::vector<LodRange>>;  // the key is the level of detail

void collect_ranges(const Json& node, LodRanges& ranges, const std::string& name) {
  if (node.contains("children"))
    for (const Json& child : node["children"]) collect_ranges(child, ranges, name);
  if (!node.contains("lods")) return;
  for (const auto& [key, range] : node["lods"].items()) {
    std::size_t level = 0;
    const auto result = std::from_chars(key.data(), key.data() + key.size(), level);
    if (result.ec != std::errc() || result.ptr != key.data() + key.size())
      fail(ErrorKind::data, "{}: level '{}' of a node is not a number", name, key.substr(0, 40));
    ranges[level].push_back({range.at("file").get<std::size_t>(), range.at("offset").get<std::size_t>(),
                             range.at("count").get<std::size_t>()});
  }
}

void append_ranges(std::optional<ImportedSplats>& splats, const ImportedSplats& file,
                   std::span<const LodRange> ranges, const std::string& name) {
  std::size_t end = 0;
  for (const LodRange& range : ranges) {
    if (range.offset < end || range.offset > file.count() || range.count > file.count() - range.offset)
      fail(ErrorKind::data,
           "{}: splats {} to {} of a node overlap other nodes or are not in {}, which has {} splats", name,
           range.offset, range.offset + range.count, file.report.folder, file.count());
    end = range.offset + range.count;
  }
  // Join adjacent ranges, so that fewer parts are appended. The ranges of the nodes usually cover the whole
  // file.
  std::vector<LodRange> joined;
  for (const LodRange& range : ranges)
    if (!joined.empty() && joined.back().offset + joined.back().count == range.offset)
      joined.back().count += range.count;
    else
      joined.push_back(range);
  for (const LodRange& range : joined) {
    ImportedSplats part = part_of(file, range.offset, range.count);
    if (splats)
      append(*splats, part);
    else
      splats = std::move(part);
  }
}

}  // namespace

ImportedSplats read_streamed_sog(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::optional<ImportedSplats> splats;
  std::size_t levels = 0, level = 0, files = 0;
  bool environment = false;
  try {
    const Json meta = parse_json(read_text_file(path), name);
    const auto names = meta.at("filenames").get<std::vector<std::string>>();
    // The memory would otherwise depend on how often a file is listed, and not on its size.
    if (std::set<std::string>(names.begin(), names.end()).size() < names.size())
      fail(ErrorKind::data, "{}: 'filenames' lists a file twice", name);
    LodRanges all;
    collect_ranges(meta.at("tree"), all, name);
    if (all.empty()) fail(ErrorKind::data, "{}: the tree has no level of detail", name);
    std::vector<LodRange>& ranges = all.begin()->second;
    level = all.begin()->first;
    levels = std::max(all.size(), meta.value("lodLevels", std::size_t{0}));
    std::ranges::sort(ranges);
    for (auto begin = ranges.begin(); begin != ranges.end(); ++files) {
      const auto end =
          std::find_if(begin, ranges.end(), [&](const LodRange& r) { return r.file != begin->file; });
      if (begin->file >= names.size())
        fail(ErrorKind::data, "{}: a node refers to file {}, but only the files 0 to {} are listed", name,
             begin->file, names.size() - 1);
      append_ranges(splats, load_sog(file_beside(path, names[begin->file])), std::span(begin, end), name);
      begin = end;
    }
    if (meta.contains("environment") && meta["environment"].is_string()) {
      append(*splats, load_sog(file_beside(path, meta["environment"].get<std::string>())));
      environment = true;
    }
  } catch (const nlohmann::json::exception& error) {
    fail(ErrorKind::data, "{}: lod-meta.json does not match the format: {}", name, error.what());
  }
  splats->report.layout = "streamed SOG";
  splats->report.folder = name;
  splats->report.note(fmt::format("using level {} of {}, the finest, from {} files{}", level, levels, files,
                                  environment ? ", and the environment" : ""));
  clean(*splats);
  return std::move(*splats);
}

}  // namespace ubs
