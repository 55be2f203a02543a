// SPDX-License-Identifier: Apache-2.0
// Gemm computes matrix products in float32 with CLBlast.
#pragma once

#include "host/device/metric_ops.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

class Gemm {
 public:
  explicit Gemm(OpenclDevice& device);
  ~Gemm();
  Gemm(const Gemm&) = delete;
  Gemm& operator=(const Gemm&) = delete;
  void operator()(const MatrixProduct& product);
  // Returns the size of the scratch buffer for padded copies of the factors [bytes].
  std::size_t scratch_bytes(const MatrixProduct& product) const;

 private:
  struct Block {  // a range of columns and a range of the inner dimension
    int first_inner, inner, first_column, columns;
  };
  std::vector<Block> blocks(const MatrixProduct& product) const;
  std::size_t block_bytes(const MatrixProduct& product, const Block& block) const;
  void multiply(const MatrixProduct& product, const Block& block);

  OpenclDevice& device_;
  Buffer<float> scratch_;
};

}  // namespace ubs::opencl
