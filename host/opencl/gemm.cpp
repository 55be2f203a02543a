// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/gemm.hpp"

#include <clblast.h>

#include <algorithm>
#include <mutex>

#include "host/opencl/memory.hpp"

namespace ubs::opencl {
namespace {

using Parameters = std::unordered_map<std::string, std::size_t>;

// CLBlast fills the table of its constants in the first call, and changes it in OverrideParameters(), both
// without a lock. Therefore only one thread at a time calls CLBlast, whichever device it uses.
std::mutex blast_mutex;

// On CPUs, products are divided into blocks of the inner dimension and of the columns, so that a block fits
// into the cache of a core. On two cores with AVX-512, a product of 512 x 256 x 4608 in blocks reached 115 to
// 150 GFLOP/s, compared with 51 GFLOP/s without blocks.
constexpr int kInnerBlock = 1152;
constexpr int kBlockFloats = 1 << 18, kMinColumns = 256;

void check_blast(clblast::StatusCode code, const char* call) {
  if (code != clblast::StatusCode::kSuccess)
    fail(ErrorKind::device, "{} failed with CLBlast status {}", call, static_cast<int>(code));
}

// Sets the constants of CLBlast for CPUs. CLBlast contains tuned constants for GPUs. With its defaults for
// other devices, work-items share tiles through local memory, which reaches only 8 GFLOP/s on PoCL. With the
// constants below, each work-item computes 4 x 4 vectors in registers and uses no local memory. A product of
// 64 x 1024 x 576 then reaches 149 GFLOP/s on two cores with AVX-512. (It reaches only 37 GFLOP/s if the
// inner loop is unrolled by 2.) Only CLBlast's kernel for large products has these constants, so this kernel
// is used for small products as well.
void tune_for_cpu(const OpenclDevice& device) {
  const std::size_t lanes = device.vector_width();
  const Parameters product{{"GEMMK", 0}, {"MWG", 4 * lanes}, {"NWG", 4},   {"KWG", 8},
                           {"MDIMC", 1}, {"NDIMC", 1},       {"MDIMA", 1}, {"NDIMB", 1},
                           {"KWI", 1},   {"VWM", lanes},     {"VWN", 4},   {"STRM", 0},
                           {"STRN", 0},  {"SA", 0},          {"SB", 0},    {"KREG", 1}};
  const auto precision = clblast::Precision::kSingle;
  check_blast(clblast::OverrideParameters(device.id(), "Xgemm", precision, product), "OverrideParameters");
  check_blast(
      clblast::OverrideParameters(device.id(), "GemmRoutine", precision, {{"XGEMM_MIN_INDIRECT_SIZE", 0}}),
      "OverrideParameters");
}

cl_mem handle_of(const BufferView<float>& view) { return static_cast<OpenclMemory*>(view.memory)->handle(); }

}  // namespace

Gemm::Gemm(OpenclDevice& device) : device_(device) {
  const std::lock_guard lock(blast_mutex);
  if (device.info().type == DeviceType::cpu && device.vector_width() > 1) tune_for_cpu(device);
}

// CLBlast caches the programs of a context. The context therefore exists until the cache is cleared.
Gemm::~Gemm() {
  const std::lock_guard lock(blast_mutex);
  clblast::ClearCache();
}

std::vector<Gemm::Block> Gemm::blocks(const MatrixProduct& p) const {
  const bool cpu = device_.info().type == DeviceType::cpu;
  const int inner = cpu ? std::min(p.inner, kInnerBlock) : p.inner;
  const int columns = cpu ? std::max(kBlockFloats / inner / 64 * 64, kMinColumns) : p.columns;
  std::vector<Block> all;
  for (int k = 0; k < p.inner; k += inner)
    for (int column = 0; column < p.columns; column += columns)
      all.push_back({k, std::min(inner, p.inner - k), column, std::min(columns, p.columns - column)});
  return all;
}

namespace {

// Layout contains the size of a block and its position in each of the three matrices.
struct Layout {
  std::size_t rows, columns, inner, a_offset, a_pitch, b_offset, b_pitch, c_offset, c_pitch;
};

template <typename Block>
Layout layout(const MatrixProduct& p, const Block& block) {
  const auto size = [](int value) { return static_cast<std::size_t>(value); };
  return {.rows = size(p.rows),
          .columns = size(block.columns),
          .inner = size(block.inner),
          .a_offset = size(block.first_inner),
          .a_pitch = size(p.inner),
          .b_offset = p.b_offset + size(block.first_inner) * size(p.b_pitch) + size(block.first_column),
          .b_pitch = size(p.b_pitch),
          .c_offset = p.c_offset + size(block.first_column),
          .c_pitch = size(p.c_pitch)};
}

constexpr auto kRows = clblast::Layout::kRowMajor;
constexpr auto kPlain = clblast::Transpose::kNo;

}  // namespace

std::size_t Gemm::block_bytes(const MatrixProduct& p, const Block& block) const {
  const Layout l = layout(p, block);
  cl_command_queue queue = device_.queue();
  std::size_t bytes = 0;
  const std::lock_guard lock(blast_mutex);
  check_blast(clblast::GemmTempBufferSize<float>(kRows, kPlain, kPlain, l.rows, l.columns, l.inner,
                                                 l.a_offset, l.a_pitch, l.b_offset, l.b_pitch, l.c_offset,
                                                 l.c_pitch, &queue, bytes),
              "GemmTempBufferSize");
  return (bytes + sizeof(float) - 1) / sizeof(float) * sizeof(float);
}

std::size_t Gemm::scratch_bytes(const MatrixProduct& p) const {
  std::size_t bytes = 0;
  for (const Block& block : blocks(p)) bytes = std::max(bytes, block_bytes(p, block));
  return bytes;
}

// Products are not included in the timings, because CLBlast only returns the event of its last kernel.
void Gemm::multiply(const MatrixProduct& p, const Block& block) {
  const Layout l = layout(p, block);
  const float keep = block.first_inner == 0 ? 0.0f : 1.0f;
  cl_command_queue queue = device_.queue();
  const std::lock_guard lock(blast_mutex);
  check_blast(clblast::Gemm<float>(kRows, kPlain, kPlain, l.rows, l.columns, l.inner, 1.0f, handle_of(p.a),
                                   l.a_offset, l.a_pitch, handle_of(p.b), l.b_offset, l.b_pitch, keep,
                                   handle_of(p.c), l.c_offset, l.c_pitch, &queue, nullptr,
                                   scratch_ ? handle_of(scratch_.view()) : nullptr),
              "Gemm");
}

void Gemm::operator()(const MatrixProduct& p) {
  const std::size_t floats = scratch_bytes(p) / sizeof(float);
  if (scratch_.size() < floats) {
    scratch_ = {};  // free it before the larger one is allocated
    scratch_ = Buffer<float>(device_, "matrix product", floats);
  }
  for (const Block& block : blocks(p)) multiply(p, block);
}

}  // namespace ubs::opencl
