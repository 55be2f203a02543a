// SPDX-License-Identifier: Apache-2.0
// Readers and writers of the splat formats of other tools (docs/data.md). splat_file.hpp chooses among
// them. Readers drop what cannot be shown and count it in the report; writers never leave half a file.
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

// Standard 3DGS file: f_dc_*, f_rest_* (channel after channel), scale_*, rot_*, opacity; binary or ascii, any
// order, any number types. Further properties are named in a note. Without scale_2 (2DGS) the splats are
// flat. DBS files (method.md 5.2) as well: their lobes are dropped.
ImportedSplats read_gaussian_ply(const std::filesystem::path& path);
void write_gaussian_ply(const std::filesystem::path& path, const ImportedSplats& splats);

// SuperSplat's compressed PLY: blocks of 256 splats with bounds, four packed words per splat.
ImportedSplats read_compressed_ply(const std::filesystem::path& path);

// Niantic SPZ, versions 2 and 3 (with gzip or without) and 4 (Zstandard streams). Stored with y up and z
// backward, turned by half a revolution about x to the axes of PLY files.
ImportedSplats read_spz(const std::filesystem::path& path);
ImportedSplats parse_spz(std::span<const std::byte> payload, const std::string& name);  // v2, v3, unpacked
void write_spz(const std::filesystem::path& path, const ImportedSplats& splats);        // version 3
// What write_spz() loses beyond rounding to 1/4096 and 8 bits: finer positions, values out of range.
std::vector<std::string> spz_remarks(const ImportedSplats& splats);

// 32 bytes per splat: position, scale (float32), colour and opacity, quaternion (8 bit).
ImportedSplats read_splat32(const std::filesystem::path& path);
void write_splat32(const std::filesystem::path& path, const ImportedSplats& splats);

// Binary glTF with KHR_gaussian_splatting: float attributes of points, y up, turned like SPZ. Written with
// the offset as the translation of the node. Read: any component types that the extension allows, several
// primitives; nodes may translate, not turn.
ImportedSplats read_glb(const std::filesystem::path& path);
ImportedSplats parse_glb(std::span<const std::byte> file, const std::string& name);
void write_glb(const std::filesystem::path& path, const ImportedSplats& splats);

// SOG: meta.json and lossless WebP images, a pixel a splat; a ZIP of them, or the file meta.json in a folder.
// Axes of PLY files. Versions 2 and 1 are read; a ZIP of version 2 is written.
ImportedSplats read_sog(const std::filesystem::path& path);
ImportedSplats load_sog(const std::filesystem::path& path);  // not cleaned: splats keep their numbers
// Returns the path of a file that another one names. Throws Error(data) where it is not in the same folder.
std::filesystem::path file_beside(const std::filesystem::path& path, const std::string& member);
ImportedSplats parse_sog(std::span<const std::byte> file, const std::string& name);
void write_sog(const std::filesystem::path& path, const ImportedSplats& splats);

// Streamed SOG: lod-meta.json, a tree whose leaves name ranges of SOG files, one a level of detail. The
// finest level is read, and the environment.
ImportedSplats read_streamed_sog(const std::filesystem::path& path);

// OpenUSD with the schema UsdVol ParticleField3DGaussianSplat of OpenUSD 26.03, as text: y up, turned like
// SPZ, the offset as a translation in double precision. A series becomes one file with a time sample for each
// moment, at the time codes 0, 1, 2, ...; attributes that are the same at all moments are stored once.
// Read: the float or half attributes of all splat prims of the layer itself. Of a file with time samples the
// first one, or the one nearest to `time`, from 0 (the first) to 1 (the last). Prims may be translated, not
// turned or scaled. Error(usage) for a time where the file has no time samples.
ImportedSplats read_usda(const std::filesystem::path& path);
ImportedSplats read_usda_at(const std::filesystem::path& path, double time);
ImportedSplats parse_usda(std::string_view text, const std::string& name, std::optional<double> time = {});
void write_usda(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usda_series(const std::filesystem::path& path, const SplatSeries& series);
std::vector<std::string> usd_remarks(const ImportedSplats& splats);

// The binary form of the same, converted by OpenUSD's usdcat or its Python package usd-core.
// require_usd_converter() throws Error(usage) that says what to install if neither is there.
void require_usd_converter();
ImportedSplats read_usdc(const std::filesystem::path& path);
ImportedSplats read_usdc_at(const std::filesystem::path& path, double time);
void write_usdc(const std::filesystem::path& path, const ImportedSplats& splats);
void write_usdc_series(const std::filesystem::path& path, const SplatSeries& series);

// Signs of the harmonics behind the constant one under a half turn about x: y and z change sign.
inline constexpr float kHalfTurnSigns[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};

inline constexpr std::size_t kMaxDeflateRatio = 1032;  // deflate cannot do better
// inflate.cpp: decompressed data of at most `limit` bytes; more, or damage, is an error.
std::vector<std::byte> inflate_gzip(std::span<const std::byte> packed, std::size_t limit,
                                    const std::string& name);
// The first `size` bytes, fewer where there are no more.
std::vector<std::byte> inflate_gzip_start(std::span<const std::byte> packed, std::size_t size,
                                          const std::string& name);
std::vector<std::byte> inflate_raw(std::span<const std::byte> packed, std::size_t limit,
                                   const std::string& name);  // deflate without a wrapping
std::vector<std::byte> deflate_gzip(std::span<const std::byte> plain);
// In zlib's wrapping, fast, by runs of equal bytes alone: for filtered rows of PNG.
std::vector<std::byte> deflate_runs(std::span<const std::byte> plain);
std::vector<std::byte> inflate_zstd(std::span<const std::byte> packed, std::size_t size,
                                    const std::string& name);

// Little-endian.
template <typename T>
void put_number(std::vector<std::byte>& out, T value) {
  for (std::size_t b = 0; b < sizeof(T); ++b) out.push_back(static_cast<std::byte>(value >> 8 * b));
}

// The lowest 21 bits, three apart: those of three coordinates in turn order places along a curve through
// space.
inline std::uint64_t spread_bits(std::uint64_t v) {
  std::uint64_t out = 0;
  for (int b = 0; b < 21; ++b) out |= (v >> b & 1) << 3 * b;
  return out;
}

// "ubs_offset x y z" among the comments of a PLY file; zero when absent. Malformed is an error.
std::array<double, 3> offset_comment(std::span<const std::string> comments, const std::string& name);
// Whether comments of a PLY file say that the splats were trained with antialiasing ("SplatRenderMode: mip"
// of Brush and gsplat, "antialiased 1" of Postshot; the last one counts), with a note in the report.
bool antialias_comment(std::span<const std::string> comments, LoadReport& report);
std::string make_offset_comment(const std::array<double, 3>& offset);

inline float sigmoid_of(float logit) { return 1.0f / (1.0f + std::exp(-logit)); }
inline float logit_of(double p) {
  if (p <= 0) return -kMaxLogit;
  if (p >= 1) return kMaxLogit;
  return static_cast<float>(std::log(p / (1 - p)));
}

}  // namespace ubs
