// SPDX-License-Identifier: Apache-2.0
// A data set in one file (.ubsd): cameras, 8-bit images as they are trained on (composited and reduced),
// their masks, points to start from, all with checksums. Reads fast, and without an image library. Layout,
// little-endian:
//   "UBSDATA\x1a" | u32 version | u32 CRC-32 of the header | u64 bytes of the header | header (JSON) | blocks
// The header names each block by its offset behind the header, its size and its CRC-32. Version 1 has no
// masks, version 2 a block "mask" (one byte a pixel, 0 = does not count) with the views that have one; files
// without are of version 1.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct PackedData {
  std::vector<Split> splits;
  std::optional<PointCloud> points;
  std::array<double, 3> background{0, 0, 0};        // that the images were composited on
  int downscale = 1;                                // by which they were reduced
  std::array<double, 3> offset{0, 0, 0};            // world = local + offset; cameras and points are local
  std::vector<std::array<double, 2>> depth_bounds;  // near, far of each training view, or empty
};

// Images are loaded twice, one at a time: the header, which comes first, has the checksums of all.
// Throws Error(data) where an image is another one the second time.
void write_packed(const std::filesystem::path& path, const PackedData& data);

// By its first bytes; false for folders and for what cannot be read.
bool is_packed(const std::filesystem::path& path);

// What a packed file holds; images are read on request and one split at a time. Damage of any kind is
// Error(data) naming the file and the part.
class PackedFile {
 public:
  explicit PackedFile(std::filesystem::path path);

  // Every image is empty.
  Split split(const std::string& name) const;
  std::optional<PointCloud> points() const;
  const std::array<double, 3>& background() const { return background_; }
  bool opaque() const;  // nothing of the background is in any image
  int downscale() const { return downscale_; }
  const std::array<double, 3>& offset() const { return offset_; }
  const std::vector<std::array<double, 2>>& depth_bounds() const { return depth_bounds_; }
  std::vector<std::string> split_names() const;
  // With images that are read when asked for; `file` lives as long as they do.
  static Split split_on_demand(const std::shared_ptr<const PackedFile>& file, const std::string& name);

 private:
  struct Block {
    std::uint64_t offset = 0, size = 0;
    std::uint32_t crc = 0;
  };
  struct PackedView {
    View view;  // without image
    std::optional<Block> image, mask;
  };
  struct PackedSplit {
    std::string name;
    std::vector<PackedView> views;
  };
  class Source;
  const PackedSplit& find(const std::string& name) const;
  Image8 load(const PackedView& view) const;
  void parse(const std::string& header, std::uint64_t blocks_bytes);
  std::vector<std::byte> read_block(const Block& block, const std::string& what) const;

  std::filesystem::path path_;
  std::uint64_t blocks_start_ = 0;
  std::vector<PackedSplit> splits_;
  std::optional<Block> points_;
  std::array<double, 3> background_{0, 0, 0};
  int downscale_ = 1;
  std::array<double, 3> offset_{0, 0, 0};
  std::vector<std::array<double, 2>> depth_bounds_;
};

}  // namespace ubs
