// SPDX-License-Identifier: Apache-2.0
// A CUDA graph of work that is given again and again: the calls of each time are captured from the device's
// stream, and the executable graph of the time before takes over their arguments and grids. Where the nodes
// are others (a sort with more passes, say) it is made anew. Recorded are launches, copies and fills on the
// device, and late reads. Before anything else (memory that is made or freed, uploads, reads, waits) what is
// there is launched as it is, and the rest of that time is not recorded.
#pragma once

#include <exception>
#include <functional>
#include <vector>

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

using GraphHandle =
    std::unique_ptr<std::remove_pointer_t<cudaGraph_t>, Releaser<cudaGraph_t, cudaGraphDestroy>>;
using ExecutableHandle =
    std::unique_ptr<std::remove_pointer_t<cudaGraphExec_t>, Releaser<cudaGraphExec_t, cudaGraphExecDestroy>>;

class CudaLaunchGraph final : public LaunchGraph {
 public:
  explicit CudaLaunchGraph(CudaDevice& device) : device_(device) {}
  ~CudaLaunchGraph() override;
  void give(const std::function<void()>& work) override;
  Counts counts() const override { return counts_; }

  // For the device, while this graph is recorded.
  void leave();
  void leave_quietly() noexcept;  // an error is thrown by give()
  // Recorded in the stream behind the launch: in a graph an event would be one of the graph.
  cudaError_t record_after(cudaEvent_t event);

 private:
  void check_call(cudaError_t code, const char* call) const;
  GraphHandle end_capture();
  void discard() noexcept;
  void launch_recorded();
  bool update(cudaGraph_t graph);
  ExecutableHandle make(cudaGraph_t graph);
  void launch(cudaGraphExec_t executable);

  CudaDevice& device_;
  ExecutableHandle executable_;
  std::vector<cudaEvent_t> after_;
  std::exception_ptr lost_;
  Counts counts_;
};

}  // namespace ubs::cuda
