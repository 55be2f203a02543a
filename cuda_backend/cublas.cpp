// SPDX-License-Identifier: Apache-2.0
#include <cublas_v2.h>

#include "cuda_backend/cuda_gemm.hpp"
#include "cuda_backend/dynamic_library.hpp"

namespace ubs::cuda {
namespace {

void check_blas(cublasStatus_t code, const char* call) {
  if (code != CUBLAS_STATUS_SUCCESS)
    fail(ErrorKind::device, "{} failed with cuBLAS status {}", call, static_cast<int>(code));
}

// The cuBLAS functions that this file calls. Their binary interface is the same in all versions of cuBLAS
// since 11, the oldest version that open_library() searches for. Their types are taken from the header.
struct Library {
  decltype(&cublasCreate_v2) create = nullptr;
  decltype(&cublasDestroy_v2) destroy = nullptr;
  decltype(&cublasSetStream_v2) set_stream = nullptr;
  decltype(&cublasSetMathMode) set_math_mode = nullptr;
  decltype(&cublasSgemm_v2) sgemm = nullptr;
};

Library open_library() {
  int driver = 0;
  check(cudaDriverGetVersion(&driver), "cudaDriverGetVersion");
  void* handle = open_first(toolkit_names("libcublas", "11", driver));
  if (!handle)
    fail(ErrorKind::device,
         "LPIPS on CUDA requires libcublas.so of the CUDA toolkit: add its folder to LD_LIBRARY_PATH, or use "
         "--device opencl");
  Library library;
  const auto find = [handle](const char* name, auto& function) {
    find_function(handle, "cuBLAS", name, function);
  };
  find("cublasCreate_v2", library.create);
  find("cublasDestroy_v2", library.destroy);
  find("cublasSetStream_v2", library.set_stream);
  find("cublasSetMathMode", library.set_math_mode);
  find("cublasSgemm_v2", library.sgemm);
  return library;
}

const Library& cublas() {
  static const Library library = open_library();
  return library;
}

class CublasGemm final : public Gemm {
 public:
  explicit CublasGemm(CudaDevice& device) {
    device.make_current();
    check_blas(cublas().create(&handle_), "cublasCreate");
    check_blas(cublas().set_stream(handle_, device.stream()), "cublasSetStream");
    // Compute in float32 throughout, even if the environment requests TF32.
    check_blas(cublas().set_math_mode(handle_, CUBLAS_PEDANTIC_MATH), "cublasSetMathMode");
  }
  ~CublasGemm() override { cublas().destroy(handle_); }
  CublasGemm(const CublasGemm&) = delete;
  CublasGemm& operator=(const CublasGemm&) = delete;

  // cuBLAS expects matrices in column-major order. It reads a row-major matrix as its transpose, so the
  // row-major product C = A B is computed as C^T = B^T A^T.
  cudaError_t operator()(const MatrixProduct& p) override {
    const float one = 1, zero = 0;
    check_blas(cublas().sgemm(handle_, CUBLAS_OP_N, CUBLAS_OP_N, p.columns, p.rows, p.inner, &one,
                              pointer_of(p.b) + p.b_offset, p.b_pitch, pointer_of(p.a), p.inner, &zero,
                              pointer_of(p.c) + p.c_offset, p.c_pitch),
               "cublasSgemm");
    return cudaSuccess;
  }

 private:
  cublasHandle_t handle_ = nullptr;
};

}  // namespace

std::unique_ptr<Gemm> make_gemm(CudaDevice& device) { return std::make_unique<CublasGemm>(device); }

}  // namespace ubs::cuda
