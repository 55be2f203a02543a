// SPDX-License-Identifier: Apache-2.0
// PackedData and PackedFile store a data set in one file (.ubsd): cameras, 8-bit images as they are used in
// training (composited and reduced), their masks and initial points, all with checksums. Such a file loads
// fast and without an image library. Layout, little-endian:
//   "UBSDATA\x1a" | u32 version | u32 CRC-32 of the header | u64 bytes of the header | header (JSON) | blocks
// The header describes each block by its offset from the end of the header, its size and its CRC-32. Version
// 2 adds a block "mask" (one byte per pixel, 0 = does not count) for views that have a mask. A view that
// shows a part of a wide image has the members "part_of" (the name of that image) and "turn"
// (View::turn_in_wide). Version 3 adds a list "wide_images" to each split, with the names, lenses and pixels
// of these images. A file gets the lowest version that describes it.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/data/lens_image.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct PackedData {
  std::vector<Split> splits;
  std::optional<PointCloud> points;
  std::array<double, 3> background{0, 0, 0};        // the images were composited on it
  int downscale = 1;                                // the images were reduced by this factor
  std::array<double, 3> offset{0, 0, 0};            // world = local + offset; cameras and points are local
  std::vector<std::array<double, 2>> depth_bounds;  // near, far of each training view; may be empty
};

// Writes a packed file. Every image is loaded twice, one at a time, because the header comes first and
// contains the checksums of all images. Throws Error(data) if an image differs the second time.
void write_packed(const std::filesystem::path& path, const PackedData& data);

// Recognises a packed file by its first bytes. Returns false for folders and for files that cannot be read.
bool is_packed(const std::filesystem::path& path);

// An open packed file. Images are read on request, one split at a time. Any damage is reported as Error(data)
// that names the file and the damaged part.
class PackedFile {
 public:
  explicit PackedFile(std::filesystem::path path);

  // Returns a split whose images are empty.
  Split split(const std::string& name) const;
  std::optional<PointCloud> points() const;
  const std::array<double, 3>& background() const { return background_; }
  bool opaque() const;  // no image contains a part of the background
  int downscale() const { return downscale_; }
  const std::array<double, 3>& offset() const { return offset_; }
  const std::vector<std::array<double, 2>>& depth_bounds() const { return depth_bounds_; }
  std::vector<std::string> split_names() const;
  // Returns a split with images that are read on demand. They keep `file` alive.
  static Split split_on_demand(const std::shared_ptr<const PackedFile>& file, const std::string& name);

 private:
  struct Block {
    std::uint64_t offset = 0, size = 0;
    std::uint32_t crc = 0;
  };
  struct Pixels {
    std::string name;  // of the view or wide image
    int width = 0, height = 0;
    std::optional<Block> image, mask;
  };
  struct PackedView {
    View view;  // without its image
    Pixels pixels;
  };
  struct PackedWideImage {
    WideLens lens;
    Pixels pixels;
  };
  struct PackedSplit {
    std::string name;
    std::vector<PackedView> views;
    std::vector<PackedWideImage> wide_images;
  };
  class Source;
  const PackedSplit& find(const std::string& name) const;
  Image8 load(const Pixels& pixels) const;
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
