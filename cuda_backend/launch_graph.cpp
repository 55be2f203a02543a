// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/launch_graph.hpp"

namespace ubs::cuda {
namespace {

// In the first calls buffers are made and kernels are loaded, which drivers do at their first launch.
constexpr std::uint64_t kDirectCalls = 2;

}  // namespace

// An executable graph must not be destroyed under way.
CudaLaunchGraph::~CudaLaunchGraph() {
  if (executable_) cudaStreamSynchronize(device_.stream());
}

void CudaLaunchGraph::give(const std::function<void()>& work) {
  ++counts_.given;
  // Profiling puts events around each launch, UBS_SYNC waits for each.
  if (counts_.given <= kDirectCalls || device_.profiling_ || device_.synchronous_ || device_.recording_)
    return work();
  device_.make_current();
  check_call(cudaStreamBeginCapture(device_.stream(), cudaStreamCaptureModeThreadLocal),
             "cudaStreamBeginCapture");
  device_.recording_ = this;
  try {
    work();
    if (lost_) std::rethrow_exception(lost_);
    if (device_.recording_) launch_recorded();
  } catch (...) {
    discard();
    throw;
  }
}

void CudaLaunchGraph::check_call(cudaError_t code, const char* call) const {
  if (code == cudaSuccess) return;
  cudaGetLastError();
  fail(code == cudaErrorMemoryAllocation ? ErrorKind::memory : ErrorKind::device,
       "launch graph on {}: {} failed with {}: {}; leave out launch_graph", device_.info().name, call,
       cudaGetErrorName(code), cudaGetErrorString(code));
}

GraphHandle CudaLaunchGraph::end_capture() {
  device_.recording_ = nullptr;
  cudaGraph_t graph = nullptr;
  const cudaError_t code = cudaStreamEndCapture(device_.stream(), &graph);
  GraphHandle recorded(graph);
  check_call(code, "cudaStreamEndCapture");
  return recorded;
}

void CudaLaunchGraph::discard() noexcept {
  after_.clear();
  lost_ = nullptr;
  if (!device_.recording_) return;
  device_.recording_ = nullptr;
  cudaGraph_t graph = nullptr;
  cudaStreamEndCapture(device_.stream(), &graph);
  if (graph) cudaGraphDestroy(graph);
  cudaGetLastError();
}

void CudaLaunchGraph::launch_recorded() {
  const GraphHandle graph = end_capture();
  if (!update(graph.get())) {
    if (executable_) device_.finish();
    executable_ = make(graph.get());
    ++counts_.made;
  }
  launch(executable_.get());
  ++counts_.launched;
}

bool CudaLaunchGraph::update(cudaGraph_t graph) {
  if (!executable_) return false;
  cudaGraphExecUpdateResultInfo info{};
  const cudaError_t code = cudaGraphExecUpdate(executable_.get(), graph, &info);
  if (code == cudaErrorGraphExecUpdateFailure) return cudaGetLastError(), false;
  check_call(code, "cudaGraphExecUpdate");
  return true;
}

ExecutableHandle CudaLaunchGraph::make(cudaGraph_t graph) {
  cudaGraphExec_t executable = nullptr;
  check_call(cudaGraphInstantiate(&executable, graph, 0), "cudaGraphInstantiate");
  return ExecutableHandle(executable);
}

void CudaLaunchGraph::launch(cudaGraphExec_t executable) {
  check_call(cudaGraphLaunch(executable, device_.stream()), "cudaGraphLaunch");
  for (const cudaEvent_t event : after_)
    check_call(cudaEventRecord(event, device_.stream()), "cudaEventRecord");
  after_.clear();
}

void CudaLaunchGraph::leave() {
  const GraphHandle graph = end_capture();
  std::size_t nodes = 0;
  check_call(cudaGraphGetNodes(graph.get(), nullptr, &nodes), "cudaGraphGetNodes");
  if (nodes == 0) return;
  const ExecutableHandle part = make(graph.get());
  launch(part.get());
  device_.finish();
}

void CudaLaunchGraph::leave_quietly() noexcept {
  try {
    leave();
  } catch (...) {
    lost_ = std::current_exception();
  }
}

cudaError_t CudaLaunchGraph::record_after(cudaEvent_t event) {
  after_.push_back(event);
  return cudaSuccess;
}

}  // namespace ubs::cuda
