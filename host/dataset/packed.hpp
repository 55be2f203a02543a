// SPDX-License-Identifier: Apache-2.0
// A packed file (.ubsd) contains a whole data set: cameras, images with 8 bits as they are used in training
// (composited, undistorted and reduced), their masks, and initial points. All parts have checksums. Such a
// file is loaded fast and without an image library. write_packed() writes a file from PackedData, and
// PackedFile reads it. The layout of a file is as follows; numbers are little-endian:
//   "UBSDATA\x1a" | u32 version | u32 CRC-32 of the header | u64 bytes of the header | header (JSON) | blocks
// The header describes each block by its offset from the end of the header, its size and its CRC-32. Version
// 2 adds a block "mask" for views that have a mask. It has one byte per pixel, which is 0 if the pixel is
// masked. A view that shows a part of a wide image has the members "part_of" (the name of the wide image) and
// "turn" (View::turn_in_wide). Version 3 adds a list "wide_images" to each split, with the names, lenses and
// pixels of the wide images. A file gets the lowest version that supports its contents.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/dataset/lens_image.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"

namespace ubs {

struct PackedData {
  std::vector<Split> splits;
  std::optional<PointCloud> points;
  std::array<double, 3> background{0, 0, 0};  // colour on which the images were composited
  int downscale = 1;                          // factor by which the images were reduced
  // Positions of cameras and points are stored relative to this offset: world position = position + offset.
  std::array<double, 3> offset{0, 0, 0};
  // Smallest and largest depth of the scene in each training view, if the data state them.
  std::vector<std::array<double, 2>> depth_bounds;
};

// Writes a packed file. The header is written first and contains the checksums of all images. So that only
// one image at a time is in memory, every image is loaded twice: once for the header, and once to write its
// pixels. Throws Error(data) if the two results differ.
void write_packed(const std::filesystem::path& path, const PackedData& data);

// Returns whether a path is a packed file, which is recognised by its first bytes. Returns false for folders
// and for files that cannot be read.
bool is_packed(const std::filesystem::path& path);

// PackedFile is an open packed file. The constructor reads only the header; the pixels of an image are read
// when its source loads the image. If the file is damaged, functions throw Error(data) with a message that
// names the file and the damaged part.
class PackedFile {
 public:
  explicit PackedFile(std::filesystem::path path);

  // Returns a split whose images are empty.
  Split split(const std::string& name) const;
  std::optional<PointCloud> points() const;
  const std::array<double, 3>& background() const { return background_; }
  bool opaque() const;  // returns whether the background is visible in none of the images
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
    std::string name;  // name of the view or of the wide image
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
