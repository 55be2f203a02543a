// SPDX-License-Identifier: Apache-2.0
// These functions read and write third-party splat formats (docs/data.md). splat_file.hpp chooses among them.
// Readers skip splats that cannot be rendered and count them in the report. Writers never leave an incomplete
// file.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/formats/imported_splats.hpp"
#include "host/formats/ply_header.hpp"

namespace ubs {

class SplatSeries;

// Read and write the standard PLY files of 3DGS. Their properties are the position, f_dc_*, f_rest_* (one
// channel after the other), scale_*, rot_* and opacity. The reader accepts binary and ASCII files, the
// properties in any order and with any number type, and adds a note that names properties that are not used.
// Files without scale_2 (2DGS) give flat splats. Instead of f_dc_*, there may be red, green and blue as bytes
// (nerfstudio). The reader also accepts DBS files (method.md 5.2). It keeps their spherical Beta lobes if
// there are at most three lobes per splat and the spherical harmonics have degree 0.
ImportedSplats read_gaussian_ply(const std::filesystem::path& path);
void write_gaussian_ply(const std::filesystem::path& path, const ImportedSplats& splats);

// Reads SuperSplat's compressed PLY. It stores bounds for each chunk of 256 splats, four packed 32-bit words
// per splat, and optionally spherical harmonics with 8 bits per coefficient.
ImportedSplats read_compressed_ply(const std::filesystem::path& path);

// Read and write Niantic's SPZ format. The file stores coordinates with y up and z backward. They are
// converted to the axes of PLY files by a rotation of 180 degrees about x. read_spz() reads the versions 2
// and 3 (with or without gzip) and 4 (with Zstandard streams). parse_spz() reads the decompressed data of the
// versions 2 and 3. write_spz() writes version 3. If a file has the extension for coordinate systems, they
// are converted from it; systems with z up or down are refused.
ImportedSplats read_spz(const std::filesystem::path& path);
ImportedSplats parse_spz(std::span<const std::byte> payload, const std::string& name);
void write_spz(const std::filesystem::path& path, const ImportedSplats& splats);
// Returns sentences about the losses of write_spz() that exceed the usual rounding of positions to 1/4096 and
// of other values to 8 bits. Such losses are a coarser rounding of positions, and values that are out of
// range.
std::vector<std::string> spz_remarks(const ImportedSplats& splats);

// Read and write .splat files, which have 32 bytes per splat: position and scale as float32; colour, opacity
// and quaternion with 8 bits per number.
ImportedSplats read_splat32(const std::filesystem::path& path);
void write_splat32(const std::filesystem::path& path, const ImportedSplats& splats);

// Read and write glTF with the extension KHR_gaussian_splatting. Coordinates have y up, and are converted to
// and from the axes of PLY files by a rotation of 180 degrees about x. The writer creates binary files, and
// stores the offset of the splats as the translation of the node. The reader accepts binary and text files,
// all component types that the extension allows, several primitives, and the attributes of its early drafts.
// It shows the meshes where the nodes of the scene place them (splat_transform.hpp). parse_glb() reads the
// bytes of a whole file, without other files that it refers to.
ImportedSplats read_gltf(const std::filesystem::path& path);
ImportedSplats parse_glb(std::span<const std::byte> file, const std::string& name);
void write_glb(const std::filesystem::path& path, const ImportedSplats& splats);

// Read and write SOG. It consists of meta.json and lossless WebP images with one pixel per splat, either in a
// ZIP archive or as separate files in one folder. The axes are those of PLY files. The reader supports
// versions 1 and 2. The writer creates a ZIP archive of version 2.
ImportedSplats read_sog(const std::filesystem::path& path);
// Reads SOG without removing the splats that cannot be rendered, so the indices are those of the file.
ImportedSplats load_sog(const std::filesystem::path& path);
// Returns the path of the file `member`, whose name is stated in the file `path`. Throws Error(data) if the
// name is an absolute path, contains "..", or is a link that leads out of the folder of `path`.
std::filesystem::path file_beside(const std::filesystem::path& path, const std::string& member);
// Reads SOG from the bytes of a ZIP archive.
ImportedSplats parse_sog(std::span<const std::byte> file, const std::string& name);
void write_sog(const std::filesystem::path& path, const ImportedSplats& splats);

// Reads streamed SOG. Its file lod-meta.json contains a tree; each leaf lists, for every level of detail, a
// SOG file and a range of splats in it. The reader loads the finest level of all leaves, and the splats of
// the environment.
ImportedSplats read_streamed_sog(const std::filesystem::path& path);

// Read and write OpenUSD text files with the schema UsdVol ParticleField3DGaussianSplat of OpenUSD 26.03.
// Coordinates have y up, and are converted to and from the axes of PLY files by a rotation of 180 degrees
// about x. (Coordinates of files whose upAxis is Z are not converted.) The offset of the splats is stored as
// a translation in double precision. write_usda_series() writes a series to one file. Its time samples have
// the time codes 0, 1, 2, ...; attributes that are the same at all time samples are stored once. The reader
// loads the float or half attributes of all splat prims in the layer itself. If the file has time samples,
// the reader loads the first one, or the one nearest to `time`, which ranges from 0 (first) to 1 (last).
// Prims are placed as the operations of the hierarchy state (splat_transform.hpp). Throws Error(usage) if a
// time is passed and the file has no time samples.
ImportedSplats read_usda(const std::filesystem::path& path);
ImportedSplats read_usda_at(const std::filesystem::path& path, double time);
ImportedSplats parse_usda(std::string_view text, const std::string& name, std::optional<double> time = {});
void write_usda(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usda_series(const std::filesystem::path& path, const SplatSeries& series);
// Returns sentences about values that the writers of OpenUSD files drop.
std::vector<std::string> usd_remarks(const ImportedSplats& splats);

// Read and write binary OpenUSD files. They are converted from and to OpenUSD text by OpenUSD's program
// usdcat or its Python package usd-core. If neither is available, require_usd_converter() throws Error(usage)
// with a message that says which program or package to install.
void require_usd_converter();
ImportedSplats read_usdc(const std::filesystem::path& path);
ImportedSplats read_usdc_at(const std::filesystem::path& path, double time);
void write_usdc(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usdc_series(const std::filesystem::path& path, const SplatSeries& series);

// A rotation of 180 degrees about x changes the signs of y and z. These are the factors by which it
// multiplies the coefficients of the spherical harmonics of degree 1 to 3.
inline constexpr float kHalfTurnSigns[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};

inline constexpr std::size_t kMaxDeflateRatio = 1032;  // maximum compression ratio of deflate
// The following functions, whose names start with inflate or deflate, are defined in inflate.cpp. Functions
// that decompress throw Error(data) if the data are damaged. If they have a parameter `limit`, they also
// throw if the decompressed data have more than `limit` bytes. Messages start with `name`.
std::vector<std::byte> inflate_gzip(std::span<const std::byte> packed, std::size_t limit,
                                    const std::string& name);
// Returns the first `size` decompressed bytes, or all of them if there are fewer.
std::vector<std::byte> inflate_gzip_start(std::span<const std::byte> packed, std::size_t size,
                                          const std::string& name);
std::vector<std::byte> inflate_raw(std::span<const std::byte> packed, std::size_t limit,
                                   const std::string& name);  // raw deflate data
std::vector<std::byte> deflate_gzip(std::span<const std::byte> plain);
// Compresses to zlib format. The only repetitions that zlib searches for are runs of equal bytes. This is
// fast and suits the filtered rows of PNG.
std::vector<std::byte> deflate_runs(std::span<const std::byte> plain);
// Decompresses a Zstandard frame. Throws Error(data) unless the decompressed data have exactly `size` bytes.
std::vector<std::byte> inflate_zstd(std::span<const std::byte> packed, std::size_t size,
                                    const std::string& name);

// Appends a number in little-endian order.
template <typename T>
void put_number(std::vector<std::byte>& out, T value) {
  for (std::size_t b = 0; b < sizeof(T); ++b) out.push_back(static_cast<std::byte>(value >> 8 * b));
}

// Moves the lowest 21 bits of v to every third bit. If three coordinates are treated in this way and
// interleaved, the result is a Morton code, which orders positions along a space-filling curve.
inline std::uint64_t spread_bits(std::uint64_t v) {
  std::uint64_t out = 0;
  for (int b = 0; b < 21; ++b) out |= (v >> b & 1) << 3 * b;
  return out;
}

// Returns the values of "ubs_offset x y z" in the comments of a PLY file, or zero if there is no such
// comment. A malformed comment is an error.
std::array<double, 3> offset_comment(std::span<const std::string> comments, const std::string& name);
// Returns whether comments of a PLY file say that the splats were trained with antialiasing
// ("SplatRenderMode: mip" of Brush and gsplat, "antialiased 1" of Postshot). If so, adds a note to the
// report. If there are several such comments, the last one counts. A comment with an unknown render mode also
// adds a note.
bool antialias_comment(std::span<const std::string> comments, LoadReport& report);
// Returns the comment that offset_comment() reads.
std::string make_offset_comment(const std::array<double, 3>& offset);

// Throws Error(data) if there are no splats. Every writer calls this function before it creates a file,
// because other programs cannot open files without splats, and a .splat file without any could not be
// recognised.
void require_splats(const std::filesystem::path& path, const ImportedSplats& splats);

inline float sigmoid_of(float logit) { return 1.0f / (1.0f + std::exp(-logit)); }
inline float logit_of(double p) {
  if (p <= 0) return -kMaxLogit;
  if (p >= 1) return kMaxLogit;
  return static_cast<float>(std::log(p / (1 - p)));
}

}  // namespace ubs
