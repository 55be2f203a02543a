// SPDX-License-Identifier: Apache-2.0
// Reads and writes binary OpenUSD files (.usdc, .usd); see foreign_formats.hpp. The binary format has no
// specification, so such files are converted from and to text files by programs of OpenUSD: either usdcat, or
// a Python with the package usd-core.
#include <algorithm>
#include <filesystem>
#include <fstream>

#include "host/base/child_process.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/splat_series.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// This Python code removes the current folder from the search path before it imports OpenUSD. Python looks
// for modules in this folder first, and it may contain any file.
#define UBS_IMPORT_SDF "import sys; sys.path[:] = [p for p in sys.path if p]; from pxr import Sdf; "
// Converts a layer. The extension of the target determines the format. References are kept, not followed.
constexpr const char* kCopyScript = UBS_IMPORT_SDF
    "layer = Sdf.Layer.FindOrOpen(sys.argv[1]); "
    "sys.exit(0 if layer and layer.Export(sys.argv[2]) else 1)";

int exit_code_of(const std::vector<std::string>& arguments, const fs::path& log) {
  const ChildResult result = run_child(arguments, log, [] { return false; });
  return result.signal != 0 ? 128 + result.signal : result.code;
}

// UsdConverter contains the command that converts a file; the names of the two files are appended to it. The
// command is empty if no converter was found.
struct UsdConverter {
  std::vector<std::string> command;
  bool is_usdcat = false;
};

UsdConverter find_usd_converter() {
  const TemporaryFolder temporary;
  const fs::path log = temporary.path() / "version.log";
  // Run usdcat to check that it works, because it may be installed without the libraries that it needs.
  if (const fs::path usdcat = find_program("usdcat");
      !usdcat.empty() && exit_code_of({usdcat.string(), "--help"}, log) == 0)
    return {{usdcat.string()}, true};
  for (const char* name : {"python3", "python"})
    if (const fs::path python = find_program(name);
        !python.empty() && exit_code_of({python.string(), "-c", UBS_IMPORT_SDF}, log) == 0)
      return {{python.string(), "-c", kCopyScript}, false};
  return {};
}

UsdConverter usd_converter(const std::string& what) {
  UsdConverter converter = find_usd_converter();
  if (converter.command.empty())
    fail(ErrorKind::usage,
         "{} requires OpenUSD: run 'pip install usd-core' for the python3 in PATH, or add usdcat to PATH; "
         "alternatively, use a .usda file, which does not require OpenUSD",
         what);
  return converter;
}

// Returns the last line of the log that is not empty.
std::string last_words(const fs::path& log) {
  const std::string text = read_text_file(log);
  const std::size_t end = text.find_last_not_of(" \r\n");
  if (end == std::string::npos) return {};
  const std::size_t begin = text.find_last_of('\n', end);
  return text.substr(begin + 1, end - begin);
}

void convert_usd(const UsdConverter& converter, const fs::path& from, const fs::path& to,
                 const std::string& name) {
  const fs::path log = to.parent_path() / "usd.log";
  std::vector<std::string> arguments = converter.command;
  arguments.push_back(from.string());
  if (converter.is_usdcat) arguments.emplace_back("-o");
  arguments.push_back(to.string());
  if (const int code = exit_code_of(arguments, log); code != 0 || !path_exists(to))
    fail(ErrorKind::data, "{}: {} failed to convert the file with exit code {}: {}", name,
         converter.command.front(), code, last_words(log));
}

// Calls write_text(path), which writes a text file, and converts this file to a binary file.
template <typename WriteText>
void write_binary_usd(const fs::path& path, const WriteText& write_text) {
  const UsdConverter converter = usd_converter(path.string());
  // The converter replaces its target by a new file, so it cannot write to the temporary file of AtomicFile.
  const TemporaryFolder temporary;
  const fs::path text = temporary.path() / "splats.usda", binary = temporary.path() / "splats.usdc";
  write_text(text);
  convert_usd(converter, text, binary, path.string());
  fs::remove(text);
  AtomicFile file(path);
  std::size_t left = 0;
  std::ifstream in = open_for_reading(binary, left);
  std::vector<std::byte> block(std::min(left, std::size_t{1} << 22));
  while (left > 0) {
    const auto part = std::span(block).first(std::min(left, block.size()));
    if (!in.read(reinterpret_cast<char*>(part.data()), static_cast<std::streamsize>(part.size())))
      fail(ErrorKind::data, "{}: the file cannot be read", binary.string());
    file.write(part);
    left -= part.size();
  }
  file.commit();
}

ImportedSplats read_usdc_sample(const fs::path& path, std::optional<double> time) {
  const UsdConverter converter = usd_converter(fmt::format("{}: reading a binary USD file", path.string()));
  const TemporaryFolder temporary;
  // OpenUSD recognises the format by the extension, but the input file may have any name.
  const fs::path binary = temporary.path() / "in.usdc", text = temporary.path() / "in.usda";
  fs::create_symlink(fs::absolute(path), binary);
  convert_usd(converter, binary, text, path.string());
  return parse_usda(read_text_file(text), path.string(), time);
}

}  // namespace

#undef UBS_IMPORT_SDF

void require_usd_converter() { usd_converter("a binary USD file"); }

void write_usdc(const fs::path& path, const ImportedSplats& splats) {
  write_binary_usd(path, [&](const fs::path& text) { write_usda(text, splats); });
}

void write_usdc_series(const fs::path& path, const SplatSeries& series) {
  write_binary_usd(path, [&](const fs::path& text) { write_usda_series(text, series); });
}

ImportedSplats read_usdc(const fs::path& path) { return read_usdc_sample(path, {}); }
ImportedSplats read_usdc_at(const fs::path& path, double time) { return read_usdc_sample(path, time); }

}  // namespace ubs
