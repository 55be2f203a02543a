// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>

#include "cuda_backend/compiler.hpp"
#include "host/base/cache_folder.hpp"
#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs::cuda {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kOtherSeed = 0x84222325cbf29ce4u;

// Returns the name of the cache file of a program. It contains a hash of 128 bits, so that two programs never
// share a name.
std::string file_name(const ProgramSpec& spec, int capability) {
  const ProgramText program = program_text(spec);
  std::string all = fmt::format("{}\nsm_{}\n{}\n", compiler_version(), capability, program.main.text);
  for (const SourceText& header : program.headers) all += header.name + '\n' + header.text + '\n';
  Options options = spec.options;
  std::ranges::sort(options);
  for (const std::string& option : options) all += option + '\n';
  return fmt::format("cuda-{:016x}{:016x}.bin", name_hash(all), name_hash(all, kOtherSeed));
}

std::uint32_t checksum(const std::string& binary) { return crc32(std::as_bytes(std::span(binary))); }

// Returns the content of a cache file, or an empty string if the file does not exist or is damaged.
std::string load(const fs::path& file) {
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return {};
  std::string text;
  try {
    text = read_text_file(file);
  } catch (const Error&) {
    return {};
  }
  std::uint32_t expected = 0;
  if (text.size() <= sizeof expected) return {};
  std::memcpy(&expected, text.data(), sizeof expected);
  text.erase(0, sizeof expected);
  return checksum(text) == expected ? text : std::string();
}

// Writes a cache file. Errors are ignored, because without the file the next start only takes longer.
void save(const fs::path& file, const std::string& binary) {
  const std::uint32_t sum = checksum(binary);
  std::string text(reinterpret_cast<const char*>(&sum), sizeof sum);
  text += binary;
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  try {
    write_file_atomically(file, text, FileUse::cache);
  } catch (const std::exception&) {
  }
}

}  // namespace

std::string cached_binary(const ProgramSpec& spec, int capability) {
  const fs::path folder = kernel_cache_folder();
  const bool keep = !folder.empty();
  const fs::path file = keep ? folder / file_name(spec, capability) : fs::path();
  if (keep)
    if (std::string binary = load(file); !binary.empty()) return binary;
  std::string binary = compile_program(spec, capability).binary;
  if (keep) save(file, binary);
  return binary;
}

}  // namespace ubs::cuda
