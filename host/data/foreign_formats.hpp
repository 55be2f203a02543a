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

#include "host/data/imported_splats.hpp"
#include "host/data/ply_header.hpp"

namespace ubs {

class SplatSeries;

// Standard 3DGS file: f_dc_*, f_rest_* (channel after channel), scale_*, rot_*, opacity; binary or ascii, in
// any order and with any number types. A note names further properties. Without scale_2 (2DGS) the splats are
// flat. The reader also accepts DBS files (method.md 5.2); it keeps their lobes if the harmonics have degree
// 0.
ImportedSplats read_gaussian_ply(const std::filesystem::path& path);
void write_gaussian_ply(const std::filesystem::path& path, const ImportedSplats& splats);

// SuperSplat's compressed PLY: blocks of 256 splats with bounds, four packed words per splat.
ImportedSplats read_compressed_ply(const std::filesystem::path& path);

// Niantic SPZ, versions 2 and 3 (with or without gzip) and 4 (Zstandard streams). The file stores coordinates
// with y up and z backward. They are converted to the axes of PLY files by half a revolution about x.
ImportedSplats read_spz(const std::filesystem::path& path);
ImportedSplats parse_spz(std::span<const std::byte> payload, const std::string& name);  // v2, v3, unpacked
void write_spz(const std::filesystem::path& path, const ImportedSplats& splats);        // version 3
// Returns sentences about losses of write_spz() beyond the usual rounding to 1/4096 and to 8 bits: a coarser
// rounding of positions, and values that are out of range.
std::vector<std::string> spz_remarks(const ImportedSplats& splats);

// .splat file with 32 bytes per splat: position and scale (float32), colour and opacity, quaternion (8 bit
// each).
ImportedSplats read_splat32(const std::filesystem::path& path);
void write_splat32(const std::filesystem::path& path, const ImportedSplats& splats);

// Binary glTF with KHR_gaussian_splatting: float attributes of points, with y up, rotated like SPZ. The
// writer stores the offset as the translation of the node. The reader accepts all component types that the
// extension allows and several primitives; nodes may have a translation, but no rotation.
ImportedSplats read_glb(const std::filesystem::path& path);
ImportedSplats parse_glb(std::span<const std::byte> file, const std::string& name);
void write_glb(const std::filesystem::path& path, const ImportedSplats& splats);

// SOG: meta.json and lossless WebP images with one pixel per splat, either in a ZIP archive or as files next
// to meta.json. The axes are those of PLY files. The reader supports versions 1 and 2. The writer creates a
// ZIP archive of version 2.
ImportedSplats read_sog(const std::filesystem::path& path);
// Does not remove splats, so the indices are those of the file.
ImportedSplats load_sog(const std::filesystem::path& path);
// Returns the path of the file `member` that the file `path` names. Throws Error(data) if it is not in the
// same folder.
std::filesystem::path file_beside(const std::filesystem::path& path, const std::string& member);
ImportedSplats parse_sog(std::span<const std::byte> file, const std::string& name);
void write_sog(const std::filesystem::path& path, const ImportedSplats& splats);

// Streamed SOG: lod-meta.json holds a tree whose leaves name ranges of SOG files, one per level of detail.
// The reader loads the finest level and the environment.
ImportedSplats read_streamed_sog(const std::filesystem::path& path);

// OpenUSD text with the schema UsdVol ParticleField3DGaussianSplat of OpenUSD 26.03: y up, rotated like SPZ,
// with the offset as a translation in double precision.
// A series becomes one file. Its time samples have the time codes 0, 1, 2, ...; attributes that are the same
// at all time samples are stored once.
// The reader loads the float or half attributes of all splat prims in the layer itself. If the file has time
// samples, it loads the first one, or the one nearest to `time`, which is from 0 (first) to 1 (last). Prims
// may be translated, but not rotated or scaled. Throws Error(usage) if a time is given and the file has no
// time samples.
ImportedSplats read_usda(const std::filesystem::path& path);
ImportedSplats read_usda_at(const std::filesystem::path& path, double time);
ImportedSplats parse_usda(std::string_view text, const std::string& name, std::optional<double> time = {});
void write_usda(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usda_series(const std::filesystem::path& path, const SplatSeries& series);
std::vector<std::string> usd_remarks(const ImportedSplats& splats);

// The binary form of the same format, converted by OpenUSD's program usdcat or its Python package usd-core.
// require_usd_converter() throws Error(usage) that says what to install if neither is available.
void require_usd_converter();
ImportedSplats read_usdc(const std::filesystem::path& path);
ImportedSplats read_usdc_at(const std::filesystem::path& path, double time);
void write_usdc(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usdc_series(const std::filesystem::path& path, const SplatSeries& series);

// Signs of the non-constant spherical harmonics after a half turn about x, which changes the signs of y and
// z.
inline constexpr float kHalfTurnSigns[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};

inline constexpr std::size_t kMaxDeflateRatio = 1032;  // maximum compression ratio of deflate
// The following functions are in inflate.cpp. They decompress at most `limit` bytes; it is an error if there
// are more, or if the data are damaged.
std::vector<std::byte> inflate_gzip(std::span<const std::byte> packed, std::size_t limit,
                                    const std::string& name);
// Returns the first `size` bytes, or fewer if there are no more.
std::vector<std::byte> inflate_gzip_start(std::span<const std::byte> packed, std::size_t size,
                                          const std::string& name);
std::vector<std::byte> inflate_raw(std::span<const std::byte> packed, std::size_t limit,
                                   const std::string& name);  // raw deflate data
std::vector<std::byte> deflate_gzip(std::span<const std::byte> plain);
// Compresses quickly to zlib format, using only runs of equal bytes. Used for filtered rows of PNG.
std::vector<std::byte> deflate_runs(std::span<const std::byte> plain);
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
// ("SplatRenderMode: mip" of Brush and gsplat, "antialiased 1" of Postshot), and adds a note to the report.
// If there are several such comments, the last one counts.
bool antialias_comment(std::span<const std::string> comments, LoadReport& report);
std::string make_offset_comment(const std::array<double, 3>& offset);

inline float sigmoid_of(float logit) { return 1.0f / (1.0f + std::exp(-logit)); }
inline float logit_of(double p) {
  if (p <= 0) return -kMaxLogit;
  if (p >= 1) return kMaxLogit;
  return static_cast<float>(std::log(p / (1 - p)));
}

}  // namespace ubs
